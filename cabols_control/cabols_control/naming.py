# SPDX-License-Identifier: Apache-2.0
"""Names of limbs, cables, joints, reflectors, configurations and loads as people read them.

People count from 1, programs from 0. These functions alone cross over: a text for people (message,
log line, figure, table, page, option) takes every such number from here, and what people type comes
back through `*_index`. ROS fields, arrays, data files and hardware channels count from 0.
"""

from __future__ import annotations

from collections.abc import Iterable

from cabols_control.errors import CabolsError

TOLD = 1000
"""Of a text that came in a message, people are told this much [characters]."""


def told(text: str, most: int = TOLD) -> str:
    """Return what is told of a text out of a message: its beginning, without control characters.

    Args:
        text: from anybody.
        most: longest that is told [characters].
    """
    short = text if len(text) <= most else f"{text[: most - 3]}..."
    return short if short.isprintable() else "".join(c if c.isprintable() else " " for c in short)


def number(index: int) -> int:
    """Return the number that people read for an index from 0."""
    return int(index) + 1


def limb_name(index: int) -> str:
    """Name a limb: `limb_name(3)` is "limb 4"."""
    return f"limb {number(index)}"


def limb_names(indices: Iterable[int]) -> str:
    """Name several limbs: "limb 4", "limbs 1 and 4", "limbs 1, 2 and 4"; "no limb" for none."""
    return _several("limb", indices)


def cable_name(index: int) -> str:
    """Name a cable; it has its limb's number."""
    return f"cable {number(index)}"


def cable_names(indices: Iterable[int]) -> str:
    """Name several cables, as limb_names does."""
    return _several("cable", indices)


def joint_name(index: int) -> str:
    """Name a joint of the robot."""
    return f"joint {number(index)}"


def joint_names(indices: Iterable[int]) -> str:
    """Name several joints, as limb_names does."""
    return _several("joint", indices)


def reflector_name(index: int) -> str:
    """Name a reflector on the platform."""
    return f"reflector {number(index)}"


def configuration_name(index: int) -> str:
    """Name a stored configuration of the robot; the first is the rig's reference pose."""
    return f"configuration {number(index)}"


def load_name(index: int) -> str:
    """Name a load of a stiffness campaign."""
    return f"load {number(index)}"


def place_name(configuration: int, reflector: int, load: int) -> str:
    """Name where in a stiffness campaign something happened.

    Args:
        configuration: index of the robot's configuration, from 0.
        reflector: index on the platform, from 0.
        load: index of the load at both, from 0.
    """
    names = (configuration_name(configuration), reflector_name(reflector), load_name(load))
    return ", ".join(names)


def limb_index(typed: str | int, limbs: int) -> int:
    """Return the index of the limb whose number a person typed.

    Args:
        typed: number from 1, as text or whole number.
        limbs: that the rig has.

    Returns:
        The index from 0.

    Raises:
        CabolsError: if there is no such limb.
    """
    return _index("limb", typed, limbs)


def configuration_index(typed: str | int, configurations: int) -> int:
    """Return the index of the configuration whose number a person typed; see limb_index.

    Args:
        typed: number from 1, as text or whole number.
        configurations: that are stored.

    Raises:
        CabolsError: if there is no such configuration.
    """
    return _index("configuration", typed, configurations)


def _several(noun: str, indices: Iterable[int]) -> str:
    numbers = [str(number(index)) for index in indices]
    if not numbers:
        return f"no {noun}"
    if len(numbers) == 1:
        return f"{noun} {numbers[0]}"
    return f"{noun}s {', '.join(numbers[:-1])} and {numbers[-1]}"


def _index(noun: str, typed: str | int, count: int) -> int:
    try:
        chosen = int(typed)
    except ValueError:
        chosen = 0
    if not 1 <= chosen <= count:
        raise CabolsError(f"{noun}: expected a number from 1 to {count}, got {typed}")
    return chosen - 1
