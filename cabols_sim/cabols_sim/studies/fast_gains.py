# SPDX-License-Identifier: Apache-2.0
"""The faster control design, proved on the full plant through the real nodes in lockstep.

Runs the bench with the design for each programme, judges the recorded bags, and varies the plant in
the compiled closed loop. Prints a table, writes it, and returns 1 if a promise is not kept.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from cabols_control.command_line import CommandParser, command, existing_path, rig_option
from cabols_control.files.output_folder import output_folder

FAST = "control_fast.yaml"


@command
def main() -> int:
    """Prove the design; returns 0 if every promise is kept, else 1."""
    arguments = _arguments()
    # scipy and matplotlib take seconds to import, and help needs neither.
    from cabols_sim.studies.fast_gains_proof import prove

    with output_folder(arguments.output, "fast_gains") as folder:
        code = prove(arguments, FAST)
        folder.finish()
    return code


def _arguments() -> argparse.Namespace:
    parser = CommandParser("fast_gains", __doc__)
    rig_option(parser)
    add = parser.add_argument
    add("--output", type=Path, default=Path("build/fast-gains"), help="folder for bags")
    add("--json", type=Path, default=Path("build/bench/fast_gains.json"), help="figures")
    add("--program", action="append", help="built in or .csv; repeat; default: steps, multi_axis")
    add("--control-file", type=existing_path, help=f"YAML of the design; default: {FAST}")
    add("--search", action="store_true", help="search for poles and zero first (minutes)")
    add("--draws", type=int, default=100, help="plants in the compiled loop; 0: none")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
