# SPDX-License-Identifier: Apache-2.0
"""Identify how late the robot's poses are, from a recorded motion under load.

The robot has to move while the cables pull, best to and fro at 50 mm/s: see the action follow_path.
The lag found is of the stamps as recorded: it replaces `pose_lag` in the rig's control.yaml.
"""

from __future__ import annotations

import sys
from pathlib import Path

from cabols_control.command_line import DONE, CommandParser, command, rig_option


@command
def main() -> int:
    """Print the lag of a bag's poses; returns 0, or 1 if it says nothing about it."""
    parser = CommandParser("pose_lag", __doc__)
    parser.add_argument("bag", type=Path, help="folder of the bag")
    rig_option(parser)
    options = parser.parse_args()
    # numba takes a second to import, and help does not need it.
    from cabols_control.bags.reader import read_bag
    from cabols_control.commissioning.pose_lag import PoseLagError, identify_pose_lag
    from cabols_control.commissioning.pose_lag_recording import TOPICS, recording_of
    from cabols_control.rig import load_rig

    try:
        found = identify_pose_lag(
            load_rig(options.rig), recording_of(read_bag(options.bag, TOPICS))
        )
    except PoseLagError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    print(f"pose_lag: {found.lag:.4f}   # s, +- {found.deviation:.4f} by parts of the recording")
    print(
        f"  sensor and cables differ by {found.residual:.2f} N rms with it, by "
        f"{found.residual_without:.2f} N with none"
    )
    return DONE


if __name__ == "__main__":
    raise SystemExit(main())
