# SPDX-License-Identifier: Apache-2.0
"""Service report_stiffness_test: analyses the last campaign's bags and writes its report."""

from __future__ import annotations

import os
import subprocess
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from rclpy.node import Node
from std_srvs.srv import Trigger

from cabols_control.bringup.processes import executable_path

PATIENCE_S = 1800.0
END_S = 2.0


class ReportService:
    """Runs `analyze` as a process of low priority, so that the rig loses no cycle."""

    def __init__(self, node: Node, folder: Callable[[], str], running: Callable[[], bool]) -> None:
        """Advertise the service.

        Args:
            node: owner.
            folder: returns the last campaign's; empty: none yet.
            running: returns whether that campaign is still running.
        """
        self._node = node
        self._folder = folder
        self._running = running
        self._process: subprocess.Popen[str] | None = None
        node.create_service(Trigger, "report_stiffness_test", self._answer)

    def close(self) -> None:
        """End a running analysis."""
        process = self._process
        if process is not None and process.poll() is None:
            process.terminate()
            try:
                process.wait(END_S)
            except subprocess.TimeoutExpired:
                process.kill()

    def _answer(self, request: Any, response: Any) -> Any:
        del request
        folder = self._folder()
        if self._process is not None and self._process.poll() is None:
            response.message = "an analysis is under way"
        elif self._running():
            response.message = "the campaign is running"
        elif not folder:
            response.message = "no campaign has been run yet"
        else:
            self._begin(folder)
            response.success, response.message = True, f"analysing {folder}"
        return response

    def _begin(self, folder: str) -> None:
        command = ["nice", "-n", "5", str(executable_path("cabols_stiffness", "analyze")), folder]
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        # The process inherits this node's real-time priority, if it has one.
        with suppress(OSError):
            os.sched_setscheduler(self._process.pid, os.SCHED_OTHER, os.sched_param(0))
        threading.Thread(target=self._follow, args=(self._process, folder), daemon=True).start()

    def _follow(self, process: subprocess.Popen[str], folder: str) -> None:
        try:
            said, _ = process.communicate(timeout=PATIENCE_S)
        except subprocess.TimeoutExpired:
            process.kill()
            said = f"no end within {PATIENCE_S:g} s"
        if not self._node.context.ok():
            return
        last = (said or "").strip().splitlines()[-1:] or [""]
        if process.returncode == 0:
            self._node.get_logger().info(f"report of {folder}: {last[0]}")
        else:
            self._node.get_logger().error(f"report of {folder}: {last[0]}")
