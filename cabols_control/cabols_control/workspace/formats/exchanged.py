# SPDX-License-Identifier: Apache-2.0
"""What is exchanged with other programs' robot files, and where text becomes numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import inf
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import defusedxml.ElementTree as Xml
import numpy as np
from defusedxml.common import DefusedXmlException

from cabols_control.checks import FloatArray
from cabols_control.errors import ConfigError, DataFileError
from cabols_control.motion import Motion

LARGEST_FILE = 20_000_000
"""Bytes of a file beyond which it is none."""


@dataclass
class ExchangedRobot:
    """A robot as another program's files give it.

    Attributes:
        position: (3,) of the platform at the reference pose, base frame [m].
        rotation: (3, 3) from platform to base axes there.
        base_points: (n, 3) base frame [m].
        platform_points: (n, 3) platform frame [m].
        motion: how the platform moves; None: as its points leave it.
        tension_min: (n,) [N], or None.
        tension_max: (n,) [N], or None.
        mass: [kg].
        centre_of_mass: (3,) platform frame [m].
        pulley_radius: (n,) [m], zeros for none.
        pulley_axes: (n, 3) unit vectors, or None.
        length_min: shortest length of a cable [m]; 0: none is given.
        length_max: longest; inf: none [m].
        notes: what the file does not say, or cannot, for people.
    """

    position: FloatArray
    rotation: FloatArray
    base_points: FloatArray
    platform_points: FloatArray
    motion: Motion | None = None
    tension_min: FloatArray | None = None
    tension_max: FloatArray | None = None
    mass: float = 0.0
    centre_of_mass: FloatArray = field(default_factory=lambda: np.zeros(3))
    pulley_radius: FloatArray = field(default_factory=lambda: np.zeros(0))
    pulley_axes: FloatArray | None = None
    length_min: float = 0.0
    length_max: float = inf
    notes: list[str] = field(default_factory=list)


def numbers(where: str, value: Any, count: int | None = None) -> FloatArray:
    """Return finite numbers from a text of words, or from a list.

    Args:
        where: file and place, for messages.
        value: text with numbers between blanks or commas, or a sequence of numbers.
        count: how many are expected; None for any.

    Raises:
        DataFileError: if they are not that.
    """
    words = value.replace(",", " ").split() if isinstance(value, str) else value
    try:
        if not isinstance(words, Sequence) or any(isinstance(word, bool) for word in words):
            raise TypeError
        found = np.array([float(word) for word in words])
    except (TypeError, ValueError) as error:
        raise DataFileError(f"{where}: expected numbers, got {value!r}") from error
    if count is not None and found.size != count:
        raise DataFileError(f"{where}: expected {count} numbers, got {found.size}: {value!r}")
    if not np.isfinite(found).all():
        raise DataFileError(f"{where}: expected finite numbers, got {value!r}")
    return found


def text_of(path: Path) -> bytes:
    """Content of a file of at most LARGEST_FILE bytes.

    Args:
        path: of the file.

    Raises:
        ConfigError: if it cannot be read.
        DataFileError: if it is larger.
    """
    try:
        text = path.read_bytes()
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    if len(text) > LARGEST_FILE:
        raise DataFileError(f"{path}: expected a model of at most 20 MB, got {len(text) / 1e6:.0f}")
    return text


def xml_tree(path: Path) -> ElementTree.Element:
    """Parse a file; entities are refused, external definitions never read.

    Args:
        path: of the file.

    Raises:
        ConfigError: if it cannot be read.
        DataFileError: if it is not XML.
    """
    text = text_of(path)
    try:
        root: ElementTree.Element = Xml.fromstring(text)
    except DefusedXmlException as error:
        raise DataFileError(f"{path}: expected a model without entities, got {error}") from error
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise DataFileError(f"{path}: expected XML, got {error}") from error
    return root


def frame_along(axis: FloatArray) -> FloatArray:
    """(3, 3) rotation whose z axis is a unit vector.

    Args:
        axis: (3,) unit vector.
    """
    side = np.eye(3)[int(np.abs(axis).argmin())]
    x = side - (side @ axis) * axis
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(axis, x), axis])
