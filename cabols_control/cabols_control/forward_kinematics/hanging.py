# SPDX-License-Identifier: Apache-2.0
"""Where a platform hangs whose cables pull like springs: the rest of its weight and their lengths.

A cable whose slack length is r pulls T = (l - r) / c once it is longer, so that the platform hangs
where A T + w = 0, the least of the energy sum((l - r)^2 / 2 c) - w . x. Lengths and pulls follow
from it: no tension is measured. Newton on the energy, damped where it has to be; that the pose is a
least, and how stiff it is held, its second derivative says.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cabols_control.cable_kernels import cable_lengths_into, structure_matrix_into
from cabols_control.checks import FloatArray, finite_array, in_range
from cabols_control.compiling import njit
from cabols_control.forward_kinematics.iteration import solve_factored, turned
from cabols_control.geometry import RigGeometry
from cabols_control.limb_springs import LimbSprings
from cabols_control.rotations import angle_between

from .pose import PoseFinder, PoseRegion, PoseState

GRAVITY_M_S2 = 9.80665
MOST_STEPS = 30
SMALL_N, SMALL_NM = 1e-6, 1e-7
"""Rest of force and torque that counts as balance."""
DIFFERENCE = 1e-6
"""Step of the second derivative's differences [m, rad]."""
ARM_M = 0.15
"""Length at which an angle counts as a distance."""
LEAST_STIFFNESS = 50.0
"""Below this a pose does not count as held, along any direction [N/m]."""


@njit(cache=True)
def _forces(
    cables: FloatArray,
    compliance: tuple[FloatArray, FloatArray],
    body: tuple[FloatArray, FloatArray],
    rest: FloatArray,
    pose: tuple[FloatArray, FloatArray],
    work: tuple[FloatArray, FloatArray],
    tension: FloatArray,
    force: FloatArray,
) -> float:
    """Fill (n,) tensions and the (6,) wrench on the platform, weight included; its energy [J]."""
    position, rotation = pose
    length, matrix = work
    pull, centre = body
    cable_lengths_into(cables, position, rotation, length)
    structure_matrix_into(cables, position, rotation, matrix)
    arm = rotation @ centre
    energy = -float(pull @ (position + arm))
    force[:3], force[3:] = pull, np.cross(arm, pull)
    for i in range(rest.shape[0]):
        stretch = length[i] - rest[i]
        soft = compliance[0][i] + compliance[1][i] * length[i]
        tension[i] = 0.0
        # Written so that a cable without length is passed on.
        if not stretch <= 0.0:
            tension[i] = stretch / soft
            energy += 0.5 * stretch * tension[i]
            for k in range(6):
                force[k] += matrix[k, i] * tension[i]
    return energy


@njit(cache=True)
def _moved(
    pose: tuple[FloatArray, FloatArray],
    step: FloatArray,
    moved: tuple[FloatArray, FloatArray],
) -> None:
    for k in range(3):
        moved[0][k] = pose[0][k] + step[k]
    turn = step[3:]
    turned(pose[1], turn[0], turn[1], turn[2], moved[1])


@njit(cache=True)
def _stiffness(
    cables: FloatArray,
    compliance: tuple[FloatArray, FloatArray],
    body: tuple[FloatArray, FloatArray],
    rest: FloatArray,
    pose: tuple[FloatArray, FloatArray],
    work: tuple[FloatArray, FloatArray],
    stiffness: FloatArray,
) -> None:
    """Fill (6, 6) how the wrench falls along motions, by differences; symmetric."""
    trial = (np.empty(3), np.empty((3, 3)))
    ahead, behind, step = np.empty(6), np.empty(6), np.zeros(6)
    tension = np.empty(rest.shape[0])
    for k in range(6):
        step[k] = DIFFERENCE
        _moved(pose, step, trial)
        _forces(cables, compliance, body, rest, trial, work, tension, ahead)
        step[k] = -DIFFERENCE
        _moved(pose, step, trial)
        _forces(cables, compliance, body, rest, trial, work, tension, behind)
        step[k] = 0.0
        for j in range(6):
            stiffness[j, k] = (behind[j] - ahead[j]) / (2.0 * DIFFERENCE)
    for j in range(6):
        for k in range(j):
            stiffness[j, k] = stiffness[k, j] = 0.5 * (stiffness[j, k] + stiffness[k, j])


