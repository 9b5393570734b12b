# SPDX-License-Identifier: Apache-2.0
"""Measurements of a stiffness campaign: `PointSamples`, and poses made of them: `Samples`.

The tracker sees one reflector at a time, so the three reflectors see three passes of the same
load, each under a slightly different wrench. A pose registered from them mixes the three. The
rig's campaign therefore keeps *points*, each with the wrench of its own pass, and identification
uses them as they are. Two more steps belong to identification instead of the data:

- The unloaded reference is not subtracted. It is a sample like any other (branch 0), with the
  small wrench that the cables' least tension makes. Samples of one group (one stay of the robot,
  one pass over one reflector) share an unknown offset and an unknown linear drift, estimated with
  the stiffness. A difference to a measured reference would carry the reference's noise into all
  loads, correlated; and the offset absorbs other constants: the robot's absolute accuracy,
  the sensor's tare, the tracker's registered position.
- The wrench stays in the axes in which the sensor measures it: the tool's, which turn with the
  deflection (7 mrad under 15 N m at joint 6 turn 100 N by 0.7 N).

`Samples` are the source's: 6-DOF deflections of the tool against the unloaded robot, wrench in base
axes. `identify` takes both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from cabols_control.checks import BoolArray, FloatArray, IntArray, finite_array
from cabols_control.errors import CabolsError, ShapeError

LOADING, UNLOADING, REFERENCE = 1, -1, 0
"""Values of `branch`."""

_SYMMETRY = 1e-6
_NEGATIVE = -1e-9

Table = TypeVar("Table", "PointSamples", "Samples")


@dataclass(frozen=True, eq=False)
class PointSamples:
    """Reflectors measured under measured wrenches; k samples, any order.

    Attributes:
        configuration: (k,) of the robot, any integers.
        load: (k,) number of the load; the same load at every reflector.
        branch: (k,) 1 loading, -1 unloading, 0 unloaded reference.
        reflector: (k,) which one.
        group: (k,) any integers; equal where robot, reflector and beam stayed: samples of one
            group share an unknown offset and drift.
        time: (k,) of the measurement, from any start [s].
        joints: (k, 6) by the encoders, which do not see the deflection [rad].
        wrench: (k, 6) on the robot's tool at the tool's origin, in the tool's own axes as the
            sensor turns with it: force [N], torque [N m].
        wrench_covariance: (k, 6, 6) of its mean over the measurement, tool axes.
        offset: (k, 3) of the reflector from the tool's origin, tool axes [m].
        position: (k, 3) of the reflector, robot's base axes [m]; its constant part is not used.
            NaN: this number was not measured.
        position_covariance: (k, 3, 3) in base axes [m^2].
        wrench_turned: (k,) whose wrench was given in base axes and turned into the tool's by the
            joints: mistakes in it are looked for as it was given; None: none, and stored so.
    """

    configuration: IntArray
    load: IntArray
    branch: IntArray
    reflector: IntArray
    group: IntArray
    time: FloatArray
    joints: FloatArray
    wrench: FloatArray
    wrench_covariance: FloatArray
    offset: FloatArray
    position: FloatArray
    position_covariance: FloatArray
    wrench_turned: BoolArray | None = None

    def __post_init__(self) -> None:
        """Check shapes, finiteness, branches and covariances; freeze the arrays.

        Raises:
            ShapeError: naming the field, what was expected and what came.
        """
        k = _check_joints(self)
        for name in ("configuration", "load", "branch", "reflector", "group"):
            _freeze(self, name, _integers(name, getattr(self, name), k))
        _check_branch(self.branch)
        for name, shape in (("time", ()), ("offset", (3,))):
            _freeze(self, name, finite_array(name, getattr(self, name), (k, *shape)))
        _freeze(self, "position", _measured("position", self.position, (k, 3)))
        _check_common(self, k)
        position = covariances("position_covariance", self.position_covariance, k, 3, True)
        _freeze(self, "position_covariance", position)
        _freeze_turned(self, k)

    def __len__(self) -> int:
        """Number k of samples."""
        return int(self.joints.shape[0])


@dataclass(frozen=True, eq=False)
class Samples:
    """6-DOF deflections of the tool under measured wrenches; k samples, any order.

    Attributes:
        configuration: (k,) of the robot, any integers.
        load: (k,) number of the load.
        branch: (k,) 1 loading, -1 unloading.
        joints: (k, 6) by the encoders, which do not see the deflection [rad].
        wrench: (k, 6) on the robot's tool at the (deflected) tool's origin, robot's base axes:
            force [N], torque [N m].
        wrench_covariance: (k, 6, 6) in base axes.
        deflection: (k, 6) of the tool against the robot under `reference_wrench`, base axes: of
            its origin [m], then the rotation vector that turns the undeflected tool [rad]. NaN:
            this number was not measured.
        deflection_covariance: (k, 6, 6) in base axes.
        reference_wrench: (k, 6) at which the deflection counts as zero; None: zeros, and stored so.
        wrench_turned: (k,) whose wrench was given in tool axes and turned into the base's by the
            joints, as in PointSamples.
    """

    configuration: IntArray
    load: IntArray
    branch: IntArray
    joints: FloatArray
    wrench: FloatArray
    wrench_covariance: FloatArray
    deflection: FloatArray
    deflection_covariance: FloatArray
    reference_wrench: FloatArray | None = None
    wrench_turned: BoolArray | None = None

    def __post_init__(self) -> None:
        """Check shapes, finiteness, branches and covariances; freeze the arrays.

        Raises:
            ShapeError: naming the field, what was expected and what came.
        """
        k = _check_joints(self)
        for name in ("configuration", "load", "branch"):
            _freeze(self, name, _integers(name, getattr(self, name), k))
        _check_branch(self.branch)
        _check_common(self, k)
        _freeze(self, "deflection", _measured("deflection", self.deflection, (k, 6)))
        deflection = covariances("deflection_covariance", self.deflection_covariance, k, 6, True)
        _freeze(self, "deflection_covariance", deflection)
        reference = np.zeros((k, 6)) if self.reference_wrench is None else self.reference_wrench
        _freeze(self, "reference_wrench", finite_array("reference_wrench", reference, (k, 6)))
        _freeze_turned(self, k)

    def __len__(self) -> int:
        """Number k of samples."""
        return int(self.joints.shape[0])


def select(samples: Table, which: BoolArray | IntArray) -> Table:
    """Samples of a boolean mask (k,) or of indices, in their order.

    Args:
        samples: k of them.
        which: (k,) mask, or indices.
    """
    chosen = {field.name: getattr(samples, field.name)[which] for field in fields(samples)}
    return type(samples)(**chosen)


def concatenate(tables: Sequence[Table]) -> Table:
    """All samples of several tables of the same kind, in order.

    Raises:
        CabolsError: if there is no table or they are of two kinds.
    """
    if not tables or any(type(table) is not type(tables[0]) for table in tables):
        kinds = sorted({type(table).__name__ for table in tables})
        raise CabolsError(f"tables: expected one or more of one kind, got {kinds or 'none'}")
    first = tables[0]
    return type(first)(
        **{
            field.name: np.concatenate([getattr(table, field.name) for table in tables])
            for field in fields(first)
        }
    )


def covariances(name: str, value: ArrayLike, k: int, size: int, definite: bool) -> FloatArray:
    """Return value as (k, size, size) covariances.

    Args:
        name: what the caller calls it, for the message.
        value: array-like.
        k: how many.
        size: of each.
        definite: whether every one must be positive definite; else semidefinite.

    Raises:
        ShapeError: if one has another shape, is not finite, symmetric or positive (semi)definite.
    """
    array = finite_array(name, value, (k, size, size))
    if k == 0:
        return array
    # Metres and radians, newtons and newton metres: compare in the covariance's own scale.
    deviation = np.sqrt(np.maximum(np.einsum("kii->ki", array), 0.0))
    scale = np.where(deviation > 0.0, deviation, 1.0)
    scaled = array / (scale[:, :, None] * scale[:, None, :])
    skewed = np.abs(scaled - np.swapaxes(scaled, 1, 2)).max(axis=(1, 2))
    least = np.linalg.eigvalsh(scaled)[:, 0]
    good = (skewed <= _SYMMETRY) & (least > 1e-12 if definite else least >= _NEGATIVE)
    if not good.all():
        worst = int(np.flatnonzero(~good)[0])
        kind = "definite" if definite else "semidefinite"
        raise ShapeError(
            f"{name}[{worst}]: expected a symmetric, positive {kind} matrix, got "
            f"{array[worst].tolist()}"
        )
    return array


def _measured(name: str, value: ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    """Check value as finite_array does, but take NaN for what was not measured."""
    array = np.asarray(value, dtype=np.float64)
    missing = np.isnan(array)
    checked = finite_array(name, np.where(missing, 0.0, array), shape)
    return np.where(missing, np.nan, checked)


def _check_joints(samples: PointSamples | Samples) -> int:
    _freeze(
        samples, "joints", finite_array("joints", samples.joints, (None, _width(samples.joints)))
    )
    return len(samples)


def _width(joints: ArrayLike) -> int:
    """Number of joints, of a table of them; six if it is none."""
    shape = np.shape(joints)
    return max(shape[1], 1) if len(shape) == 2 else 6


def _check_common(samples: PointSamples | Samples, k: int) -> None:
    _freeze(samples, "wrench", finite_array("wrench", samples.wrench, (k, 6)))
    wrench = covariances("wrench_covariance", samples.wrench_covariance, k, 6, False)
    _freeze(samples, "wrench_covariance", wrench)


def _check_branch(branch: IntArray) -> None:
    known = np.isin(branch, (LOADING, UNLOADING, REFERENCE))
    if not known.all():
        where = int(np.flatnonzero(~known)[0])
        raise ShapeError(
            f"branch: expected 1 (loading), -1 (unloading) or 0 (reference), got {branch[where]} "
            f"at [{where}]"
        )


def _integers(name: str, value: ArrayLike, k: int) -> IntArray:
    array = finite_array(name, value, (k,))
    whole = array.astype(np.int64)
    if not (whole == array).all():
        where = int(np.flatnonzero(whole != array)[0])
        raise ShapeError(f"{name}: expected whole numbers, got {array[where]} at [{where}]")
    return whole


def _freeze_turned(samples: PointSamples | Samples, k: int) -> None:
    value = samples.wrench_turned
    if value is None:
        value = np.zeros(k, dtype=np.bool_)
    turned = np.asarray(value)
    if turned.shape != (k,) or turned.dtype != np.bool_:
        raise ShapeError(
            f"wrench_turned: expected {k} of true and false, got {turned.dtype} of {turned.shape}"
        )
    _freeze(samples, "wrench_turned", turned)


def _freeze(
    samples: PointSamples | Samples, name: str, value: FloatArray | IntArray | BoolArray
) -> None:
    value = value.copy()
    value.setflags(write=False)
    object.__setattr__(samples, name, value)
