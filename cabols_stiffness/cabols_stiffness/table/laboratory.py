# SPDX-License-Identifier: Apache-2.0
"""A table's rows as samples for `identify`.

Displacements (dx, dy, dz, against the unloaded robot) become pairs: the loaded row and an unloaded
one beside it, in a group of their own, so that nothing is shared from row to row. Positions (px,
py, pz) stay as they are: rows of one group share an unknown offset. A distance to a fixed point (a
ball bar, a dial gauge) is a position whose deviation across its direction is without bound.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cabols_control.checks import FloatArray, IntArray
from cabols_stiffness.errors import TableError
from cabols_stiffness.measurements.samples import LOADING, REFERENCE, PointSamples, Samples
from cabols_stiffness.model.balance import balance
from cabols_stiffness.model.prediction import law_of
from cabols_stiffness.model.result import StiffnessResult
from cabols_stiffness.model.robot import RobotModel
from cabols_stiffness.model.screws import turn, turning
from cabols_stiffness.table.reading import Table

UNBOUNDED = 1e5
"""Deviation across the direction of a distance, of that along it: far beyond any motion, and still
regular."""
EXACT_M = 1e-9
"""Deviation of a displacement's unloaded partner, whose noise the displacement holds already."""
SMALL_N = 1e-9


@dataclass(frozen=True)
class Stated:
    """What the table does not say.

    Attributes:
        position_m: standard deviation of a measured displacement or position [m].
        rotation_rad: of a measured rotation [rad].
        force_n: of a force [N].
        torque_nm: of a torque [N m].
        follows: whether the wrench is in the tool's axes, as a sensor's on the tool.
        reflector: (3,) of the measured point, tool axes [m].
        anchor: (3,) other end of a distance, base axes [m]; None: the table has no distance.
    """

    position_m: float = 20e-6
    rotation_rad: float = 80e-6
    force_n: float = 0.5
    torque_nm: float = 0.05
    follows: bool = False
    reflector: tuple[float, float, float] = (0.0, 0.0, 0.0)
    anchor: tuple[float, float, float] | None = None


def to_samples(
    table: Table, robot: RobotModel, stated: Stated, result: StiffnessResult | None = None
) -> PointSamples | Samples:
    """Make samples of a table.

    Args:
        table: of a laboratory.
        robot: with its tool.
        stated: noise, axes, measured point.
        result: a first one, whose deflections turn the wrench between base and tool; None: the
            undeflected robot's.

    Raises:
        TableError: if the table measures nothing that is known.
    """
    rotation = robot.posture(table.joints).rotation
    if result is not None:
        load = table.wrench
        loaded = balance(robot, table.joints, load, law_of(result), stated.follows)
        rotation = loaded.posture.rotation
    moved, turned = table.together("d"), table.together("r")
    position, distance = table.together("p"), table.columns.get("distance")
    at_origin = not np.any(stated.reflector)
    if moved is not None and turned is not None and at_origin:
        return _poses(table, stated, rotation, moved, turned)
    noise = np.eye(3) * stated.position_m**2
    if moved is not None:
        return _pairs(table, stated, rotation, moved, np.broadcast_to(noise, (len(table), 3, 3)))
    if position is not None:
        return _points(table, stated, rotation, position, noise)
    if distance is not None:
        return _distances(table, robot, stated, rotation, distance)
    raise TableError(
        "table: expected displacements (dx_mm, dy_mm, dz_mm), positions (px_mm, ...) or a "
        "distance_mm, got none of them"
    )


def not_used(table: Table, stated: Stated) -> tuple[str, ...]:
    """Columns that are known, but of which nothing is taken beside the others.

    Args:
        table: of a laboratory.
        stated: as to_samples.
    """
    moved, turned = table.together("d") is not None, table.together("r") is not None
    position = table.together("p") is not None
    left = []
    if turned and not (moved and not np.any(stated.reflector)):
        left.append("r")
    if moved and position:
        left.append("p")
    found = [role for role in table.columns if len(role) == 2 and role[0] in left]
    if "distance" in table.columns and (moved or position):
        found.append("distance")
    return tuple(found)


def _poses(
    table: Table, stated: Stated, rotation: FloatArray, moved: FloatArray, turned: FloatArray
) -> Samples:
    k, deviation = len(table), _deviation(stated)
    wrench = turn(rotation, table.wrench) if stated.follows else table.wrench
    to_base = turning(rotation) if stated.follows else np.broadcast_to(np.eye(6), (k, 6, 6))
    noise = np.diag([stated.position_m**2] * 3 + [stated.rotation_rad**2] * 3)
    return Samples(
        configuration=_configuration(table),
        load=table.index("load", np.arange(k)),
        branch=_branch(table),
        joints=table.joints,
        wrench=wrench,
        wrench_covariance=to_base @ np.diag(deviation**2) @ to_base.swapaxes(1, 2),
        deflection=np.concatenate([moved, turned], axis=1),
        deflection_covariance=np.broadcast_to(noise, (k, 6, 6)),
        wrench_turned=np.full(k, stated.follows),
    )


