# SPDX-License-Identifier: Apache-2.0
"""Second opinions: what an accepted input must have given, by other people's readers."""

from __future__ import annotations

import csv
import io
import math
import re
from decimal import Decimal
from typing import Any

import numpy as np
from engine import SilentChangeError

DECIMAL = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?", re.ASCII)


def check(right: bool, what: str) -> None:
    """A value must be right."""
    if not right:
        raise SilentChangeError(what)


def decimal(text: str, what: str) -> float:
    """Number of a plain decimal text; anything else that was accepted is a silent change."""
    check(DECIMAL.fullmatch(text) is not None, f"{what}: took a form that is no decimal number")
    return float(Decimal(text))


def equal(found: Any, expected: float, what: str) -> None:
    """Two numbers must be the same, to the last digits."""
    close = math.isclose(float(found), expected, rel_tol=1e-12, abs_tol=1e-300)
    check(close, f"{what}: another value")


def finite(values: Any, what: str) -> None:
    """All numbers must be finite."""
    check(bool(np.isfinite(np.asarray(values, dtype=np.float64)).all()), f"{what}: not finite")


def csv_rows(text: str, mark: str = ",") -> list[list[str]]:
    """Rows by the csv module, which gets the file as it is."""
    return [row for row in csv.reader(io.StringIO(text, newline=""), delimiter=mark) if row]


def same_yaml(ours: Any, theirs: Any, what: str = "yaml") -> None:
    """Two readings of a YAML file; ours may keep a word that theirs takes for something else."""
    if isinstance(ours, dict):
        if isinstance(theirs, str):
            # `a:,` in a list: a mapping to us, a word to ruamel; types refuse it.
            return
        check(isinstance(theirs, dict), f"{what}: a mapping")
        check({str(k) for k in ours} == {str(k) for k in theirs}, f"{what}: other keys")
        others = {str(k): v for k, v in theirs.items()}
        for key, value in ours.items():
            same_yaml(value, others[str(key)], what)
    elif isinstance(ours, list):
        check(isinstance(theirs, list) and len(ours) == len(theirs), f"{what}: another list")
        for one, other in zip(ours, theirs, strict=True):
            same_yaml(one, other, what)
    elif isinstance(ours, str):
        # A word that theirs reads as a number, a date or a flag is refused later by its type.
        check(not isinstance(theirs, str) or ours == theirs, f"{what}: another text")
    elif isinstance(ours, bool) or ours is None:
        check(ours is theirs, f"{what}: another flag")
    elif isinstance(ours, (int, float)):
        if isinstance(theirs, str):
            theirs = decimal(theirs, what)
        check(not isinstance(theirs, bool), f"{what}: a flag as number")
        same = ours == theirs or (math.isnan(ours) and math.isnan(float(theirs)))
        check(same, f"{what}: another number")
    else:
        check(isinstance(ours, bytes) or ours == theirs, f"{what}: {type(ours).__name__}")


def only_finite(value: Any, what: str, depth: int = 0) -> None:
    """No NaN anywhere in a configuration."""
    if isinstance(value, float):
        check(not math.isnan(value), f"{what}: NaN")
    elif isinstance(value, np.ndarray):
        if value.dtype.kind == "f":
            check(not np.isnan(value).any(), f"{what}: NaN")
    elif isinstance(value, dict):
        for item in value.values():
            only_finite(item, what, depth + 1)
    elif isinstance(value, (list, tuple)):
        for item in value:
            only_finite(item, what, depth + 1)
    elif hasattr(value, "__dataclass_fields__") and depth < 8:
        for name in value.__dataclass_fields__:
            only_finite(getattr(value, name), what, depth + 1)
