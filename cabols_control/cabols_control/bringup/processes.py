# SPDX-License-Identifier: Apache-2.0
"""A small process supervisor, for computers without `ros2 launch`.

Starts the nodes in order, prefixes their output, ends all when one ends, in reverse order: SIGINT,
after a grace SIGTERM, then SIGKILL. Nodes under load unload before they obey. One that may restart
ends nothing. If this process is killed itself, the kernel sends its children SIGTERM. SIGINT,
SIGTERM, SIGHUP and SIGQUIT start the end, during the start as well; later ones do not disturb it.
"""

from __future__ import annotations

import asyncio
import ctypes
import os
import signal
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from cabols_control import end_signals
from cabols_control.bringup.specs import LAUNCHER, NodeSpec
from cabols_control.command_line import USAGE
from cabols_control.errors import CabolsError

PR_SET_PDEATHSIG = 1
GRACE_S = 4.0
"""From SIGINT to SIGTERM, and on to SIGKILL [s]; together more than a node may take to unload."""
RESTART_S = 1.0
RESTART_NICENESS = 15
RESTARTS = 5
"""Most new starts of one node that ends again and again."""
LONGEST_LINE = 65536
"""Bytes of a node's output that are shown as one line."""
_LIBC = ctypes.CDLL(None)


class ProcessError(CabolsError):
    """A node cannot be started."""


@dataclass(frozen=True)
class Ended:
    """Outcome of a run of processes.

    Attributes:
        first: name of the node that ended first; empty if the user interrupted.
        code: its exit code, negative for a signal; 0 when interrupted.
        codes: exit code of every node; 0 for one that had not opened anything yet.
        overdue: whether the run was ended because it took longer than its limit.
        interrupted_s: when the first signal to end came, by time.monotonic(); None: none came.
    """

    first: str
    code: int
    codes: dict[str, int]
    overdue: bool = False
    interrupted_s: float | None = None


def executable_path(package: str, executable: str) -> Path:
    """Find an executable in the place where `ros2 run` looks: <prefix>/lib/<package>/<executable>.

    Args:
        package: ROS package.
        executable: its name there.

    Raises:
        ProcessError: if it is in no prefix of AMENT_PREFIX_PATH nor in this interpreter's.
    """
    prefixes = [p for p in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if p]
    for prefix in [*prefixes, sys.prefix]:
        candidate = Path(prefix) / "lib" / package / executable
        if candidate.is_file():
            return candidate
    raise ProcessError(
        f"{package} {executable}: expected it below lib/{package} of one of "
        f"{[*prefixes, sys.prefix]}; build the workspace first"
    )


def command_line(spec: NodeSpec) -> list[str]:
    """Return the command that starts a node."""
    return [str(executable_path(spec.package, spec.executable)), *spec.arguments()]


def run(
    nodes: Sequence[NodeSpec],
    environment: dict[str, str] | None = None,
    on_line: Callable[[str, str], None] | None = None,
    log_folder: Path | None = None,
    on_start: Callable[[dict[str, int]], None] | None = None,
    keep_going: bool = False,
    respawn_s: float | None = None,
    limit_s: float | None = None,
    grace_s: float = GRACE_S,
) -> Ended:
    """Run nodes until the first ends or the user interrupts, then end all.

    Args:
        nodes: in starting order; they are ended in reverse.
        environment: variables to add.
        on_line: called with (node, line) for every line of output; default prints them.
        log_folder: keep each node's output there, as <node>.log.
        on_start: called with the process ids once all have started; with respawn_s the same dict
            is kept up to date.
        keep_going: run on when a node ends, until the user interrupts.
        respawn_s: time from a node's end to its new start; implies keep_going [s].
        limit_s: longest time from the first start; then all are ended. None: no limit [s].
        grace_s: from SIGINT to SIGTERM, and on to SIGKILL [s].

    Returns:
        How it ended.
    """
    output = (on_line or _print_line, log_folder)
    return asyncio.run(
        _run(nodes, environment or {}, *output, on_start, keep_going, respawn_s, limit_s, grace_s)
    )


def _print_line(name: str, line: str) -> None:
    print(f"[{name}] {line}", flush=True)


def _prepare_child(niceness: int, hold: bool) -> None:
    os.nice(niceness)
    if hold:
        end_signals.hold()
    # Not SIGKILL: a loaded rig unloads first.
    _LIBC.prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
    # A Ctrl-C of the terminal reaches only this process, which ends the nodes in order.
    os.setpgrp()


