# SPDX-License-Identifier: Apache-2.0
"""Reflectors measured by a laser tracker: a platform's pose, and the tracker's frame.

Frames: {T} tracker, {B} robot base, {P} platform. p_T = p_TP + R_TP b for a reflector at b in
platform axes; p_B = p_BT + R_BT p_T. One perturbation, everywhere: (dp, dtheta), translation added
and rotation exp([dtheta]x) R from the left, both in the axes of the frame that the pose is
expressed in. Covariances (6, 6) are those of (dp [m], dtheta [rad]).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import block_diag
from scipy.stats import chi2

from cabols_control.checks import BoolArray, FloatArray, finite_array, rotation_matrix
from cabols_control.errors import ShapeError
from cabols_control.naming import number
from cabols_control.registration.rigid_fit import (
    RegistrationError,
    gauss_newton,
    kabsch,
    require_spread,
    sees_mirror,
    step_in,
    turned,
    whitener,
)
from cabols_control.rotations import cross_matrix

__all__ = ["FrameEstimate", "MisfitError", "PoseEstimate", "RegistrationError", "in_base",
           "register_frame", "register_pose"]  # fmt: skip

LEAST_PROBABILITY = 1e-6
"""Of a chi-square; below it, points and covariances do not belong to one frame."""


class MisfitError(RegistrationError):
    """The measurements do not fit one frame.

    Attributes:
        estimate: what fits them best, to be looked at, not to be used.
    """

    def __init__(self, message: str, estimate: FrameEstimate) -> None:
        """Keep the estimate."""
        super().__init__(message)
        self.estimate = estimate


@dataclass(frozen=True, eq=False)
class PoseEstimate:
    """A pose from measured points.

    Attributes:
        position: (3,) origin of the platform, in the frame of the measured points [m].
        rotation: (3, 3) from platform axes to that frame.
        covariance: (6, 6) of (dp [m], dtheta [rad]); see the module.
        residuals: (n, 3) measured minus fitted point [m].
        chi_square: weighted sum of squares of the residuals.
        degrees_of_freedom: 3 n - 6.
        iterations: Gauss-Newton steps.
        converged: False if the limit of steps ended it; do not use such a pose.
        mirror_visible: whether a mirrored set of points would show in the chi-square; three points
            lie in one plane, and so does any set within 1 % of its size: a frame of the wrong
            hand fits them as well as the right one.
    """

    position: FloatArray
    rotation: FloatArray
    covariance: FloatArray
    residuals: FloatArray
    chi_square: float
    degrees_of_freedom: int
    iterations: int
    converged: bool
    mirror_visible: bool = False

    @property
    def probability(self) -> float:
        """Of so large a chi-square or a larger one, if points and covariances are right."""
        return float(chi2.sf(self.chi_square, self.degrees_of_freedom))


@dataclass(frozen=True, eq=False)
class FrameEstimate:
    """The tracker's frame in the robot's base.

    Attributes:
        position: (3,) p_BT, the tracker's origin in the base [m].
        rotation: (3, 3) R_BT, from tracker to base axes.
        covariance: (6, 6) of (dp [m], dtheta [rad]) in base axes.
        reflectors: (n, 3) in platform axes [m]: as given, or as found.
        reflector_covariance: (3 n, 3 n) [m^2]; zeros where they were given.
        residuals: (k, n, 3) in base axes, measured minus expected from the robot's pose [m]; NaN
            where nothing was measured.
        chi_square: weighted sum of squares of the residuals.
        degrees_of_freedom: measured coordinates minus unknowns.
        iterations: Gauss-Newton steps.
        converged: False if the limit of steps ended it; do not use such a frame.
        mirror_visible: as of a PoseEstimate, for all measured points together.
    """

    position: FloatArray
    rotation: FloatArray
    covariance: FloatArray
    reflectors: FloatArray
    reflector_covariance: FloatArray
    residuals: FloatArray
    chi_square: float
    degrees_of_freedom: int
    iterations: int
    converged: bool
    mirror_visible: bool = False

    @property
    def probability(self) -> float:
        """Of so large a chi-square or a larger one, if points and covariances are right."""
        return float(chi2.sf(self.chi_square, self.degrees_of_freedom))

    @property
    def residual_rms(self) -> float:
        """Root mean square distance of measured from expected points [m]."""
        return float(np.sqrt(np.nanmean(np.sum(self.residuals**2, axis=-1))))


def register_pose(
    reflectors: ArrayLike, measured: ArrayLike, covariances: ArrayLike
) -> PoseEstimate:
    """6-DOF pose from three or more measured reflectors, weighted by their covariances.

    Gauss-Newton on position and rotation from Kabsch's unweighted solution.

    Args:
        reflectors: (n, 3) in platform axes, n >= 3, not on one line [m].
        measured: (n, 3) the same reflectors in the tracker's frame (or any other) [m].
        covariances: (n, 3, 3) of the measured points, in the frame of the points [m^2].

    Returns:
        The pose of the platform in the frame of the measured points.

    Raises:
        ShapeError: if an argument has another shape, is not finite, or a covariance is not
            symmetric and positive definite.
        RegistrationError: if there are fewer than three points or they lie on one line.
    """
    points = finite_array("reflectors", reflectors, (None, 3))
    count = points.shape[0]
    seen = finite_array("measured", measured, (count, 3))
    weights = finite_array("covariances", covariances, (count, 3, 3))
    if count < 3:
        raise RegistrationError(f"reflectors: expected at least 3, got {count}; measure more")
    require_spread("reflectors", points)
    require_spread("measured", seen)
    white = whitener("covariances", weights)

    def linearise(state: tuple[FloatArray, FloatArray]) -> tuple[FloatArray, FloatArray]:
        position, rotation = state
        arms = points @ rotation.T
        jacobian = np.empty((count, 3, 6))
        jacobian[:, :, :3] = np.eye(3)
        jacobian[:, :, 3:] = -cross_matrix(arms)
        residual = position + arms - seen
        return (
            np.einsum("nij,nj->ni", white, residual).ravel(),
            (white @ jacobian).reshape(3 * count, 6),
        )

    fit = gauss_newton(
        kabsch(points, seen),
        linearise,
        lambda state, step: (state[0] + step[:3], turned(state[1], step[3:])),
        "reflectors: expected points that determine a pose; spread them wider",
    )
    position, rotation = fit.state
    return PoseEstimate(
        position=position,
        rotation=rotation,
        covariance=fit.covariance,
        residuals=seen - position - points @ rotation.T,
        chi_square=fit.chi_square,
        degrees_of_freedom=3 * count - 6,
        iterations=fit.iterations,
        converged=fit.converged,
        mirror_visible=sees_mirror(points),
    )


def register_frame(
    positions: ArrayLike,
    rotations: ArrayLike,
    reflectors: ArrayLike,
    measured: ArrayLike,
    covariances: ArrayLike,
    *,
    valid: ArrayLike | None = None,
    pose_covariance: ArrayLike | None = None,
    solve_reflectors: bool = False,
    least_probability: float = LEAST_PROBABILITY,
) -> FrameEstimate:
    """Tracker's frame in the robot's base from a set of the robot's poses.

    Args:
        positions: (k, 3) of the platform in the base, from the robot [m].
        rotations: (k, 3, 3) from platform to base axes, from the robot.
        reflectors: (n, 3) in platform axes, one or more [m]; nominal if they are solved for.
        measured: (k, n, 3) in the tracker's frame [m].
        covariances: (k, n, 3, 3) of the measured points, tracker's axes [m^2].
        valid: (k, n) False where a reflector was not measured at a pose (its numbers are then not
            looked at); None: all were.
        pose_covariance: (6, 6) of the robot's poses, (dp, dtheta) in base axes, independent from
            pose to pose, such as its repeatability; None: exact.
        solve_reflectors: also find where the reflectors are. Needs poses turned about at least two
            axes.
        least_probability: of the fit's chi-square; below it, the fit is refused. 0: the caller
            looks at `probability` itself.

    Returns:
        The frame with its covariance and the residuals.

    Raises:
        ShapeError: if an argument has another shape, is not finite, or a covariance is not
            symmetric and positive definite.
        RegistrationError: if the data do not determine the unknowns, or did not converge.
        MisfitError: if the measurements do not fit one frame.
    """
    points = finite_array("reflectors", reflectors, (None, 3))
    origins = finite_array("positions", positions, (None, 3))
    poses, count = origins.shape[0], points.shape[0]
    axes = finite_array("rotations", rotations, (poses, 3, 3))
    for index in range(poses):
        rotation_matrix(f"rotations, pose {number(index)}", axes[index])
    mask = _mask(valid, poses, count)
    # What was not measured may be NaN: it is replaced before the guard looks, and left out below.
    seen = finite_array(
        "measured",
        _where(mask[:, :, None], "measured", measured, (poses, count, 3), np.zeros(3)),
        (poses, count, 3),
    )
    weights = finite_array(
        "covariances",
        _where(mask[:, :, None, None], "covariances", covariances, (poses, count, 3, 3), np.eye(3)),
        (poses, count, 3, 3),
    )
    whitener("covariances", weights)
    robot = np.zeros((6, 6))
    if pose_covariance is not None:
        robot = finite_array("pose_covariance", pose_covariance, (6, 6))
        whitener("pose_covariance", robot)
    start = seen[mask]
    require_spread("measured, over all poses", start)
    unknowns = 6 + (3 * count if solve_reflectors else 0)
    if not 3 * start.shape[0] >= unknowns:
        raise RegistrationError(
            f"measured: expected at least {unknowns} coordinates for as many unknowns, got "
            f"{3 * start.shape[0]}; measure at more poses"
        )
    arms = np.einsum("kij,nj->kni", axes, points)
    State = tuple[FloatArray, FloatArray, FloatArray]

    def errors(state: State) -> FloatArray:
        position, rotation, found = state
        turned_points = np.einsum("kij,nj->kni", axes, found)
        return np.asarray(position + seen @ rotation.T - origins[:, None, :] - turned_points)

    def linearise(state: State) -> tuple[FloatArray, FloatArray]:
        _, rotation, found = state
        residuals = errors(state)
        rows, columns = [], []
        for k in range(poses):
            use = np.flatnonzero(mask[k])
            if use.size == 0:
                continue
            jacobian = np.zeros((use.size, 3, unknowns))
            jacobian[:, :, :3] = np.eye(3)
            jacobian[:, :, 3:6] = -cross_matrix(seen[k, use] @ rotation.T)
            if solve_reflectors:
                for row, n in enumerate(use):
                    jacobian[row, :, 6 + 3 * n : 9 + 3 * n] = -axes[k]
            # One stay of the robot: its pose error is common to the reflectors seen there.
            common = np.zeros((use.size, 3, 6))
            common[:, :, :3] = np.eye(3)
            common[:, :, 3:] = -cross_matrix(found[use] @ axes[k].T)
            noise = block_diag(*(rotation @ weights[k, use] @ rotation.T))
            slip = common.reshape(-1, 6)
            white = whitener(f"pose {number(k)}", noise + slip @ robot @ slip.T)
            rows.append(white @ residuals[k, use].ravel())
            columns.append(white @ jacobian.reshape(-1, unknowns))
        return np.concatenate(rows), np.vstack(columns)

    def retract(state: State, step: FloatArray) -> State:
        found = state[2] + step[6:].reshape(-1, 3) if solve_reflectors else state[2]
        return state[0] + step[:3], turned(state[1], step[3:6]), found

    fit = gauss_newton(
        (*kabsch(start, (origins[:, None, :] + arms)[mask]), points),
        linearise,
        retract,
        "poses: expected a set that determines the tracker's frame"
        + (" and the reflectors; turn the platform about two axes between them"
           if solve_reflectors else "; spread them wider"),
    )  # fmt: skip
    position, rotation, found = fit.state
    reflector_covariance = np.zeros((3 * count, 3 * count))
    if solve_reflectors:
        reflector_covariance = fit.covariance[6:, 6:]
    estimate = FrameEstimate(
        position=position,
        rotation=rotation,
        covariance=fit.covariance[:6, :6],
        reflectors=found,
        reflector_covariance=reflector_covariance,
        residuals=np.where(mask[:, :, None], errors(fit.state), np.nan),
        chi_square=fit.chi_square,
        degrees_of_freedom=3 * start.shape[0] - unknowns,
        iterations=fit.iterations,
        converged=fit.converged,
        mirror_visible=sees_mirror(start),
    )
    if not estimate.probability >= least_probability:
        raise MisfitError(
            f"measured: expected points of one frame, got a chi-square of {fit.chi_square:.3g} for "
            f"{estimate.degrees_of_freedom} degrees of freedom (p = {estimate.probability:.1g}), "
            f"{1e6 * estimate.residual_rms:.0f} um rms{step_in(estimate.residuals)}; measure "
            "again, or correct covariances and reflectors",
            estimate,
        )
    return estimate


def in_base(
    position: ArrayLike, rotation: ArrayLike, point: ArrayLike, covariance: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """A measured point (3,) [m] and its covariance (3, 3) [m^2], moved into the base.

    Args:
        position: (3,) p_BT [m].
        rotation: (3, 3) R_BT.
        point: (3,) in the tracker's frame.
        covariance: (3, 3) in the tracker's axes. The frame's own uncertainty is not added: it is
            common to all points, so it does not belong in a covariance of one.

    Raises:
        ShapeError: if an argument has another shape, is not finite or is no rotation.
    """
    turn = rotation_matrix("rotation", rotation)
    moved = finite_array("position", position, (3,)) + turn @ finite_array("point", point, (3,))
    return moved, np.asarray(turn @ finite_array("covariance", covariance, (3, 3)) @ turn.T)


def _mask(valid: ArrayLike | None, poses: int, count: int) -> BoolArray:
    if valid is None:
        return np.ones((poses, count), dtype=np.bool_)
    mask = np.asarray(valid)
    if mask.dtype != np.bool_ or mask.shape != (poses, count):
        raise ShapeError(
            f"valid: expected booleans of shape ({poses}, {count}), "
            f"got {mask.dtype} of shape {mask.shape}"
        )
    return mask


def _where(
    mask: BoolArray, name: str, value: ArrayLike, shape: tuple[int, ...], other: FloatArray
) -> FloatArray:
    array = np.asarray(value, dtype=np.float64)
    if array.shape != shape:
        raise ShapeError(f"{name}: expected shape {shape}, got {array.shape}")
    return np.where(mask, array, other)
