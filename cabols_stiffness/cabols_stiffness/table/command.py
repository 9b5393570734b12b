# SPDX-License-Identifier: Apache-2.0
"""Executable cabols-stiffness: joint stiffness from a table of loads and deflections, and its use.

`cabols-stiffness identify loads.csv --robot robot.urdf --tip tool0` needs neither a rig nor ROS.
The table (CSV or Parquet) has a line of headers, each with its unit, or the units in a line below:
q1_deg to qN_deg (prismatic joints in mm or m), fx_N to mz_Nm, and what was measured: dx_mm, dy_mm,
dz_mm (and rx_mrad, ...) against the unloaded robot, or positions px_mm, ..., or distance_mm to an
anchor; config, load, group, branch, reflector where there are such. Empty cells were not measured.
The verdict comes before the numbers.

`cabols-stiffness correct PROGRAM` and `cabols-stiffness export RESULT` use what was identified: a
program's points corrected, springs for a simulator; each has a --help of its own.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib import import_module

from cabols_control.command_line import command
from cabols_stiffness.table.options import OPTIONS, TASKS, identify_options


@command
def main(words: Sequence[str] | None = None) -> int:
    """Do a task; 0, 1 if the data contradict the model, 2 for a wrong command line or table."""
    given = list(sys.argv[1:] if words is None else words)
    task = given[0] if given else ""
    if task in TASKS:
        options, module = OPTIONS[task](given[1:]), TASKS[task]
    else:
        options, module = identify_options(given), "cabols_stiffness.table.identified_table"
    # Imported now: --help and a wrong command line need none of it.
    return int(import_module(module).run(options))


if __name__ == "__main__":
    sys.exit(main())