def _points(
    table: Table, stated: Stated, rotation: FloatArray, position: FloatArray, noise: FloatArray
) -> PointSamples:
    k = len(table)
    wrench, covariance = _in_tool(table, stated, rotation)
    loaded = np.abs(table.wrench).max(axis=1) > SMALL_N
    passes = np.column_stack([_configuration(table), table.index("reflector")])
    _, group = np.unique(passes, axis=0, return_inverse=True)
    return PointSamples(
        configuration=_configuration(table),
        load=table.index("load", np.arange(k)),
        branch=np.where(loaded, _branch(table), REFERENCE),
        reflector=table.index("reflector"),
        group=table.index("group", group.ravel()),
        time=table.columns.get("time", np.arange(k, dtype=np.float64)),
        joints=table.joints,
        wrench=wrench,
        wrench_covariance=covariance,
        offset=np.tile(stated.reflector, (k, 1)),
        position=position,
        position_covariance=np.broadcast_to(noise, (k, 3, 3)),
        wrench_turned=np.full(k, not stated.follows),
    )


def _pairs(
    table: Table, stated: Stated, rotation: FloatArray, moved: FloatArray, noise: FloatArray
) -> PointSamples:
    """Each row with an unloaded one beside it."""
    k = len(table)
    wrench, covariance = _in_tool(table, stated, rotation)
    nothing, exact = np.zeros((k, 6)), np.broadcast_to(np.eye(3) * EXACT_M**2, (k, 3, 3))

    def both(one: Any, other: Any) -> Any:
        return np.concatenate([one, other])

    def twice(one: Any) -> Any:
        return np.concatenate([one, one])

    return PointSamples(
        configuration=twice(_configuration(table)),
        load=twice(table.index("load", np.arange(k))),
        branch=both(_branch(table), np.full(k, REFERENCE)),
        reflector=twice(table.index("reflector")),
        group=twice(np.arange(k)),
        time=both(np.arange(k) + 0.5, np.arange(k)),
        joints=twice(table.joints),
        wrench=both(wrench, nothing),
        wrench_covariance=both(covariance, np.zeros((k, 6, 6))),
        offset=np.tile(stated.reflector, (2 * k, 1)),
        position=both(moved, np.zeros((k, 3))),
        position_covariance=both(noise, exact),
        wrench_turned=np.full(2 * k, not stated.follows),
    )


def _distances(
    table: Table, robot: RobotModel, stated: Stated, rotation: FloatArray, distance: FloatArray
) -> PointSamples:
    if stated.anchor is None:
        raise TableError("distance: expected its other end (anchor) in base axes, got none")
    posture = robot.posture(table.joints)
    offset = np.tile(stated.reflector, (len(table), 1))
    point = posture.position + np.einsum("kij,kj->ki", posture.rotation, offset)
    along = point - np.asarray(stated.anchor)
    length = np.linalg.norm(along, axis=1)
    if not (length > 1e-3).all():
        raise TableError("anchor: expected a point away from the measured one, got the same")
    along = along / length[:, None]
    across = np.eye(3) - along[:, :, None] * along[:, None, :]
    inside = along[:, :, None] * along[:, None, :]
    noise = stated.position_m**2 * (inside + UNBOUNDED**2 * across)
    values = distance[:, None] * along
    position = np.where(np.isfinite(distance)[:, None], values, np.nan)
    if np.nanmax(np.abs(distance)) < 0.5 * length.min():
        return _pairs(table, stated, rotation, position, noise)
    return _points(table, stated, rotation, position, noise)


def _in_tool(table: Table, stated: Stated, rotation: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(k, 6) wrenches and (k, 6, 6) covariances in tool axes; unloaded rows are exact."""
    noise = np.diag(_deviation(stated) ** 2)
    loaded = np.abs(table.wrench).max(axis=1) > SMALL_N
    covariance = np.where(loaded[:, None, None], noise, 0.0)
    if stated.follows:
        return table.wrench, covariance
    back = rotation.swapaxes(1, 2)
    matrix = turning(back)
    return turn(back, table.wrench), matrix @ covariance @ matrix.swapaxes(1, 2)


def _deviation(stated: Stated) -> FloatArray:
    return np.array([stated.force_n] * 3 + [stated.torque_nm] * 3)


def _branch(table: Table) -> IntArray:
    branch = table.index("branch", LOADING)
    return np.asarray(np.where(branch == REFERENCE, LOADING, np.sign(branch)), dtype=np.int64)


def _configuration(table: Table) -> IntArray:
    """(k,) numbers; without a column, rows of the same joints are one configuration."""
    _, found = np.unique(np.round(table.joints, 4), axis=0, return_inverse=True)
    return table.index("configuration", found.ravel())
