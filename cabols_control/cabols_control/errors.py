# SPDX-License-Identifier: Apache-2.0
"""Errors of wrong arguments and files: what was expected, what came, what to do."""

from __future__ import annotations


class CabolsError(ValueError):
    """Base of all errors that cabols raises on bad input."""


class UsageError(CabolsError):
    """The user named what cannot be used: a missing file, an occupied folder; exit code 2."""


class ShapeError(CabolsError):
    """An array has another shape than the function needs, or is not finite."""


class OutOfRangeError(CabolsError):
    """A number lies outside its limits (NaN does, too)."""

    def __init__(self, name: str, value: float, lower: float, upper: float) -> None:
        super().__init__(f"{name}: expected {lower:g} to {upper:g}, got {value!r}")


class ConfigError(UsageError):
    """A configuration file cannot be used; the message names the file and the key."""


class DataFileError(CabolsError):
    """A file of data can be read, but holds no such data."""


class DegenerateGeometryError(ConfigError):
    """The points of a rig cannot carry a 6-DOF wrench."""
