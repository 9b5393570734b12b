# SPDX-License-Identifier: Apache-2.0
"""Command `report`: one HTML file about any recorded run of a rig."""

from __future__ import annotations

import sys
import time
import webbrowser
from collections.abc import Sequence
from pathlib import Path

from cabols_control.command_line import DONE, CommandParser, command

TEXT = """Write a report of a recorded run: one HTML file that needs nothing else.

Any bag of a rig will do; what it lacks is named. A run that reached LOADING is judged, too. Limits
are those of the rig's files that the recorder put into the bag."""


@command
def main(words: Sequence[str] | None = None) -> int:
    """Write the report; returns the exit code."""
    options = _parser().parse_args(words)
    # After the parser: it takes two seconds to import, and help needs none of it.
    from cabols_control.run_report.bag_report import report_bag

    began = time.monotonic()

    def say(text: str) -> None:
        print(f"  {time.monotonic() - began:5.1f} s  {text}", file=sys.stderr, flush=True)

    bag: Path = options.bag
    output = options.output or bag.with_name(bag.resolve().name + "_report.html")
    written = report_bag(bag, output, say)
    for text in written.missing:
        print(f"  missing: {text}")
    print(f"  {written.path}")
    if options.show:
        webbrowser.open(written.path.resolve().as_uri())
    return DONE


def _parser() -> CommandParser:
    parser = CommandParser("report", TEXT)
    add = parser.add_argument
    add("bag", type=Path, help="folder of the bag")
    add("--output", type=Path, help="HTML file; default: BAG_report.html")
    add("--show", action="store_true", help="open it in a browser")
    return parser


if __name__ == "__main__":
    sys.exit(main())
