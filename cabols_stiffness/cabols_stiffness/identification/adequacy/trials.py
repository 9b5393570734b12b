# SPDX-License-Identifier: Apache-2.0
"""Statics of a robot under what a table may have wrong as a whole: signs, units, axes, order.

A mistake is tried on the prediction, not on the data: the measured numbers and their weights stay
as they are, so that misfits of all trials are sums of the same squares. The arm is undeflected and
the motion linear in the joints' compliances.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations, permutations, product

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.naming import number
from cabols_stiffness.measurements.samples import PointSamples, Samples
from cabols_stiffness.model.robot import RobotModel
from cabols_stiffness.model.screws import point_motion, turn
from cabols_stiffness.model.verdict import Suspect

Data = PointSamples | Samples

FORCE = np.repeat([1.0, 0.0], 3)
TORQUE = 1.0 - FORCE
COMPONENTS = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")

TORQUE_UNITS = {
    "N mm": 1e-3,
    "kN m": 1e3,
    "N in (or lbf in beside lbf)": 0.0254,
    "N ft (or lbf ft beside lbf)": 0.3048,
    "N cm": 1e-2,
    "kgf m beside N": 9.80665,
    "N m beside kgf": 1.0 / 9.80665,
    "N m beside lbf": 1.0 / 4.4482216,
    "kgf mm": 9.80665e-3,
}
"""Units of a torque beside forces in N: factors to N m. A factor of both is a factor of the
stiffness, which no misfit shows; see PLAUSIBLE in judge.py."""

LENGTH_UNITS = {
    "mm": 1e-3,
    "km, or m read as mm": 1e3,
    "um": 1e-6,
    "inches": 0.0254,
    "inches, read as mm": 25.4,
    "mm, read as inches": 1.0 / 25.4,
    "cm": 1e-2,
    "cm, read as mm": 10.0,
    "mm, read as cm": 0.1,
}
ANGLE_UNITS = {
    "degrees": np.pi / 180.0,
    "mrad": 1e-3,
    "urad": 1e-6,
    "arcsec": np.pi / 648000.0,
    "rad, read as degrees": 180.0 / np.pi,
    "rad, read as mrad": 1e3,
}
"""What is multiplied to get what was read: factors to m and rad."""

MOST_REFLECTORS = 5
"""Reflectors of which pairs are tried."""


@dataclass(frozen=True, eq=False)
class Trial:
    """A mistake, and what the data should be with it.

    Attributes:
        suspect: what kind of it.
        text: for people.
        predicted: (k, m) numbers of the unloaded robot.
        columns: (k, m, n) motion for a unit of each joint's compliance.
    """

    suspect: Suspect
    text: str
    predicted: FloatArray
    columns: FloatArray


class Statics:
    """Undeflected statics of samples, with something changed."""

    def __init__(self, samples: Data, robot: RobotModel) -> None:
        """Take samples and the robot with its tool."""
        self.samples, self.robot = samples, robot
        wrench = samples.wrench
        if isinstance(samples, Samples) and samples.reference_wrench is not None:
            wrench = wrench - samples.reference_wrench
        points = isinstance(samples, PointSamples)
        turned = samples.wrench_turned
        self.given_in_tool = points
        if turned is not None and turned.size and turned.all():
            # As it was given, so that a wrong joint or axis is tried on what was measured.
            rotation = robot.posture(samples.joints).rotation
            wrench = turn(rotation if points else rotation.swapaxes(1, 2), wrench)
            self.given_in_tool = not points
        self.wrench = wrench

    def right(self) -> Trial:
        """Nothing wrong."""
        return Trial(Suspect.NOISE, "", *self._with())

    def trials(self) -> Iterator[Trial]:
        """Every mistake that is looked for."""
        yield from self._of_wrench()
        yield from self._of_motion()
        yield from self._of_joints()

    def _with(
        self,
        joints: FloatArray | None = None,
        wrench: FloatArray | None = None,
        *,
        elsewhere: bool = False,
        about_base: bool = False,
        offset: FloatArray | None = None,
    ) -> tuple[FloatArray, FloatArray]:
        """Prediction and columns.

        elsewhere: the wrench is in the other of base and tool axes; about_base: its torque is about
        the base's origin, not about the tool's.
        """
        samples = self.samples
        posture = self.robot.posture(samples.joints if joints is None else joints)
        load = self.wrench if wrench is None else wrench
        if self.given_in_tool is not elsewhere:
            load = turn(posture.rotation, load)
        if about_base:
            load = load.copy()
            load[:, 3:] -= np.cross(posture.position, load[:, :3])
        if isinstance(samples, PointSamples):
            place = samples.offset if offset is None else offset
            arm = np.einsum("kij,kj->ki", posture.rotation, place)
            predicted, motion = posture.position + arm, point_motion(arm) @ posture.jacobian
        else:
            predicted, motion = np.zeros_like(samples.deflection), posture.jacobian
        return predicted, motion * posture.torque(load)[:, None, :]

    def _of_wrench(self) -> Iterator[Trial]:
        signs = (("wrench", np.ones(6)), ("forces", FORCE), ("torques", TORQUE))
        for name, which in signs:
            text = f"the sign of the {name} seems wrong"
            yield self._scaled(Suspect.SIGN, text, 1.0 - 2.0 * which)
        for i, name in enumerate(COMPONENTS):
            text = f"the sign of {name} seems wrong"
            yield self._scaled(Suspect.SIGN, text, 1.0 - 2.0 * (np.arange(6) == i))
        for unit, factor in TORQUE_UNITS.items():
            yield self._scaled(
                Suspect.UNIT, f"torques seem to be in {unit}", FORCE + factor * TORQUE
            )
        for unit, factor in (("kN", 1e3), ("mN", 1e-3)):
            yield self._scaled(
                Suspect.UNIT, f"forces seem to be in {unit}", factor * FORCE + TORQUE
            )
        for matrix, text in _axes():
            turned = self.wrench @ np.kron(np.eye(2), matrix).T
            yield Trial(
                Suspect.AXES, f"the wrench's axes seem to be {text}", *self._with(wrench=turned)
            )
        swapped = np.roll(self.wrench, 3, axis=1)
        yield Trial(
            Suspect.AXES, "forces and torques seem to be exchanged", *self._with(wrench=swapped)
        )
        stated, other = ("tool", "base") if self.given_in_tool else ("base", "tool")
        text = f"the wrench seems to be in the {other}'s axes, not in the {stated}'s"
        yield Trial(Suspect.AXES, text, *self._with(elsewhere=True))
        text = "the torques seem to be about the base's origin, not about the tool's"
        yield Trial(Suspect.WRENCH_POINT, text, *self._with(about_base=True))
        if isinstance(self.samples, Samples):
            for rows, where in ((1, "after"), (-1, "before")):
                text = f"each load seems to stand in the row {where} its deflection"
                shifted = np.roll(self.wrench, -rows, axis=0)
                yield Trial(Suspect.ROWS, text, *self._with(wrench=shifted))

    def _scaled(self, suspect: Suspect, text: str, factor: FloatArray) -> Trial:
        return Trial(suspect, text, *self._with(wrench=self.wrench * factor))

    def _of_motion(self) -> Iterator[Trial]:
        predicted, columns = self._with()
        points = isinstance(self.samples, PointSamples)
        yield from self._of_reflectors()
        for unit, factor in LENGTH_UNITS.items():
            text = f"positions seem to be in {unit}"
            if isinstance(self.samples, PointSamples):
                here, moved = self._with(offset=factor * self.samples.offset)
                yield Trial(Suspect.UNIT, text, here / factor, moved / factor)
            else:
                scale = np.repeat([1.0 / factor, 1.0], 3)
                yield Trial(Suspect.UNIT, text, predicted, columns * scale[:, None])
        if not points:
            for unit, factor in ANGLE_UNITS.items():
                scale = np.repeat([1.0, 1.0 / factor], 3)
                text = f"rotations seem to be in {unit}"
                yield Trial(Suspect.UNIT, text, predicted, columns * scale[:, None])
            scale = np.repeat([1.0, -1.0], 3)
            text = "the sign of the rotations seems wrong"
            yield Trial(Suspect.SIGN, text, predicted, columns * scale[:, None])
            text = "the deflections seem to be in the tool's axes, not in the base's"
            into_tool = self.robot.posture(self.samples.joints).rotation.swapaxes(1, 2)
            yield Trial(Suspect.AXES, text, predicted, _blockwise(into_tool, columns))
        for matrix, text in _axes():
            back = matrix.T if points else np.kron(np.eye(2), matrix.T)
            yield Trial(
                Suspect.AXES,
                f"the tracker's axes seem to be {text} in the robot's base",
                predicted @ back.T,
                back @ columns,
            )

    def _of_reflectors(self) -> Iterator[Trial]:
        """Pairs of reflectors exchanged, of the first few."""
        if not isinstance(self.samples, PointSamples):
            return
        reflector, offset = self.samples.reflector, self.samples.offset
        for a, b in combinations(np.unique(reflector)[:MOST_REFLECTORS].tolist(), 2):
            first, second = reflector == a, reflector == b
            changed = offset.copy()
            changed[first], changed[second] = offset[second][0], offset[first][0]
            text = f"reflectors {number(a)} and {number(b)} seem to be exchanged"
            yield Trial(Suspect.REFLECTORS, text, *self._with(offset=changed))

    def _of_joints(self) -> Iterator[Trial]:
        q, robot = self.samples.joints, self.robot
        turns = ~robot.slides
        for text, factor in (
            ("joints seem to be in degrees", np.pi / 180.0),
            ("joints seem to be in radians, read as degrees", 180.0 / np.pi),
        ):
            changed = self._with(np.where(turns, factor * q, q))
            yield Trial(Suspect.UNIT, text, *changed)
        for j, name in enumerate(robot.joint_names):
            turned = q.copy()
            turned[:, j] *= -1.0
            yield Trial(Suspect.SIGN, f"the sign of {name} seems wrong", *self._with(turned))
            if robot.slides[j]:
                moved = np.where(np.arange(robot.n) == j, 1e-3 * q, q)
                yield Trial(Suspect.UNIT, f"{name} seems to be in mm", *self._with(moved))
                continue
            for degrees in (90.0, -90.0, 180.0):
                shifted = q.copy()
                shifted[:, j] += np.radians(degrees)
                text = f"the zero of {name} seems to be {degrees:g} deg off"
                yield Trial(Suspect.JOINT_ZERO, text, *self._with(shifted))
        for i, j in combinations(range(robot.n), 2):
            order = np.arange(robot.n)
            order[[i, j]] = j, i
            text = f"{robot.joint_names[i]} and {robot.joint_names[j]} seem to be exchanged"
            yield Trial(Suspect.JOINT_ORDER, text, *self._with(q[:, order]))
        text = "the joints seem to be in the reverse order"
        yield Trial(Suspect.JOINT_ORDER, text, *self._with(q[:, ::-1]))


def _blockwise(rotation: FloatArray, columns: FloatArray) -> FloatArray:
    """Translations and rotations (k, 6, n), each turned by (k, 3, 3)."""
    return np.concatenate([rotation @ columns[:, :3], rotation @ columns[:, 3:]], axis=1)


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