@njit(cache=True)
def _size(force: FloatArray) -> float:
    return float(force[:3] @ force[:3] + force[3:] @ force[3:] / ARM_M**2)


@njit(cache=True)
def _solved(matrix: FloatArray, damping: float, force: FloatArray, step: FloatArray) -> bool:
    """Fill (6,) step of (matrix + damping) step = force by Cholesky; False: not positive."""
    factor = np.zeros((6, 6))
    for j in range(6):
        for k in range(j + 1):
            value = matrix[j, k]
            if j == k:
                value += damping if j < 3 else damping * ARM_M * ARM_M
            for i in range(k):
                value -= factor[j, i] * factor[k, i]
            if j == k:
                # Written so that NaN is refused.
                if not value > 1e-9:
                    return False
                factor[j, j] = 1.0 / np.sqrt(value)
            else:
                factor[j, k] = value * factor[k, k]
    step[:] = force
    solve_factored(6, factor, step)
    return True


@njit(cache=True)
def hang_into(
    cables: FloatArray,
    compliance: tuple[FloatArray, FloatArray],
    body: tuple[FloatArray, FloatArray],
    rest: FloatArray,
    pose: tuple[FloatArray, FloatArray],
    tension: FloatArray,
    stiffness: FloatArray,
) -> bool:
    """Let the platform hang.

    Args:
        cables: (n,) records of CABLE.
        compliance: (n,) of all but the cables' lengths [m/N], (n,) of a metre of them [1/N].
        body: (3,) weight, base axes [N]; (3,) centre of mass, platform axes [m].
        rest: (n,) lengths of the slack cables [m].
        pose: (3,) [m] and (3, 3); start, then where it hangs.
        tension: (n,) filled [N].
        stiffness: (6, 6) of force [N] and torque [N m] on motion [m, rad], base axes; filled.

    Returns:
        Whether the forces balance there.
    """
    work = (np.empty(rest.shape[0]), np.empty((6, rest.shape[0])))
    trial = (np.empty(3), np.empty((3, 3)))
    force, other = np.empty(6), np.empty(6)
    step = np.zeros(6)
    energy = _forces(cables, compliance, body, rest, pose, work, tension, force)
    damping = 0.0
    for _ in range(MOST_STEPS):
        if not np.isfinite(energy):
            return False
        balanced = True
        for k in range(6):
            balanced &= abs(force[k]) <= (SMALL_N if k < 3 else SMALL_NM)
        _stiffness(cables, compliance, body, rest, pose, work, stiffness)
        if balanced:
            return True
        accepted = False
        while not accepted:
            size = np.inf
            if _solved(stiffness, damping, force, step):
                size = float(np.sqrt(step[:3] @ step[:3] + ARM_M**2 * (step[3:] @ step[3:])))
            if size < 0.2:
                _moved(pose, step, trial)
                found = _forces(cables, compliance, body, rest, trial, work, tension, other)
                # Near the least, differences of the energy are below its last digits; where k_e
                # changes with the length, the forces are its derivative to 0.1 N only.
                if found < energy or _size(other) < _size(force):
                    pose[0][:] = trial[0]
                    pose[1][:] = trial[1]
                    energy, accepted = found, True
                    force[:] = other
                    damping = 0.1 * damping if damping > 1.0 else 0.0
                    continue
            damping = max(4.0 * damping, 100.0)
            if damping > 1e9:
                return False
    return False


@dataclass(frozen=True, eq=False)
class Hang:
    """Where a platform hangs.

    Attributes:
        found: whether its forces balance, at a pose that is held along all directions.
        position: (3,) of its origin, base frame [m].
        rotation: (3, 3) from platform to base axes.
        tension: (n,) of its cables [N].
        stiffness: (6, 6) of force [N] and torque [N m] on motion [m, rad], base axes.
        held: least stiffness along any direction, angles as distances at ARM_M [N/m].
    """

    found: bool
    position: FloatArray
    rotation: FloatArray
    tension: FloatArray
    stiffness: FloatArray
    held: float


