# SPDX-License-Identifier: Apache-2.0
"""Chapter 2 and the springs' dynamics, computed: balances, the 900 m case, vibration, margins.

Leaves figures and dynamics.json in the output folder and prints what they say.
"""

from __future__ import annotations

from pathlib import Path

from cabols_control.command_line import DONE, FAILED, CommandParser, command
from cabols_control.files.output_folder import output_folder


@command
def main() -> int:
    """Compute everything; returns 0 if all balances close, else 1."""
    parser = CommandParser("dynamics_study", __doc__)
    parser.add_argument("--output", type=Path, default=Path("build/dynamics"), help="folder")
    place = parser.parse_args().output
    # scipy and matplotlib take seconds to import, and help needs neither.
    from cabols_sim.studies.dynamics_results import run_study

    with output_folder(place, "dynamics_study") as folder:
        closed = run_study(place)
        folder.finish()
    return DONE if closed else FAILED


if __name__ == "__main__":
    raise SystemExit(main())
