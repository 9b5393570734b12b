# SPDX-License-Identifier: Apache-2.0
"""The hidden robot under loads: homogeneous matrices, many configurations at a time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.serial_arms.arm import SerialArm
from cabols_sim.mismatch.settings import WAVES, Settings, Variety

GRAVITY = np.array([0.0, 0.0, -9.80665])
SUBSTEPS = 4
"""Of a change of load, over which friction is integrated."""

ITERATIONS = 25
ACCURACY = 1e-11


@dataclass(eq=False)
class Held:
    """Memory of the joints' friction at c configurations.

    Attributes:
        share: (c, n) of the full torque, -1 to 1.
        deflection: (c, n) of the joints [rad].
        wrench: (c, 6) tool axes [N, N m].
    """

    share: FloatArray
    deflection: FloatArray
    wrench: FloatArray


class HiddenRobot:
    """A robot of drawn settings with a tool.

    Attributes:
        settings: the truth.
    """

    def __init__(self, settings: Settings, arm: SerialArm, tool: FloatArray) -> None:
        """Take a drawn robot.

        Args:
            settings: the truth.
            arm: nominal, for axes and flange.
            tool: (3,) of the tool's origin, flange axes [m].
        """
        self.settings = settings
        self._axes = arm.axes
        self._before = [
            _placed(r, p) for r, p in zip(settings.rotations, settings.origins, strict=True)
        ]
        self._tip = _placed(arm.flange_rotation, arm.flange_position) @ _placed(np.eye(3), tool)

    def factor(self, joints: FloatArray, seed: int) -> FloatArray:
        """(c, n) factor on the joints' compliance.

        Args:
            joints: (c, n) configurations [rad].
            seed: of the scatter.
        """
        truth = self.settings
        if truth.variety is Variety.SCATTERED:
            random = np.random.default_rng([seed, 161])
            return np.asarray(1.0 + truth.amplitude * random.normal(size=joints.shape))
        waves = np.cos(np.einsum("jmi,ci->cjm", truth.waves, joints) + truth.phases)
        return np.asarray(np.exp(truth.amplitude * np.sqrt(2.0 / WAVES) * waves.sum(axis=2)))

    def rest(self, joints: FloatArray, factor: FloatArray) -> tuple[FloatArray, Held]:
        """(c, 4, 4) pose of the unloaded tool under gravity, and relaxed friction.

        Args:
            joints: (c, n) by the encoders [rad].
            factor: (c, n) on the compliance.
        """
        nothing = np.zeros(joints.shape)
        held = Held(nothing, nothing, np.zeros((joints.shape[0], 6)))
        pose, deflection = self._settle(joints, held.wrench, factor, None, nothing)
        return pose, Held(nothing, deflection, held.wrench)

    def load(
        self, joints: FloatArray, wrench: FloatArray, factor: FloatArray, held: Held
    ) -> tuple[FloatArray, Held]:
        """(c, 4, 4) pose of the tool after a straight change to wrenches (c, 6), and the memory.

        Args:
            joints: (c, n) by the encoders [rad].
            wrench: (c, 6) on the tool at its origin, tool axes [N, N m].
            factor: (c, n) on the compliance.
            held: memory before.
        """
        pose = np.empty(0)
        begin = held.wrench
        for step in range(1, SUBSTEPS + 1):
            now = begin + (wrench - begin) * step / SUBSTEPS
            pose, deflection = self._settle(joints, now, factor, held, held.deflection)
            share = self._share(held, deflection)
            held = Held(share, deflection, now)
        return pose, held

    def _share(self, held: Held, deflection: FloatArray) -> FloatArray:
        """Bouc and Wen: ds/dx = (1 - |s|^p (1 + sign(s dx)) / 2) / reach, in five parts."""
        truth, share = self.settings, held.share
        part = (deflection - held.deflection) / truth.reach / 5.0
        for _ in range(5):
            against = 0.5 * (1.0 + np.sign(share * part))
            share = share + part * (1.0 - np.abs(share) ** truth.sharpness * against)
            share = np.clip(share, -1.0, 1.0)
        return share

    def _settle(
        self,
        joints: FloatArray,
        wrench: FloatArray,
        factor: FloatArray,
        held: Held | None,
        deflection: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        truth = self.settings
        count, n = joints.shape
        bodies = np.zeros((count, n + 1, 6))
        tilts = np.zeros((count, n, 3))
        pose = np.empty(0)
        for _ in range(ITERATIONS):
            pose, frames, ends = self._frames(joints + deflection, bodies, tilts)
            force = np.einsum("cij,cj->ci", pose[:, :3, :3], wrench[:, :3])
            moment = np.einsum("cij,cj->ci", pose[:, :3, :3], wrench[:, 3:])
            point = pose[:, :3, -1]
            before = deflection
            share = np.zeros((count, n)) if held is None else self._share(held, before)
            deflection = np.empty((count, n))
            for b in range(n, -1, -1):
                at_end = moment + np.cross(point - ends[b][:, :3, -1], force)
                turned = frames[b][:, :3, :3]
                local = np.concatenate(
                    [np.einsum("cji,cj->ci", turned, part) for part in (force, at_end)], axis=1
                )
                bodies[:, b] = local @ truth.beams[b].T
                # The weight of this body joins what hangs on it.
                weight = truth.masses[b] * GRAVITY
                centre = frames[b][:, :3, -1] + np.einsum("cij,j->ci", turned, truth.centres[b])
                moment = moment + np.cross(centre - point, weight)
                force = force + weight
                if b == 0:
                    break
                j = b - 1
                origin = frames[b][:, :3, -1]
                here = np.einsum("cji,cj->ci", turned, moment + np.cross(point - origin, force))
                torque = here @ self._axes[j]
                own = truth.compliance[j] * factor[:, j]
                deflection[:, j] = own * (torque - truth.friction[j] * share[:, j])
                tilts[:, j] = truth.tilt[j] * (here - np.outer(torque, self._axes[j]))
            if np.abs(deflection - before).max() < ACCURACY:
                break
        return pose, deflection

    def _frames(
        self, joints: FloatArray, bodies: FloatArray, tilts: FloatArray
    ) -> tuple[FloatArray, list[FloatArray], list[FloatArray]]:
        """Tool, start and (deflected) end of each body, (c, 4, 4) each."""
        count, n = joints.shape
        matrix = np.broadcast_to(np.eye(4), (count, 4, 4))
        frames, ends = [], []
        for b in range(n + 1):
            if b > 0:
                matrix = matrix @ _turns(self._axes[b - 1] * joints[:, b - 1, None])
                matrix = matrix @ _turns(tilts[:, b - 1])
            frames.append(matrix)
            matrix = matrix @ (self._before[b] if b < n else self._tip)
            # The motion of a body's end, in the body's axes: about the end's own point.
            turned = frames[-1][:, :3, :3]
            moved = np.zeros((count, 4, 4))
            moved[:, -1, -1] = 1.0
            rotated = turned @ _turns(bodies[:, b, 3:])[:, :3, :3] @ turned.swapaxes(1, 2)
            moved[:, :3, :3] = rotated @ matrix[:, :3, :3]
            moved[:, :3, -1] = matrix[:, :3, -1] + np.einsum("cij,cj->ci", turned, bodies[:, b, :3])
            ends.append(moved)
            matrix = moved
        return matrix, frames, ends


def _placed(rotation: FloatArray, position: FloatArray) -> FloatArray:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, -1] = rotation, position
    return matrix


def _turns(vectors: FloatArray) -> FloatArray:
    """(c, 4, 4) of rotation vectors (c, 3)."""
    angle = np.maximum(np.linalg.norm(vectors, axis=1), 1e-300)[:, None, None]
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    cross = np.moveaxis(np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]), 2, 0)
    sine, versine = np.sinc(angle / np.pi), 0.5 * np.sinc(0.5 * angle / np.pi) ** 2
    matrix = np.zeros((len(vectors), 4, 4))
    matrix[:, -1, -1] = 1.0
    matrix[:, :3, :3] = np.eye(3) + sine * cross + versine * (cross @ cross)
    return matrix
