# SPDX-License-Identifier: Apache-2.0
"""Judgement of an identification: whether its model explains the data, and what is wrong if not."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from cabols_control.checks import FloatArray


class Grade(StrEnum):
    """How far an identification can be trusted."""

    GOOD = "good"
    """The model explains the data to within the stated noise."""
    SCATTERED = "scattered"
    """Configurations differ; intervals and predictions hold the scatter (random effects)."""
    DOUBTFUL = "doubtful"
    """The model does not explain the data: stiffness values are not to be used."""
    HOPELESS = "hopeless"
    """The data contradict the model altogether: a sign, unit, frame or joint order is wrong."""


class Suspect(StrEnum):
    """What may be wrong with the data or with the model."""

    NOISE = "noise"
    CONFIGURATIONS = "configurations"
    SCATTER = "scatter"
    TOOL_POINT = "tool_point"
    WRENCH_POINT = "wrench_point"
    BASE_FRAME = "base_frame"
    WRENCH_FRAME = "wrench_frame"
    WRENCH_GAIN = "wrench_gain"
    WRENCH_BIAS = "wrench_bias"
    WEIGHT = "weight"
    COUPLING = "coupling"
    BASE = "base"
    BEARINGS = "bearings"
    CUBIC = "cubic"
    PLAY = "play"
    VARYING = "varying"
    CREEP = "creep"
    FRICTION = "friction"
    MAGNITUDE = "magnitude"
    SIGN = "sign"
    UNIT = "unit"
    AXES = "axes"
    JOINT_ORDER = "joint_order"
    JOINT_ZERO = "joint_zero"
    ROWS = "rows"
    REFLECTORS = "reflectors"
    OUTLIERS = "outliers"


@dataclass(frozen=True)
class Finding:
    """One suspicion that the data confirm.

    Attributes:
        suspect: what.
        text: for people.
        improvement: share of the misfit (chi-square) that it explains, 0 to 1.
        probability: of as much without it.
        shift: largest change of a joint's stiffness if it is taken into account, relative.
        grave: whether the stiffness values are not to be used because of it.
    """

    suspect: Suspect
    text: str
    improvement: float
    probability: float
    shift: float
    grave: bool


@dataclass(frozen=True, eq=False)
class Verdict:
    """Judgement of one identification.

    Attributes:
        grade: the sum of it.
        chi_square: of the normalised residuals, for the stated noise.
        degrees_of_freedom: of it.
        probability: of so large a chi-square by noise alone.
        explained: share of the measured motion's weighted sum of squares that the model explains.
        explained_by_axis: (m,) the same for each measured axis: x, y, z, then rotations.
        share_of_joint: (n,) weight of each joint in the explained motion; they sum to about 1.
        cochran_q: of the configurations' own stiffness about the pooled one.
        cochran_freedom: degrees of freedom of it; 0 with a single configuration.
        cochran_probability: of so large a Q by noise alone.
        scatter: (n,) standard deviation of the stiffness from configuration to configuration,
            relative; zero where none was found.
        leave_one_out: (c, n) relative change of the stiffness without each configuration.
        findings: gravest first.
        missing: rows that were left out because they hold no number.
        repeated: rows that were left out because they repeat another one.
    """

    grade: Grade
    chi_square: float
    degrees_of_freedom: int
    probability: float
    explained: float
    explained_by_axis: FloatArray
    share_of_joint: FloatArray
    cochran_q: float
    cochran_freedom: int
    cochran_probability: float
    scatter: FloatArray
    leave_one_out: FloatArray
    findings: tuple[Finding, ...]
    missing: int = 0
    repeated: int = 0

    @property
    def adequate(self) -> bool:
        """Whether stiffness values and predictions may be used."""
        return self.grade in (Grade.GOOD, Grade.SCATTERED)

    @property
    def reason(self) -> str:
        """First grave finding for people, or that there is none."""
        grave = [finding.text for finding in self.findings if finding.grave]
        return grave[0] if grave else "the model explains the data"