async def _run(
    nodes: Sequence[NodeSpec],
    environment: dict[str, str],
    on_line: Callable[[str, str], None],
    log_folder: Path | None,
    on_start: Callable[[dict[str, int]], None] | None,
    keep_going: bool,
    respawn_s: float | None,
    limit_s: float | None,
    grace_s: float,
) -> Ended:
    if log_folder is not None:
        log_folder.mkdir(parents=True, exist_ok=True)
        for spec in nodes:
            (log_folder / f"{spec.executable}.log").unlink(missing_ok=True)
    commands = [(spec.executable, command_line(spec)) for spec in nodes]
    # What has a part in the graph handles them as soon as it can end in order.
    holding = {spec.executable for spec in nodes if spec.role is not None}
    unopened: set[str] = set()
    interrupted = asyncio.Event()
    interrupted_s: list[float] = []

    def interrupt() -> None:
        interrupted_s.append(time.monotonic())
        interrupted.set()

    loop = asyncio.get_running_loop()
    for number in end_signals.END_SIGNALS:
        loop.add_signal_handler(number, interrupt)
    processes: dict[str, asyncio.subprocess.Process] = {}
    pumps = []
    keepers: list[asyncio.Task[None]] = []
    pids: dict[str, int] = {}
    first, code, overdue = "", 0, False

    async def start(name: str, command: list[str], niceness: int = 0) -> None:
        process = await asyncio.create_subprocess_exec(
            *command,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.STDOUT,
            stdin=asyncio.subprocess.DEVNULL,
            env={**os.environ, LAUNCHER: str(os.getpid()), **environment},
            preexec_fn=partial(_prepare_child, niceness, name in holding),
        )
        processes[name], pids[name] = process, process.pid
        pumps.append(asyncio.create_task(_pump(name, process, on_line, log_folder)))

    async def keep(name: str, command: list[str]) -> None:
        while True:
            await processes[name].wait()
            await asyncio.sleep(respawn_s or 0.0)
            await start(name, command)

    expendable = {spec.executable for spec in nodes if spec.restarts}

    async def keep_expendable(name: str, command: list[str]) -> None:
        """Return only if the node cannot be started at all."""
        for _ in range(RESTARTS):
            if await processes[name].wait() == USAGE:
                return
            on_line(name, f"ended with code {processes[name].returncode}, starts again")
            await asyncio.sleep(RESTART_S)
            # Loading a program must not take the cores that the loops need.
            await start(name, command, RESTART_NICENESS)
        await processes[name].wait()
        on_line(name, "ended too often; the others go on without it")
        await asyncio.Event().wait()

    try:
        for name, command in commands:
            if interrupted.is_set():
                break
            await start(name, command)
        if respawn_s is not None:
            keepers = [asyncio.create_task(keep(*item)) for item in commands if item[0] in pids]
        else:
            keepers = [
                asyncio.create_task(keep_expendable(*item), name=item[0])
                for item in commands
                if item[0] in expendable and item[0] in pids
            ]
        if on_start is not None:
            on_start(pids)
        if keep_going or respawn_s is not None:
            end = asyncio.create_task(_interruption(interrupted))
        else:
            lasting = {n: p for n, p in processes.items() if n not in expendable}
            end = asyncio.create_task(_first_end(lasting, keepers, interrupted))
        try:
            first, code = await asyncio.wait_for(end, limit_s)
        except asyncio.TimeoutError:
            overdue = True
    finally:
        for keeper in keepers:
            keeper.cancel()
        for name in reversed(processes):
            if name in holding and end_signals.held_by(processes[name].pid):
                # It would only go on to start, for seconds on a busy computer.
                processes[name].kill()
                unopened.add(name)
            await _end(processes[name], grace_s)
        await asyncio.gather(*pumps)
        for number in end_signals.END_SIGNALS:
            loop.remove_signal_handler(number)
    codes = {
        name: 0 if name in unopened else process.returncode or 0
        for name, process in processes.items()
    }
    return Ended(first, code, codes, overdue, next(iter(interrupted_s), None))


async def _interruption(interrupted: asyncio.Event) -> tuple[str, int]:
    await interrupted.wait()
    return "", 0


async def _first_end(
    processes: dict[str, asyncio.subprocess.Process],
    keepers: Sequence[asyncio.Task[None]],
    interrupted: asyncio.Event,
) -> tuple[str, int]:
    tasks = {asyncio.create_task(process.wait()): name for name, process in processes.items()}
    stop = asyncio.create_task(interrupted.wait())
    waited: list[asyncio.Task[Any]] = [*tasks, *keepers, stop]
    done, pending = await asyncio.wait(waited, return_when=asyncio.FIRST_COMPLETED)
    for task in pending:
        task.cancel()
    for keeper in keepers:
        if keeper in done:
            return keeper.get_name(), USAGE
    ended = [task for task in done if task is not stop]
    if not ended:
        return "", 0
    return tasks[ended[0]], int(ended[0].result() or 0)


async def _end(process: asyncio.subprocess.Process, grace_s: float) -> None:
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
        if process.returncode is not None:
            return
        with suppress(ProcessLookupError):
            process.send_signal(number)
        with suppress(asyncio.TimeoutError):
            await asyncio.wait_for(process.wait(), grace_s)


async def _pump(
    name: str,
    process: asyncio.subprocess.Process,
    on_line: Callable[[str, str], None],
    log_folder: Path | None,
) -> None:
    assert process.stdout is not None
    log = (log_folder / f"{name}.log").open("wb", buffering=0) if log_folder else None

    def tell(line: bytes) -> None:
        # A closed terminal or a full disk takes no lines; the nodes must not wait for them.
        if log is not None:
            with suppress(OSError):
                log.write(line + b"\n")
        with suppress(OSError, ValueError):
            on_line(name, line.decode(errors="replace").rstrip())

    try:
        rest, shown = b"", False
        while piece := await process.stdout.read(LONGEST_LINE):
            *lines, rest = (rest + piece).split(b"\n")
            if lines and shown:
                # The end of a long line, of which nothing but the newline may be left.
                shown = False
                if not lines[0]:
                    del lines[0]
            if len(rest) >= LONGEST_LINE:
                lines, rest, shown = [*lines, rest], b"", True
            for line in lines:
                tell(line)
        if rest:
            tell(rest)
    finally:
        if log is not None:
            log.close()
