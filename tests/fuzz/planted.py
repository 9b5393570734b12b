# SPDX-License-Identifier: Apache-2.0
"""Bugs that somebody might write, planted one at a time: the fuzzer must find each.

Usage: planted.py NAME FOLDER, which prints the kinds of findings as JSON.
"""

from __future__ import annotations

import dataclasses
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent / "harness")]

import binary_targets  # noqa: E402
import text_targets  # noqa: E402
from engine import Target, run  # noqa: E402

from cabols_control import cdr  # noqa: E402
from cabols_control.files import strict_yaml  # noqa: E402
from cabols_control.load_programs import programs  # noqa: E402
from cabols_control.serial_arms import arm as serial_arm  # noqa: E402
from cabols_hw.abb.egm import sample as egm_sample  # noqa: E402
from cabols_hw.abb.rws import answers as rws_answers  # noqa: E402

MOST, SECONDS = 6_000, 40.0
MEMORY_MOST = 20_000


def last_key_wins() -> str:
    """YAML: a key that stands twice is taken."""
    strict_yaml._Loader.construct_mapping = yaml.SafeLoader.construct_mapping
    return "yaml"


def pythons_numbers() -> str:
    """CSV: Python's own reader of numbers."""
    programs.plain_number = lambda text, *_: float(text)
    return "programme_csv"


def forgotten_bound() -> str:
    """EGM: a bound that is forgotten."""
    egm_sample.FARTHEST_M = float("inf")
    return "egm_packet"


def missing_exception() -> str:
    """RWS: int() raises one more exception than was thought of."""

    def number(value: Any) -> int:
        try:
            return int(value)
        except (TypeError, ValueError):
            return 0

    rws_answers._number = number
    return "rws_answer"


def circle() -> str:
    """URDF: a loop that ends only in trees."""

    def way(name: str, above: dict[str, Any], path: Any) -> list[Any]:
        found: list[Any] = []
        while name in above:
            found = [above[name], *found[:50]]
            name = serial_arm._link(above[name], "parent", path)
        return found

    serial_arm._way_to = way
    return "urdf"


def kept_texts() -> str:
    """Bias file: every text is kept."""
    kept = []
    load = text_targets.load_bias

    def keeping(path: Path, serial: str) -> Any:
        kept.append(bytearray(2000))
        return load(path, serial)

    text_targets.load_bias = keeping
    return "sensor_bias"


def kept_zeros() -> str:
    """Bags: a string that ends early or late counts as whole."""
    text = cdr.Places._text

    def lenient(self: Any, name: str, offset: int) -> Any:
        content = self._content.text(name, cdr.align(offset, 4))
        try:
            return text(self, name, offset)
        except cdr.LayoutError:
            place = self._size(len(content), offset)
            return content.decode(), place + len(content)

    cdr.Places._text = lenient
    return "cdr_bag"


PLANTED: dict[str, Callable[[], str]] = {
    plant.__name__: plant
    for plant in (
        last_key_wins,
        pythons_numbers,
        forgotten_bound,
        missing_exception,
        circle,
        kept_texts,
        kept_zeros,
    )
}


def main() -> int:
    """Plant one, run its target, print what was found."""
    name, folder = sys.argv[1:]
    target_name = PLANTED[name]()
    targets: list[Target] = [*text_targets.TARGETS, *binary_targets.TARGETS]
    (target,) = (t for t in targets if t.name == target_name)
    quick = dataclasses.replace(target, deadline_s=0.3)
    most = MEMORY_MOST if name == "kept_texts" else MOST
    found = run(quick, Path(folder), 1, most, SECONDS)
    print(json.dumps(found.findings))
    return 0


if __name__ == "__main__":
    sys.exit(main())
