"""Executable run_campaign: starts or continues a campaign and shows it; Ctrl-C aborts it."""

from __future__ import annotations

import argparse
import signal
import sys
import time
from typing import Any

import rclpy
from cabols_msgs.action import RunStiffnessTest
from rclpy.action import ActionClient
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from cabols_control.command_line import command
from cabols_control.naming import configuration_name, reflector_name
from cabols_control.ros import transport
from cabols_control.ros.threads.node_executor import NodeExecutor
from cabols_control.topics import NAMESPACE
from cabols_stiffness.campaign.command import run_campaign_parser

RETRY_S = 0.5
END_S = 8.0
"""Longest unloading of an aborted campaign [s]."""
LINE_S = 5.0
SPIN_S = 0.1


class Client:
    """Sends the goal and shows the feedback."""

    def __init__(self, options: argparse.Namespace) -> None:
        """Join the graph."""
        self._options = options
        self._began = time.monotonic()
        self._told = -LINE_S
        self._note = ""
        self._line = ""
        self._ended = False
        self._node = rclpy.create_node("run_campaign", namespace=NAMESPACE)
        self._executor = NodeExecutor()
        self._executor.add_node(self._node)
        self._client = ActionClient(self._node, RunStiffnessTest, "run_stiffness_test")

    def interrupt(self, *_: object) -> None:
        """Request the end."""
        self._ended = True

    def run(self) -> int:
        """Run the campaign; return 0, 1 after a failure, 130 after Ctrl-C."""
        handle = self._begin()
        if handle is None:
            return 130 if self._ended else 1
        result = handle.get_result_async()
        while not result.done() and not self._ended:
            self._executor.spin_once(timeout_sec=SPIN_S)
        if not result.done():
            self._say("aborting: unloading")
            handle.cancel_goal_async()
            give_up = time.monotonic() + END_S
            while not result.done() and time.monotonic() < give_up:
                self._executor.spin_once(timeout_sec=SPIN_S)
        if not result.done():
            print("error: the campaign's node did not answer in time", file=sys.stderr)
            return 1
        found = result.result().result
        self._say(
            f"{found.message}: {found.loads} loads, {found.skipped} skipped, in {found.folder}"
        )
        if self._ended:
            return 130
        return 0 if found.success else 1

    def _begin(self) -> Any:
        """Send the goal until it is accepted; None if it was not in time, or after Ctrl-C."""
        options = self._options
        goal = RunStiffnessTest.Goal(
            campaign=str(options.campaign.resolve()) if options.campaign else "",
            folder=str(options.folder.resolve()) if options.folder else "",
            accuracy=options.accuracy,
        )
        give_up = time.monotonic() + options.wait
        while not self._ended:
            if self._client.server_is_ready():
                sent = self._client.send_goal_async(goal, self._show)
                while not sent.done() and not self._ended and time.monotonic() < give_up:
                    self._executor.spin_once(timeout_sec=SPIN_S)
                if sent.done() and sent.result().accepted:
                    return sent.result()
            if time.monotonic() > give_up:
                print(
                    f"error: no campaign was begun within {options.wait:g} s; is its node running, "
                    "and the mode STOPPED? Its log says why it refused",
                    file=sys.stderr,
                )
                return None
            later = time.monotonic() + RETRY_S
            while time.monotonic() < later and not self._ended:
                self._executor.spin_once(timeout_sec=SPIN_S)
        return None

    def _show(self, message: Any) -> None:
        feedback = message.feedback
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

    def close(self) -> None:
        """Leave the graph."""
        self._client.destroy()
        self._node.destroy_node()


@command
def main() -> int:
    """Entry point."""
    options = run_campaign_parser().parse_args(remove_ros_args(sys.argv)[1:])
    transport.init(signal_handler_options=SignalHandlerOptions.NO)
    client = Client(options)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, client.interrupt)
    try:
        return client.run()
    finally:
        client.close()
        rclpy.try_shutdown()


if __name__ == "__main__":
    sys.exit(main())
