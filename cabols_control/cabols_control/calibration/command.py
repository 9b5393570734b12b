# SPDX-License-Identifier: Apache-2.0
"""Calibrate a rig from its own readings: points, pulleys, k_e, sensor; or plan where to read.

With --plan, writes the poses to stop at. With DATA, a table of readings at such stops, estimates,
holds a fifth of the stops out to check, says what the data did not tell, and writes a new folder.
"""

from __future__ import annotations

from pathlib import Path

from cabols_control.command_line import CommandParser, command, rig_option
from cabols_control.errors import UsageError

NOISE = ("length", "position", "rotation", "force", "torque")
"""Standard deviations of readings that have an option; fields of `model.Noise`."""


@command
def main() -> int:
    """Plan or calibrate; returns 0, 1 where the readings do not fit, 2 after a mistake."""
    parser = CommandParser("calibrate_rig", __doc__)
    parser.add_argument("data", nargs="?", type=Path, help="CSV of readings")
    rig_option(parser)
    parser.add_argument("--plan", type=int, metavar="STOPS", help="write a plan in place of it")
    parser.add_argument("--output", type=Path, required=True, help="folder or plan to write")
    parser.add_argument("--tension", type=float, help="of the cables without load [N]")
    parser.add_argument("--reach", type=float, default=0.35, help="of planned stops [m]")
    parser.add_argument("--turn-deg", type=float, default=30.0, help="of planned stops [deg]")
    parser.add_argument("--seed", type=int, default=0, help="of the plan's candidates")
    for name in NOISE:
        parser.add_argument(f"--{name}-std", type=float, help="of a reading")
    options = parser.parse_args()
    if (options.data is None) == (options.plan is None):
        raise UsageError("calibrate_rig: expected either DATA or --plan STOPS")
    # Estimators take seconds to import, and `--help` needs none.
    from .session import plan_or_calibrate

    return plan_or_calibrate(options)


if __name__ == "__main__":
    raise SystemExit(main())
