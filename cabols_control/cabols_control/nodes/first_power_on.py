"""Tool: checks a rig's wiring at its first power-on, one limb after the other."""

from __future__ import annotations

import sys
import time
from typing import Any

import rclpy
from cabols_msgs.action import CommissionLimb
from rclpy.action import ActionClient
from rclpy.utilities import remove_ros_args

from cabols_control.command_line import DONE, FAILED, command, fail
from cabols_control.commissioning.command import power_on_parser
from cabols_control.commissioning.power_on_record import (
    configuration_hash,
    passed_limbs,
    record_path,
    save_passed,
)
from cabols_control.errors import CabolsError, UsageError
from cabols_control.naming import limb_index, limb_name, limb_names
from cabols_control.result_code import NOT_YET
from cabols_control.rig import load_rig
from cabols_control.rig_folder import find_rig
from cabols_control.ros import transport
from cabols_control.ros.threads.node_executor import NodeExecutor
from cabols_control.topics import NAMESPACE

FOUND_S = 180.0
"""Longest wait for the action; a first start compiles for a minute or two [s]."""
LIMB_S = 90.0
AGAIN_S = 30.0
"""Time for which a refusal that may pass is tried again [s]."""


class Checker:
    """Client of commission_limb."""

    def __init__(self) -> None:
        """Make a node; nothing moves yet."""
        self._node = rclpy.create_node("first_power_on", namespace=NAMESPACE)
        self._client = ActionClient(self._node, CommissionLimb, "commission_limb")
        self._executor = NodeExecutor()
        self._executor.add_node(self._node)

    def close(self) -> None:
        """End."""
        self._executor.remove_node(self._node)
        self._client.destroy()
        self._node.destroy_node()

    def find(self) -> bool:
        """Wait for the action; return whether it is available."""
        give_up = time.monotonic() + FOUND_S
        while not self._client.server_is_ready():
            if time.monotonic() > give_up:
                return False
            self._executor.spin_once(timeout_sec=0.2)
        return True

    def check(self, limb: int) -> Any:
        """Check one limb; a refusal that may pass is tried again for a while.

        Args:
            limb: from 0.

        Raises:
            TimeoutError: if there is no answer.
        """
        give_up = time.monotonic() + AGAIN_S
        while True:
            goal = CommissionLimb.Goal(limb=limb, first_power_on=True)
            handle = self._wait(self._client.send_goal_async(goal), 10.0)
            result = self._wait(handle.get_result_async(), LIMB_S).result
            if result.success or result.code not in NOT_YET or time.monotonic() > give_up:
                return result
            self._executor.spin_once(timeout_sec=0.5)

    def _wait(self, future: Any, seconds: float) -> Any:
        until = time.monotonic() + seconds
        while not future.done():
            if time.monotonic() > until:
                raise TimeoutError(f"commission_limb: no answer within {seconds:g} s")
            self._executor.spin_once(timeout_sec=0.2)
        return future.result()


@command
def main() -> int:
    """Check; returns 0 if all named limbs pass, 1 if one does not, 2 for bad arguments."""
    arguments = power_on_parser().parse_args(remove_ros_args(sys.argv)[1:])
    folder = find_rig(arguments.rig)
    cables = load_rig(folder).geometry.cables
    try:
        limbs = [limb_index(typed, cables) for typed in arguments.limb or ()]
    except CabolsError as error:
        raise UsageError(f"--{error}") from error
    path = arguments.file or record_path(folder)
    configuration = configuration_hash(folder)
    passed = set(passed_limbs(path, configuration))
    transport.init(args=sys.argv)
    checker = Checker()
    try:
        if not checker.find():
            return fail("no action commission_limb: is the rig running?", FAILED)
        for limb in limbs or range(cables):
            result = checker.check(limb)
            print(f"  {result.message or limb_name(limb)}", flush=True)
            passed = (passed | {limb}) if result.success else (passed - {limb})
            # After each limb, so that an interruption keeps what has passed.
            save_passed(path, configuration, passed)
    except TimeoutError as error:
        return fail(str(error), FAILED)
    finally:
        checker.close()
        rclpy.try_shutdown()
    left = sorted(set(range(cables)) - passed)
    if left:
        return fail(f"not passed: {limb_names(left)}; nothing else moves until they have", FAILED)
    print(f"all {cables} limbs have passed; kept in {path}")
    return DONE


if __name__ == "__main__":
    sys.exit(main())
