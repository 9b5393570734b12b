# SPDX-License-Identifier: Apache-2.0
"""Executable analyze: a campaign's folder, or a bag, to result.yaml, report.html and tables."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from cabols_control.command_line import DONE, CommandParser, command
from cabols_control.errors import UsageError
from cabols_stiffness.model.model_words import model_word

TABLES = (".csv", ".tsv")
"""Files that are a laboratory's own table."""


@command
def main(words: Sequence[str] | None = None) -> int:
    """Analyse; 0, 1 for data that cannot be used, 2 for a wrong command line."""
    options = _arguments(words)
    if not options.source.exists():
        raise UsageError(
            f"{options.source}: expected a campaign's folder or a bag, got nothing there; "
            "check the path"
        )
    if options.source.suffix.lower() in TABLES:
        raise UsageError(
            f"{options.source}: expected a campaign's folder or a bag, got a table; use "
            "`cabols-stiffness identify TABLE`, which has options for its robot and tool"
        )
    # scipy, matplotlib and pinocchio take seconds to import, and help needs none of them.
    from cabols_stiffness.analysis.run import analyse

    analyse(options)
    return DONE


def _arguments(words: Sequence[str] | None) -> argparse.Namespace:
    parser = CommandParser("analyze", __doc__)
    add = parser.add_argument
    add("source", type=Path, metavar="BAG_OR_CAMPAIGN", help="folder of a campaign or of a bag")
    add("--output", type=Path, help="folder to fill; default: the campaign's, or BAG_analysis")
    add("--campaign", default="", help="campaign.yaml; default: the folder's, or the bag's own")
    add("--geometry", default="", help="YAML of the rig's geometry; default: the bench's")
    add(
        "--model",
        default="",
        type=model_word,
        help="linear, cubic, as_published; auto: the ladder of models; or its rungs, joined by +; "
        "default: the campaign's",
    )
    add("--statement", default="", help="YAML of a certificate: operator, instruments, type B")
    return parser.parse_args(words)


if __name__ == "__main__":
    sys.exit(main())
