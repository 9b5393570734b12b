# SPDX-License-Identifier: Apache-2.0
"""Tool: checks a rig's wiring at its first power-on, one limb after the other."""

from __future__ import annotations

import sys

from rclpy.utilities import remove_ros_args

from cabols_control.command_line import DONE, FAILED, INTERRUPTED, command, fail, interrupt_once
from cabols_control.commissioning.command import power_on_parser
from cabols_control.commissioning.power_on_record import (
    configuration_hash,
    passed_limbs,
    record_path,
    save_passed,
)
from cabols_control.errors import CabolsError, UsageError
from cabols_control.naming import limb_index, limb_name, limb_names
from cabols_control.rig import load_rig
from cabols_control.rig_folder import find_rig
from cabols_control.ros.limb_actions.commissioning import commission_limb
from cabols_control.ros.rig_client import RigClient, RigError

LIMB_S = 90.0
"""Longest check of one limb [s]."""


def say(text: str) -> None:
    """Print a line at once."""
    print(f"  {text}", flush=True)


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
    interrupt_once()
    try:
        with RigClient(name="first_power_on") as rig:
            for limb in limbs or range(cables):
                result = commission_limb(rig, LIMB_S, say, limb=limb, first_power_on=True)
                say(result.message or limb_name(limb))
                passed = (passed | {limb}) if result.success else (passed - {limb})
                # After each limb, so that an interruption keeps what has passed.
                save_passed(path, configuration, passed)
    except RigError as error:
        return fail(str(error), FAILED)
    except KeyboardInterrupt:
        print(f"interrupted; what has passed is kept in {path}", file=sys.stderr)
        return INTERRUPTED
    left = sorted(set(range(cables)) - passed)
    if left:
        return fail(f"not passed: {limb_names(left)}; nothing else moves until they have", FAILED)
    print(f"all {cables} limbs have passed; kept in {path}")
    return DONE


if __name__ == "__main__":
    sys.exit(main())
