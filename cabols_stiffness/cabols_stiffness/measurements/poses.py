# SPDX-License-Identifier: Apache-2.0
"""6-DOF deflections of the tool from three passes of the reflectors, as in the source.

For tables, figures and comparison with the source; `identify` is more accurate with the points.
"""

from __future__ import annotations

import warnings

import numpy as np

from cabols_control.checks import BoolArray, FloatArray, IntArray
from cabols_control.errors import CabolsError
from cabols_control.registration.reflectors import LEAST_PROBABILITY, register_pose
from cabols_control.registration.rigid_fit import RegistrationError
from cabols_stiffness.measurements.samples import REFERENCE, PointSamples, Samples
from cabols_stiffness.model.balance import balance
from cabols_stiffness.model.prediction import law_of
from cabols_stiffness.model.result import StiffnessResult
from cabols_stiffness.model.robot import RobotModel
from cabols_stiffness.model.screws import logarithm, turn, turning

LEAST = 3
"""Reflectors that determine a pose."""


class PoseWarning(UserWarning):
    """The points of some loads do not fit one rigid motion."""


def poses(
    points: PointSamples, robot: RobotModel, result: StiffnessResult | None = None
) -> Samples:
    """Join the passes of each load that three or more reflectors saw.

    The unloaded reference of each pass, interpolated in time, is taken from its positions; its
    noise is added to theirs, but what it makes common to the loads of a pass is not kept. The
    wrench is the mean of the passes', turned into base axes with the deflected tool.

    Args:
        points: of any number of configurations.
        robot: with the tool that the samples are about.
        result: an identification, with which the passes of a load are brought to their common mean
            wrench before they are joined: cable friction makes them differ by a percent or two,
            which is more than the tracker's noise. None: they are joined as they are.

    Returns:
        One sample for each load, in the order of configuration and of the first pass. The
        covariance of one whose points do not fit a rigid motion within their noise (a reflector
        was bumped, a pass had another load) is widened by its chi-square per degree of freedom,
        and a PoseWarning counts them.

    Raises:
        CabolsError: if a pass has no reference, or no load was seen at three reflectors.
    """
    moved, noise, rest = _against_reference(points)
    posture = robot.posture(points.joints)
    loaded = points.branch != REFERENCE
    rows, found, misfits = [], _loads(points, loaded), 0
    if result is not None:
        moved = moved + _to_common_wrench(points, robot, result, found)
    for members in found:
        if np.unique(points.reflector[members]).size < LEAST:
            continue
        first = members[0]
        unturned = posture.rotation[first]
        arms = points.offset[members] @ unturned.T
        try:
            pose = register_pose(arms, arms + moved[members], noise[members])
        except RegistrationError:
            continue
        if not pose.converged:
            continue
        fits = pose.probability >= LEAST_PROBABILITY
        misfits += not fits
        widening = 1.0 if fits else pose.chi_square / pose.degrees_of_freedom
        deflection = np.concatenate([pose.position, logarithm(pose.rotation)])
        to_base = pose.rotation @ unturned
        wrench = turn(to_base, points.wrench[members].mean(axis=0))
        covariance = points.wrench_covariance[members].mean(axis=0) / members.size
        spread = turning(to_base)
        rows.append(
            (
                points.configuration[first],
                points.load[first],
                points.branch[first],
                points.joints[members].mean(axis=0),
                wrench,
                spread @ covariance @ spread.T,
                deflection,
                widening * pose.covariance,
                turn(unturned, rest[members].mean(axis=0)),
            )
        )
    if not rows:
        raise CabolsError(
            f"points: expected loads seen at {LEAST} reflectors or more, got none; measure the "
            "same loads at the other reflectors, too"
        )
    if misfits:
        warnings.warn(
            f"points: {misfits} of {len(rows)} loads do not fit a rigid motion of the platform "
            "within their noise: were reflectors moved, or loads not the same in all passes? "
            "Their covariance is widened",
            PoseWarning,
            stacklevel=2,
        )
    return Samples(*(np.array(column) for column in zip(*rows, strict=True)))


def _to_common_wrench(
    points: PointSamples, robot: RobotModel, result: StiffnessResult, loads: list[IntArray]
) -> FloatArray:
    """(k, 3) what the mean wrench of a load would move its points more than their own did."""
    common = points.wrench.copy()
    for members in loads:
        common[members] = points.wrench[members].mean(axis=0)
    places = []
    for wrench in (common, points.wrench):
        rest = balance(robot, points.joints, wrench, law_of(result), follows=True).posture
        places.append(rest.position + np.einsum("kij,kj->ki", rest.rotation, points.offset))
    return np.asarray(places[0] - places[1])


def _loads(points: PointSamples, loaded: BoolArray) -> list[IntArray]:
    keys = np.column_stack([points.configuration, points.load, points.branch])
    order = np.lexsort((points.time, points.branch, points.load, points.configuration))
    order = order[loaded[order]]
    starts = np.flatnonzero((np.diff(keys[order], axis=0) != 0).any(axis=1)) + 1
    return list(np.split(order, starts)) if order.size else []


def _against_reference(points: PointSamples) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(k, 3) displacements, (k, 3, 3) covariances, (k, 6) reference wrenches, tool axes."""
    moved, noise = np.empty_like(points.position), np.empty_like(points.position_covariance)
    rest = np.empty_like(points.wrench)
    for group in np.unique(points.group):
        members = np.flatnonzero(points.group == group)
        references = members[points.branch[members] == REFERENCE]
        if references.size == 0:
            raise CabolsError(
                f"points: expected an unloaded reference (branch 0) in every group, got none in "
                f"group {group}"
            )
        references = references[np.argsort(points.time[references])]
        share = _interpolation(points.time[members], points.time[references])
        moved[members] = points.position[members] - share @ points.position[references]
        rest[members] = share @ points.wrench[references]
        of_references = np.einsum("ij,jab->iab", share**2, points.position_covariance[references])
        noise[members] = points.position_covariance[members] + of_references
    return moved, noise, rest


def _interpolation(time: FloatArray, references: FloatArray) -> FloatArray:
    """(k, r) weights of the references for each time: linear between, constant outside."""
    unit = np.eye(references.size)
    return np.column_stack([np.interp(time, references, row) for row in unit])
