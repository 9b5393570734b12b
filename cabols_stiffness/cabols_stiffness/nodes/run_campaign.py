# SPDX-License-Identifier: Apache-2.0
"""Executable run_campaign: starts or continues a campaign and shows it; Ctrl-C aborts it."""

from __future__ import annotations

import argparse
import math
import sys
import time
from typing import Any

from rclpy.utilities import remove_ros_args

from cabols_control.command_line import DONE, FAILED, INTERRUPTED, command, fail, interrupt_once
from cabols_control.naming import configuration_name, reflector_name
from cabols_control.ros.rig_client import RigClient, RigError
from cabols_stiffness.campaign.command import run_campaign_parser

END_S = 8.0
"""Longest unloading of an aborted campaign [s]."""
LINE_S = 5.0
"""Between two lines of an unchanged place [s]."""


class Client:
    """Sends the goal and shows the feedback."""

    def __init__(self, rig: RigClient, options: argparse.Namespace) -> None:
        """Use a client of the rig; its owner closes it."""
        self._rig = rig
        self._options = options
        self._began = time.monotonic()
        self._told = -LINE_S
        self._note = ""
        self._line = ""

    def run(self) -> int:
        """Run the campaign; return 0, or 1 after a failure, 130 after Ctrl-C.

        Raises:
            RigError: if it does not begin, or does not end.
        """
        options, code = self._options, DONE
        running = self._rig.start(
            "run_stiffness_test",
            self._show,
            accept_s=options.wait,
            campaign=str(options.campaign.resolve()) if options.campaign else "",
            folder=str(options.folder.resolve()) if options.folder else "",
            accuracy=options.accuracy,
        )
        try:
            end = "the end of the campaign"
            self._rig.wait(lambda: running.done, end, math.inf, even_in_fault=True)
        except KeyboardInterrupt:
            code = INTERRUPTED
            self._say("aborting: unloading")
        found = running.cancel(END_S)
        self._say(
            f"{found.message}: {found.loads} loads, {found.skipped} skipped, in {found.folder}"
        )
        return code or (DONE if found.success else FAILED)

    def _show(self, feedback: Any) -> None:
        if feedback.note != self._note:
            self._note = feedback.note
            self._say(feedback.note)
        place = (configuration_name(feedback.configuration), reflector_name(feedback.reflector))
        line = ", ".join(place)
        now = time.monotonic()
        if line == self._line and now - self._told < LINE_S:
            return
        self._line, self._told = line, now
        left = f"{feedback.remaining:.0f} s left" if feedback.remaining >= 0.0 else ""
        done = f"{feedback.done} of {feedback.total} loads"
        self._say(f"{done:>18}  {line}, {feedback.phase:<14} {left}")

    def _say(self, text: str) -> None:
        print(f"  {time.monotonic() - self._began:5.1f} s  {text}", flush=True)


@command
def main() -> int:
    """Entry point."""
    options = run_campaign_parser().parse_args(remove_ros_args(sys.argv)[1:])
    interrupt_once()
    try:
        with RigClient(name="run_campaign") as rig:
            return Client(rig, options).run()
    except RigError as error:
        return fail(str(error), FAILED)
    except KeyboardInterrupt:
        return fail("interrupted before the campaign began", INTERRUPTED)


if __name__ == "__main__":
    sys.exit(main())
