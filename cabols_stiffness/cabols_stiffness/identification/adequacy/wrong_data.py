"""What a table may have wrong as a whole: a sign, a unit, axes, the order of joints.

Each possibility is tried on the data: they are changed, compliances (none negative) are fitted to
the undeflected arm's statics, and the misfit is compared with that of the data as they are.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations, permutations, product

import numpy as np
from scipy.optimize import nnls

from cabols_control.checks import FloatArray
from cabols_stiffness.identification.observations import Observations, whiten
from cabols_stiffness.measurements.samples import PointSamples, Samples
from cabols_stiffness.model.balance import Law
from cabols_stiffness.model.robot import RobotModel
from cabols_stiffness.model.verdict import Finding, Suspect

LEAST_GAIN = 0.7
"""Share of the misfit that a change must remove to be named."""

MOST = 3
"""Changes that are named, best first."""

Data = PointSamples | Samples
Trial = tuple[Suspect, str, Data]


def wrong_data(samples: Data, robot: RobotModel) -> list[Finding]:
    """Changes of the data that explain most of the misfit, best first.

    Args:
        samples: that contradict the model.
        robot: with its tool.
    """
    before = _misfit(samples, robot)
    tried = [(_misfit(changed, robot), suspect, text) for suspect, text, changed in
             _trials(samples, robot)]  # fmt: skip
    tried.sort(key=lambda one: one[0])
    return [
        Finding(
            suspect=suspect,
            text=f"{text}: so changed, the data lose {100.0 * (1.0 - misfit / before):.1f} % of "
            "their misfit",
            improvement=1.0 - misfit / before,
            probability=0.0,
            shift=float("inf"),
            grave=True,
        )
        for misfit, suspect, text in tried[:MOST]
        if misfit < (1.0 - LEAST_GAIN) * before and misfit < 4.0 * tried[0][0]
    ]


def _misfit(samples: Data, robot: RobotModel) -> float:
    """Share of the motion's weighted sum of squares that rigid statics leave."""
    n = robot.n
    line = Observations(samples, robot).linearise(Law(np.full(n, 1e12), np.zeros(n)))
    torque = line.balance.posture.torque(line.balance.wrench)
    rows = whiten(line, line.motion * torque[:, None, :], samples, np.ones(len(samples)))
    matrix, target = rows.columns.reshape(-1, n), rows.residual.ravel()
    length = np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
    _, left = nnls(matrix / length, target)
    return float((left / max(float(np.linalg.norm(target)), 1e-300)) ** 2)


def _trials(samples: Data, robot: RobotModel) -> Iterator[Trial]:
    yield from _of_wrench(samples)
    yield from _of_motion(samples)
    yield from _of_joints(samples, robot)


def _of_wrench(samples: Data) -> Iterator[Trial]:
    whole, force, torque = np.ones(6), np.repeat([1.0, 0.0], 3), np.repeat([0.0, 1.0], 3)
    signs = (("wrench", whole), ("forces", force), ("torques", torque))
    for name, which in signs:
        text = f"the sign of the {name} seems wrong"
        yield Suspect.SIGN, text, _scaled(samples, 1.0 - 2.0 * which)
    units = (
        ("torques seem to be in N mm", 1.0 - torque + 1e-3 * torque),
        ("torques seem to be in kN m", 1.0 - torque + 1e3 * torque),
        ("forces seem to be in kN", 1.0 - force + 1e3 * force),
        ("forces seem to be in mN", 1.0 - force + 1e-3 * force),
    )
    for text, factor in units:
        yield Suspect.UNIT, text, _scaled(samples, factor)
    for matrix, text in _axes():
        both = np.kron(np.eye(2), matrix)
        covariance = both @ samples.wrench_covariance @ both.T
        changed = replace(samples, wrench=samples.wrench @ both.T, wrench_covariance=covariance)
        yield Suspect.AXES, f"the wrench's axes seem to be {text}", changed


def _of_motion(samples: Data) -> Iterator[Trial]:
    for factor, unit in ((1e-3, "mm"), (1e3, "km"), (1e-6, "um")):
        yield Suspect.UNIT, f"positions seem to be in {unit}", _resized(samples, factor)
    if isinstance(samples, Samples):
        half = np.repeat([1.0, np.pi / 180.0], 3)
        covariance = samples.deflection_covariance * np.outer(half, half)
        degrees = replace(
            samples, deflection=samples.deflection * half, deflection_covariance=covariance
        )
        yield Suspect.UNIT, "rotations seem to be in degrees", degrees
    for matrix, text in _axes():
        if isinstance(samples, PointSamples):
            covariance = matrix @ samples.position_covariance @ matrix.T
            position = samples.position @ matrix.T
            changed: Data = replace(samples, position=position, position_covariance=covariance)
        else:
            both = np.kron(np.eye(2), matrix)
            changed = replace(
                samples,
                deflection=samples.deflection @ both.T,
                deflection_covariance=both @ samples.deflection_covariance @ both.T,
            )
        yield Suspect.AXES, f"the tracker's axes seem to be {text} in the robot's base", changed


def _of_joints(samples: Data, robot: RobotModel) -> Iterator[Trial]:
    q = samples.joints
    yield Suspect.UNIT, "joints seem to be in degrees", replace(samples, joints=np.radians(q))
    yield (
        Suspect.UNIT,
        "joints seem to be in radians, read as degrees",
        replace(samples, joints=np.degrees(q)),
    )
    for j in range(robot.n):
        turned = q.copy()
        turned[:, j] *= -1.0
        text = f"the sign of {robot.joint_names[j]} seems wrong"
        yield Suspect.SIGN, text, replace(samples, joints=turned)
    for i, j in combinations(range(robot.n), 2):
        order = np.arange(robot.n)
        order[[i, j]] = j, i
        text = f"{robot.joint_names[i]} and {robot.joint_names[j]} seem to be exchanged"
        yield Suspect.JOINT_ORDER, text, replace(samples, joints=q[:, order])


def _scaled(samples: Data, factor: FloatArray) -> Data:
    covariance = samples.wrench_covariance * np.outer(factor, factor)
    return replace(samples, wrench=samples.wrench * factor, wrench_covariance=covariance)


def _resized(samples: Data, factor: float) -> Data:
    if isinstance(samples, PointSamples):
        return replace(
            samples,
            position=factor * samples.position,
            offset=factor * samples.offset,
            position_covariance=factor**2 * samples.position_covariance,
        )
    scale = np.repeat([factor, 1.0], 3)
    covariance = samples.deflection_covariance * np.outer(scale, scale)
    return replace(samples, deflection=samples.deflection * scale, deflection_covariance=covariance)


def _axes() -> Iterator[tuple[FloatArray, str]]:
    """Signed permutations of the axes, but the identity; mirrored ones among them."""
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            matrix = np.diag(signs)[:, list(order)]
            # Not as they are, nor all reversed: that is the wrench's sign.
            if order == (0, 1, 2) and len(set(signs)) == 1:
                continue
            names = ", ".join(_axis(row) for row in matrix)
            mirrored = "" if np.linalg.det(matrix) > 0.0 else " (mirrored)"
            yield matrix, f"({names}){mirrored}"


def _axis(row: FloatArray) -> str:
    return ("-" if row.sum() < 0.0 else "") + "xyz"[int(np.abs(row).argmax())]
