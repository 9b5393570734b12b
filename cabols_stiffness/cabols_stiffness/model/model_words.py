# SPDX-License-Identifier: Apache-2.0
"""Words for models on command lines and in files; nothing here needs numpy."""

from __future__ import annotations

from argparse import ArgumentTypeError
from enum import StrEnum

from cabols_control.errors import CabolsError

LINEAR, CUBIC, AS_PUBLISHED = "linear", "cubic", "as_published"
MODELS = (LINEAR, CUBIC, AS_PUBLISHED)

AUTO = "auto"
"""Let held-out configurations choose the rungs."""


class Rung(StrEnum):
    """What a block of parameters stands for; the ladder's rungs."""

    JOINTS = "joints"
    CUBIC = "cubic"
    COUPLING = "coupling"
    BASE = "base"
    LINKS = "links"
    VARYING = "varying"
    FRICTION = "friction"
    KINEMATICS = "kinematics"
    """Joints that are not where the URDF has them; no block, see ladder/kinematics.py."""
    GRAVITY = "gravity"
    """Weights of the links, likewise."""


def rungs_of(words: str) -> frozenset[Rung] | None:
    """Rungs that a word such as "auto" or "joints+base+friction" names; None: those that pay.

    Raises:
        CabolsError: if one is unknown.
    """
    if words == AUTO:
        return None
    try:
        return frozenset(Rung(word) for word in words.split("+"))
    except ValueError as error:
        known = "+".join(Rung)
        raise CabolsError(
            f"model: expected {', '.join(MODELS)}, {AUTO}, or some of {known} joined by +, got "
            f"{words!r}"
        ) from error


def model_word(word: str) -> str:
    """Check a command line's word for a model; empty stands for the default.

    Raises:
        ArgumentTypeError: if it is unknown.
    """
    if word and word not in MODELS:
        try:
            rungs_of(word)
        except CabolsError as error:
            raise ArgumentTypeError(str(error)) from error
    return word
