# SPDX-License-Identifier: Apache-2.0
"""Columns of a table by their headers: what they hold, and in which unit."""

from __future__ import annotations

import re
from dataclasses import dataclass

from cabols_stiffness.data_files.unit_words import KIND, plain_unit
from cabols_stiffness.errors import TableError

NAMES = {
    "configuration": ("config", "configuration", "pose", "conf", "configuration_index"),
    "load": ("load", "load_index", "step"),
    "reflector": ("reflector", "reflector_index", "target"),
    "group": ("group", "pass"),
    "branch": ("branch", "direction"),
    "time": ("time", "t", "time_s"),
    **{f"f{a}": (f"f{a}", f"f_{a}", f"force_{a}", f"force{a}") for a in "xyz"},
    **{
        f"m{a}": (f"m{a}", f"m_{a}", f"t{a}", f"t_{a}", f"torque_{a}", f"torque{a}", f"moment_{a}")
        for a in "xyz"
    },
    **{
        f"d{a}": (
            f"d{a}",
            f"d_{a}",
            f"u{a}",
            f"u_{a}",
            f"delta_{a}",
            f"displacement_{a}",
            f"deflection_{a}",
        )
        for a in "xyz"
    },
    **{f"r{a}": (f"r{a}", f"r_{a}", f"rot_{a}", f"rotation_{a}", f"dr{a}") for a in "xyz"},
    **{f"p{a}": (f"p{a}", f"p_{a}", a, f"pos_{a}", f"position_{a}") for a in "xyz"},
    "mass": ("mass", "weight", "dead_weight"),
    "distance": ("distance", "length", "bar"),
}
KINDS = {
    **{f"f{a}": ("force",) for a in "xyz"},
    **{f"m{a}": ("torque",) for a in "xyz"},
    **{f"d{a}": ("length",) for a in "xyz"},
    **{f"p{a}": ("length",) for a in "xyz"},
    **{f"r{a}": ("angle",) for a in "xyz"},
    "distance": ("length",),
    "mass": ("mass",),
}
"""Kinds of unit that a column may have; joints: angle or length; others have none."""

JOINT = re.compile(r"(?:q|j|joint|theta|axis|a)_?(\d+)$")


@dataclass(frozen=True)
class Meaning:
    """Of one column.

    Attributes:
        role: configuration, load, q1 to qn, fx to mz, dx to dz, rx to rz, px to pz, distance.
        factor: from its unit to SI.
    """

    role: str
    factor: float


def meaning(header: str, unit: str = "") -> Meaning | None:
    """What a header says: `fx_N`, `Mx [N mm]`, `q1 (deg)`; None if it is none of the known names.

    Args:
        header: of the column.
        unit: given elsewhere; empty: the header must name it.

    Raises:
        TableError: if the unit is missing or of another kind.
    """
    text = header.strip()
    found = re.match(r"^(.*?)\s*[\[({<]\s*(.*?)\s*[\])}>]\s*$", text)
    name, written = (found.group(1), found.group(2)) if found else _split(text)
    role = _role(name)
    if role is None:
        return None
    kinds = ("angle", "length") if JOINT.match(role) else KINDS.get(role, ())
    if not kinds:
        return Meaning(role, 1.0)
    known = {word: factor for kind in kinds for word, factor in KIND[kind].items()}
    word = plain_unit(unit or written)
    if word not in known:
        raise TableError(
            f"column {header!r}: expected a unit of {', '.join(known)} in its header, as in "
            f"'{name}_{next(iter(known))}', or in the mapping, got {word or 'none'}"
        )
    return Meaning(role, known[word])


def is_known(header: str) -> bool:
    """Whether a cell is a header that is read, as it is or but for its unit.

    Args:
        header: of a column, or anything else.
    """
    try:
        return meaning(header) is not None
    except TableError:
        return True


def _split(text: str) -> tuple[str, str]:
    """Name and unit of `name_unit`, `name unit`, `name/unit`; a unit of two parts, N_m, too."""
    units = {word for table in KIND.values() for word in table}
    name, slash, unit = text.rpartition("/")
    if slash and plain_unit(unit) in units and _role(name) is not None:
        return name, unit
    parts = re.split(r"[_\s]+", text)
    for count in (2, 1):
        last, before = plain_unit("".join(parts[-count:])), parts[:-count]
        if len(before) > 1 and before[-1].lower() == "in":
            before = before[:-1]  # "Fx in N"
        if before and last in units and _role("_".join(before)) is not None:
            return "_".join(before), last
    return text, ""


def _role(name: str) -> str | None:
    word = name.strip().lower().replace(" ", "_").replace("-", "_")
    joint = JOINT.match(word)
    if joint:
        return f"q{int(joint.group(1))}"
    for role, names in NAMES.items():
        if word in names:
            return role
    return None
