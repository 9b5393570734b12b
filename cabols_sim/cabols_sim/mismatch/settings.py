# SPDX-License-Identifier: Apache-2.0
"""Settings of the hidden robot, drawn by a seed: sizes as published for industrial arms."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.serial_arms.arm import SerialArm

STIFFNESS = np.array([966398.0, 731208.0, 317900.0, 13277.0, 7744.0, 2141.0])
"""Of the joints, means of the source's table 4.3 [N m/rad]."""

SCATTER = np.array([0.072, 0.045, 0.090, 0.083, 0.085, 0.114])
"""Standard deviations of that table over its ten configurations, relative."""

WAVES = 6
RATED_N, RATED_NM = 100.0, 10.0


class Variety(StrEnum):
    """How the joints' compliance differs between configurations."""

    SMOOTH = "smooth"
    """With the joints' angles: a sum of waves that are long against the workspace."""
    SCATTERED = "scattered"
    """Drawn anew at each configuration, as in table 4.3."""


@dataclass(frozen=True, eq=False)
class Settings:
    """The truth.

    Attributes:
        variety: of the compliance.
        compliance: (n,) of the joints, mean [rad/(N m)].
        amplitude: (n,) of its variation, relative.
        waves: (n, WAVES, n) numbers of waves over the joints' angles [1/rad].
        phases: (n, WAVES) [rad].
        origins: (n, 3) of each joint, with the kinematic errors [m].
        rotations: (n, 3, 3) likewise.
        tilt: (n,) compliance of each joint's bearing across its axis [rad/(N m)].
        beams: (n + 1, 6, 6) compliance of each body at its far end, body axes; the base first.
        masses: (n + 1,) of the bodies [kg].
        centres: (n + 1, 3) of mass, body axes [m].
        friction: (n,) torque [N m].
        reach: (n,) motion over which it is drawn [rad].
        sharpness: exponent of Bouc and Wen's law.
        warming_m: (3,) shift of the robot's foot when warm [m].
        growth: relative lengthening of the arm when warm.
        warm_up_s: time constant of both [s].
    """

    variety: Variety
    compliance: FloatArray
    amplitude: FloatArray
    waves: FloatArray
    phases: FloatArray
    origins: FloatArray
    rotations: FloatArray
    tilt: FloatArray
    beams: FloatArray
    masses: FloatArray
    centres: FloatArray
    friction: FloatArray
    reach: FloatArray
    sharpness: float
    warming_m: FloatArray
    growth: float
    warm_up_s: float


def draw_settings(seed: int, variety: Variety, arm: SerialArm, tool: FloatArray) -> Settings:
    """Draw a robot.

    Args:
        seed: of the generator.
        variety: of the compliance.
        arm: nominal, of six joints that turn.
        tool: (3,) of the tool's origin, axes of the last link [m].
    """
    random = np.random.default_rng([seed, 160])
    n = STIFFNESS.size
    compliance = random.uniform(0.87, 1.15, n) / STIFFNESS
    far = np.vstack([arm.origins, tool])
    waves = np.zeros((n, WAVES, n))
    for j in range(n):
        waves[j, :, j] = random.normal(0.0, 0.7, WAVES)
        for beside in {j - 1, j + 1} & set(range(n)):
            waves[j, :, beside] = random.normal(0.0, 0.35, WAVES)
    torque = _rated_torque()
    return Settings(
        variety=variety,
        compliance=compliance,
        amplitude=SCATTER.copy(),
        waves=waves,
        phases=random.uniform(0.0, 2.0 * np.pi, (n, WAVES)),
        origins=arm.origins + random.normal(0.0, 0.3e-3, (n, 3)),
        rotations=np.array([m @ _turned(random.normal(0.0, 0.3e-3, 3)) for m in arm.rotations]),
        tilt=compliance * random.uniform(0.03, 0.1, n),
        beams=_beams(random, compliance, far),
        masses=np.array([0.0, 80.0, 35.0, 30.0, 12.0, 4.0, 6.0]) * random.uniform(0.8, 1.2, n + 1),
        centres=0.5 * far + random.normal(0.0, 0.02, (n + 1, 3)),
        friction=random.uniform(0.005, 0.025, n) * torque,
        reach=random.uniform(0.05, 0.2, n) * torque * compliance,
        sharpness=float(random.uniform(1.5, 3.0)),
        warming_m=random.normal(0.0, 30e-6, 3),
        growth=11e-6 * float(random.uniform(1.0, 4.0)),
        warm_up_s=float(random.uniform(1200.0, 3600.0)),
    )


def _rated_torque() -> FloatArray:
    """(n,) torque of each joint under the rated load, about [N m]."""
    levers = np.array([0.8, 0.8, 0.6, 0.15, 0.15, 0.0])
    return levers * RATED_N + RATED_NM


def _beams(random: np.random.Generator, compliance: FloatArray, far: FloatArray) -> FloatArray:
    """Base: soil and bolts about a centre of its own. Links: beams of Euler and Bernoulli."""
    n = compliance.size
    found = np.zeros((n + 1, 6, 6))
    turn = compliance[0] * np.append(random.uniform(0.1, 0.4, 2), 0.03)
    base = np.diag(np.append(1.0 / random.uniform(3e7, 1e8, 3), turn))
    found[0] = _moved(base, random.normal(0.0, 0.1, 3))
    for j in range(n):
        end = far[j + 1]
        length = float(np.linalg.norm(end))
        if length < 0.1:
            continue
        bend = compliance[j] * random.uniform(0.03, 0.1)
        found[j + 1] = _beam(end / length, length, bend, 1.3 * bend)
    return found


def _beam(along: FloatArray, length: float, bend: float, twist: float) -> FloatArray:
    """(6, 6) compliance of the end of a beam that is held at its start.

    bend = L/EI and twist = L/GJ [rad/(N m)]: deflection L^2/3 bend by a force, L/2 bend by a
    moment; along itself a hundredth of that.
    """
    across = np.eye(3) - np.outer(along, along)
    cross = np.array([[0, -along[2], along[1]], [along[2], 0, -along[0]], [-along[1], along[0], 0]])
    matrix = np.zeros((6, 6))
    line = np.outer(along, along)
    matrix[:3, :3] = bend * length**2 / 3.0 * (across + 0.01 * line)
    matrix[3:, 3:] = bend * across + twist * line
    # A force across turns the end by r x f, half as much as a moment of the same lever would.
    matrix[3:, :3] = 0.5 * bend * length * cross
    matrix[:3, 3:] = matrix[3:, :3].T
    return matrix


def _moved(matrix: FloatArray, centre: FloatArray) -> FloatArray:
    """Compliance at a body's origin, of one that is diagonal at a centre (3,) of its own."""
    cross = np.array(
        [[0, -centre[2], centre[1]], [centre[2], 0, -centre[0]], [-centre[1], centre[0], 0]]
    )
    shift = np.eye(6)
    shift[:3, 3:] = cross
    return np.asarray(shift @ matrix @ shift.T)


def _turned(vector: FloatArray) -> FloatArray:
    """(3, 3) of a small rotation vector, second order."""
    x, y, z = vector
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    matrix, _ = np.linalg.qr(np.eye(3) + cross + 0.5 * cross @ cross)
    return np.asarray(matrix * np.sign(np.diagonal(matrix)))
