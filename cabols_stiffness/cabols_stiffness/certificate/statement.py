# SPDX-License-Identifier: Apache-2.0
"""What a certificate needs and no measurement says: who, where, with what, and how well."""

from __future__ import annotations

from dataclasses import field
from enum import StrEnum
from pathlib import Path

import numpy as np
from pydantic.dataclasses import dataclass

from cabols_control.checks import in_range
from cabols_control.configuration import STRICT, load_config
from cabols_control.errors import ConfigError


class Kind(StrEnum):
    """Systematic effects (type B), with the unit of their uncertainty."""

    FORCE_GAIN = "force_gain"
    TORQUE_GAIN = "torque_gain"
    SENSOR_AXES = "sensor_axes"
    SENSOR_POINT = "sensor_point"
    TOOL_POINT = "tool_point"
    TRACKER_AXES = "tracker_axes"
    TRACKER_SCALE = "tracker_scale"
    DRIFT = "drift"
    KINEMATICS = "kinematics"
    TEMPERATURE = "temperature"


UNITS = {
    Kind.FORCE_GAIN: "relative",
    Kind.TORQUE_GAIN: "relative",
    Kind.SENSOR_AXES: "rad",
    Kind.SENSOR_POINT: "m",
    Kind.TOOL_POINT: "m",
    Kind.TRACKER_AXES: "rad",
    Kind.TRACKER_SCALE: "relative",
    Kind.DRIFT: "m",
    Kind.KINEMATICS: "rad",
    Kind.TEMPERATURE: "relative",
}
"""Drift: of a reflector over a pass. Kinematics: of each joint's zero. Temperature: of the
stiffness over the range of temperatures."""

DIVISORS = {"normal": 1.0, "rectangular": np.sqrt(3.0), "triangular": np.sqrt(6.0)}
"""From a half width to a standard uncertainty; JCGM 100:2008, 4.3."""


@dataclass(frozen=True, config=STRICT)
class Source:
    """One systematic effect.

    Attributes:
        kind: see Kind.
        value: half width, or k standard uncertainties if normal, in the kind's unit.
        distribution: normal, rectangular or triangular.
        coverage: k, if normal.
        correlation: between its components (axes, joints), 0 to 1.
        freedom: degrees of freedom; 0: known exactly.
        evidence: certificate or experience that it rests on.
    """

    kind: Kind
    value: float
    distribution: str = "normal"
    coverage: float = 1.0
    correlation: float = 0.0
    freedom: float = 0.0
    evidence: str = ""

    def __post_init__(self) -> None:
        """Check the numbers."""
        in_range("value", self.value, 0.0, 10.0)
        in_range("coverage", self.coverage, 1.0, 4.0)
        in_range("correlation", self.correlation, 0.0, 1.0)
        in_range("freedom", self.freedom, 0.0, 1e9)
        if self.distribution not in DIVISORS:
            raise ConfigError(
                f"distribution: expected one of {', '.join(DIVISORS)}, got {self.distribution!r}"
            )

    @property
    def standard_uncertainty(self) -> float:
        """In the kind's unit."""
        return float(self.value / (DIVISORS[self.distribution] * self.coverage))


@dataclass(frozen=True, config=STRICT)
class Instrument:
    """What was measured with, or what was measured.

    Attributes:
        name: for people.
        manufacturer: of it.
        model: of it.
        serial: number.
        calibrated: date of its last calibration, YYYY-MM-DD.
        certificate: number of that calibration's certificate.
    """

    name: str
    manufacturer: str = ""
    model: str = ""
    serial: str = ""
    calibrated: str = ""
    certificate: str = ""


@dataclass(frozen=True, config=STRICT)
class Condition:
    """An influence during the measurement.

    Attributes:
        name: such as temperature.
        value: of it.
        uncertainty: of it, expanded.
        unit: of both.
    """

    name: str
    value: float
    uncertainty: float
    unit: str


@dataclass(frozen=True, config=STRICT)
class Statement:
    """Of one calibration.

    Attributes:
        number: of the certificate.
        laboratory: name of it.
        place: where it was measured.
        country: of it, two letters of ISO 3166.
        customer: name of it.
        operator: responsible person.
        begin: first day of the measurement, YYYY-MM-DD.
        end: last day.
        robot: that was measured.
        instruments: that were used.
        conditions: during the measurement.
        sources: of systematic uncertainty.
        remarks: for people.
    """

    number: str
    laboratory: str
    operator: str
    begin: str
    end: str
    robot: Instrument
    place: str = ""
    country: str = ""
    customer: str = ""
    instruments: list[Instrument] = field(default_factory=list)
    conditions: list[Condition] = field(default_factory=list)
    sources: list[Source] = field(default_factory=list)
    remarks: str = ""


def load_statement(path: str | Path) -> Statement:
    """Read a statement.

    Raises:
        ConfigError: naming the file and what is wrong with it.
    """
    return load_config(Statement, path)