class HangingPlatform:
    """Finds where a platform hangs, and shows that no other pose nearby has its lengths."""

    def __init__(
        self, geometry: RigGeometry, springs: LimbSprings, mass: float, centre: FloatArray
    ) -> None:
        """Prepare a rig.

        Args:
            geometry: of n cables.
            springs: of its limbs.
            mass: that hangs on the cables [kg].
            centre: (3,) of it, platform axes [m].

        Raises:
            ShapeError: if the centre is not three numbers.
            OutOfRangeError: if there is no mass.
        """
        in_range("mass", mass, 1e-6, 1e6)
        self._geometry, self._cables = geometry, geometry.records()
        varies = np.asarray(springs.per_metre) > 0.0
        fixed = np.where(varies, springs.fixed, 1.0 / springs.nominal)
        self._compliance = (fixed, np.where(varies, springs.per_metre, 0.0))
        pull = np.array([0.0, 0.0, -mass * GRAVITY_M_S2])
        self._body = (pull, np.array(finite_array("centre", centre, (3,))))
        self._finder: PoseFinder | None = None

    @property
    def weight(self) -> float:
        """Of what hangs on the cables [N]."""
        return float(np.linalg.norm(self._body[0]))

    def weight_at(self, rotation: FloatArray) -> FloatArray:
        """(6,) about the platform's origin, base axes [N, N m].

        Args:
            rotation: (3, 3) from platform to base axes.
        """
        pull, centre = self._body
        return np.concatenate([pull, np.cross(rotation @ centre, pull)])

    def hang(self, rest: FloatArray, position: FloatArray, rotation: FloatArray) -> Hang:
        """Find where it hangs, from a pose near it.

        Args:
            rest: (n,) lengths of the slack cables [m].
            position: (3,) to begin at, base frame [m].
            rotation: (3, 3) likewise, from platform to base axes.
        """
        n = self._cables.size
        pose = (np.array(position, dtype=np.float64), np.array(rotation, order="C"))
        tension, stiffness = np.zeros(n), np.zeros((6, 6))
        given: FloatArray = np.asarray(rest, dtype=np.float64).copy()
        found = bool(
            np.isfinite(given).all()
            and hang_into(
                self._cables, self._compliance, self._body, given, pose, tension, stiffness
            )
        )
        held = -np.inf
        if found:
            scale = np.array([1.0, 1.0, 1.0, ARM_M, ARM_M, ARM_M])
            held = float(np.linalg.eigvalsh(stiffness / np.outer(scale, scale))[0])
        return Hang(found and held >= LEAST_STIFFNESS, *pose, tension, stiffness, held)

    def stretched(self, rest: FloatArray, hang: Hang) -> FloatArray:
        """(n,) lengths of the cables under their tensions [m].

        Args:
            rest: (n,) lengths of the slack cables [m].
            hang: with the tensions.
        """
        length = np.empty(rest.size)
        cable_lengths_into(self._cables, hang.position, hang.rotation, length)
        return np.where(hang.tension > 0.0, length, rest)

    def certified(
        self,
        hang: Hang,
        lengths: FloatArray,
        length_std: float,
        half_width: float,
        largest_turn: float,
    ) -> PoseState:
        """Say what forward kinematics by the stretched lengths knows of a pose's neighbourhood.

        Args:
            hang: pose in the middle of the region.
            lengths: (n,) of the cables [m].
            length_std: standard deviation of their errors [m].
            half_width: of the region, along each base axis [m].
            largest_turn: of it [rad].

        Returns:
            KNOWN: it is the only pose of the region with these lengths; NOT_SHOWN where one
            was found elsewhere.
        """
        region = PoseRegion(hang.position, hang.rotation, np.full(3, half_width), largest_turn)
        if self._finder is None:
            self._finder = PoseFinder(self._geometry, length_std, region)
        self._finder.look_in(region)
        found = self._finder.find(lengths)
        if found.state is not PoseState.KNOWN:
            return found.state
        away = float(np.linalg.norm(found.position - hang.position))
        turn = angle_between(found.rotation, hang.rotation)
        same = away <= 10.0 * length_std and turn <= 10.0 * length_std / ARM_M
        return PoseState.KNOWN if same else PoseState.NOT_SHOWN
