# SPDX-License-Identifier: Apache-2.0
"""What an identification found."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cabols_control.checks import BoolArray, FloatArray, IntArray
from cabols_stiffness.model.elastic.prediction import ElasticModel
from cabols_stiffness.model.verdict import Verdict


@dataclass(frozen=True, eq=False)
class Origin:
    """Robot and range of the data that a result is from.

    Attributes:
        robot: its name.
        joint_names: of its joints; empty: not known (a file of version 0.1).
        kinematics: hash of its kinematics, of `RobotModel`; empty likewise.
        joints: (n, 2) least and largest joint positions of the data [rad, m].
        wrench: (6,) largest absolute components of the wrench in them [N, N m].
    """

    robot: str
    joint_names: tuple[str, ...] = ()
    kinematics: str = ""
    joints: FloatArray | None = None
    wrench: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class StiffnessResult:
    """Joint stiffness with its uncertainty; NaN wherever the data cannot identify a number.

    Attributes:
        model: "linear", "cubic" or "as_published".
        stiffness: (6,) b of (4.8) [N m/rad].
        cubic: (6,) a of (4.8) [N m/rad^3]; None for the linear model.
        covariance: (6, 6) of stiffness, or (12, 12) of stiffness then cubic.
        identifiable: (6,) whether the data identify the joint's stiffness.
        cubic_identifiable: (6,) whether they identify its cubic term; all False for linear.
        interval: (6, 2) of 95 %, of stiffness [N m/rad].
        cubic_interval: (6, 2) of 95 % [N m/rad^3]; None for the linear model.
        residual_rms: root mean square of the normalised residuals; 1 if model and noise are right.
        degrees_of_freedom: numbers measured minus numbers estimated, offsets and drifts included.
        samples: that were given.
        outliers: indices of the samples left out.
        iterations: Gauss-Newton steps of the last fit.
        converged: False if the limit of steps ended it; do not use such a result.
        parameters: (12,) stiffness then cubic as the model used them, also where the data cannot
            identify them (there they are the start, for predictions only).
        parameter_covariance: (12, 12) of parameters, zero in rows that were not estimated.
        joint_range: (6,) largest deflection of each joint in the data [rad].
        friction: (6,) torque by which loading and unloading of a joint differ from its elastic
            curve, where hysteresis was detected, else 0 [N m].
        friction_deviation: (6,) its standard deviation, 0 where none was detected [N m].
        friction_reach: (6,) motion over which the friction is drawn, likewise [rad].
        verdict: on the model and the data; None: not judged, as in results of older files.
        origin: robot and range of the data; None: not known.
        elastic: the arm beyond its joints, where the ladder of models was climbed; predictions and
            commands are then its own. None: the joints are all.
    """

    model: str
    stiffness: FloatArray
    cubic: FloatArray | None
    covariance: FloatArray
    identifiable: BoolArray
    cubic_identifiable: BoolArray
    interval: FloatArray
    cubic_interval: FloatArray | None
    residual_rms: float
    degrees_of_freedom: int
    samples: int
    outliers: IntArray
    iterations: int
    converged: bool
    parameters: FloatArray
    parameter_covariance: FloatArray
    joint_range: FloatArray
    friction: FloatArray
    friction_deviation: FloatArray
    friction_reach: FloatArray
    verdict: Verdict | None = None
    origin: Origin | None = None
    elastic: ElasticModel | None = None

    @property
    def adequate(self) -> bool:
        """Whether it converged and nothing grave was found; without a verdict, only the former."""
        return self.converged and (self.verdict is None or self.verdict.adequate)

    @property
    def n(self) -> int:
        """Number of joints."""
        return int(self.stiffness.size)

    @property
    def hysteretic(self) -> BoolArray:
        """(6,) joints whose hysteresis was detected."""
        return np.asarray(self.friction != 0.0)

    @property
    def standard_deviation(self) -> FloatArray:
        """(6,) of stiffness [N m/rad]."""
        return np.asarray(np.sqrt(np.diagonal(self.covariance)[: self.n]))

    @property
    def cubic_deviation(self) -> FloatArray | None:
        """(6,) of cubic [N m/rad^3]; None for the linear model."""
        return None if self.cubic is None else np.sqrt(np.diagonal(self.covariance)[self.n :])

    @property
    def relative_deviation_max(self) -> float:
        """Largest relative standard deviation of the identifiable joints; infinite without any."""
        relative = (self.standard_deviation / np.abs(self.stiffness))[self.identifiable]
        return float(relative.max()) if relative.size else np.inf
