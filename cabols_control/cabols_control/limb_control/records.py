# SPDX-License-Identifier: Apache-2.0
"""Records of the compiled limb step: one for each limb, one for each mode's task."""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
from functools import cache
from typing import Any

import numpy as np

from cabols_control.gains import LimbGains
from cabols_control.rig import Rig
from cabols_control.supervision.modes import MOVING, OperatingMode


class ControlKind(IntEnum):
    """How one limb is controlled."""

    REST = 0
    """Zero current: the gear's friction holds."""
    SWITCH = 1
    """Winding speed by the switch: in while it is open, out while it is closed."""
    TENSION = 2
    """Tension control by elongation (3.10)."""
    FOLLOW = 3
    """Tension control around the speed at which the platform lengthens the cable."""
    SPEED = 4
    """A given winding speed [m/s]."""
    CURRENT = 5
    """A given current [A]."""


class Outcome(IntEnum):
    """Outcome of a step."""

    DONE = 0
    ARRIVED = 1
    """Done; every ramp is at its end, and every tension with a known zero near it."""
    RESTED = 2
    """The mode allows no current."""
    # With the following results the limbs rest because of a fault.
    WRONG_LENGTH = 3
    """There is not one setpoint for each limb."""
    WRONG_LIMBS = 4
    """The limb state is not of limbs 0 to n - 1 in this order."""
    UNZEROED = 5
    """A limb has no zero, where all must have one."""
    NOT_FINITE = 6
    """A setpoint, a position or a tension is not finite."""


LIMB = np.dtype(
    [
        ("limb", np.int64),  # index among the rig's, from 0
        ("integral_gain", np.float64),  # k_I [A/m]
        ("velocity_gain", np.float64),  # k_P1 [A s/m]
        ("tension_gain", np.float64),  # k_P2 [m/s/N]
        ("current_per_speed", np.float64),  # 1 / k of (3.11) [A s/m]
        ("current_per_change", np.float64),  # T / k [A s^2/m]
        ("stiffness", np.float64),  # k_e at the reference pose [N/m]
        ("backlash", np.float64),  # that the law allows for [m]
        ("pulley", np.float64),  # wound length behind the backlash [m]
        ("integral", np.float64),  # of the law [m]
        ("last_position", np.float64),  # that the law was given [m]
        ("law_current", np.float64),  # the law's output [A]
        ("kind", np.int64),  # ControlKind at the newest state
        ("changed", np.int64),  # whether that changed with it
        ("cable_length", np.float64),  # between its points, but for a constant [m]
        ("cable_rate", np.float64),  # at which it grows, filtered [m/s]
        ("ramp", np.float64),  # setpoint on its way to the task's goal [N]; NaN: start again
        ("setpoint", np.float64),  # tension [N], speed [m/s] or current [A], as the kind has it
        ("position", np.float64),  # what the law differentiates [m]
        ("reference", np.float64),  # of the law [m/s]
        ("feed_forward", np.float64),  # current that follows the platform's motion [A]
        ("current", np.float64),  # output [A]
    ],
    align=True,
)
"""State and gains of one limb."""

TASK = np.dtype(
    [
        ("moves", np.int64),  # whether currents may flow
        ("needs_zeros", np.int64),  # whether every limb must have one
        ("kind_without_zero", np.int64),  # ControlKind of limbs whose zero is unknown
        ("kind_with_zero", np.int64),
        ("ramps", np.int64),  # whether setpoints are ramped to the goal; else they are given
        ("goal", np.float64),  # of the ramps [N]
        ("rate", np.float64),  # of the ramps [N/s]
        ("speed", np.float64),  # of SWITCH [m/s]
        ("tension_limit", np.float64),  # bound on setpoints [N]
        ("programme_place", np.int64),  # of the limb that a programme drives; -1: none
        ("programme_kind", np.int64),  # its ControlKind
        ("programme_value", np.float64),  # its setpoint
    ],
    align=True,
)
"""Task of the limbs in a mode."""


def limb_records(gains: Sequence[LimbGains], limbs: Sequence[int] | None = None) -> Any:
    """Build the limbs' records, at rest.

    Args:
        gains: one for each of m limbs.
        limbs: their indices among the rig's, from 0; None for 0 to m - 1.

    Returns:
        (m,) records of LIMB.
    """
    records = np.zeros(len(gains), LIMB)
    records["limb"] = np.arange(len(gains)) if limbs is None else limbs
    records["integral_gain"] = [each.integral for each in gains]
    records["velocity_gain"] = [each.velocity for each in gains]
    records["tension_gain"] = [each.tension for each in gains]
    return records


def _task_records(rig: Rig) -> Any:
    """Build each mode's task, a record of TASK at the mode's number."""
    control = rig.control
    tasks = np.zeros(max(OperatingMode) + 1, TASK)
    for mode, task in enumerate(tasks):
        task["moves"] = mode in MOVING
        task["speed"] = control.pretension_speed
        task["rate"] = control.unload_tension_rate
        task["tension_limit"] = control.tension_max
        task["programme_place"] = -1
    for mode in (OperatingMode.PRETIGHTENING, OperatingMode.LOADING):
        tasks[mode]["kind_without_zero"] = ControlKind.SWITCH
        tasks[mode]["kind_with_zero"] = ControlKind.TENSION
    tasks[OperatingMode.LOADING]["needs_zeros"] = True
    unloading, free = tasks[OperatingMode.UNLOADING], tasks[OperatingMode.FREE_MOVING]
    unloading["kind_with_zero"] = ControlKind.TENSION
    unloading["goal"] = rig.holding_tension
    free["kind_without_zero"], free["kind_with_zero"] = ControlKind.SWITCH, ControlKind.FOLLOW
    free["goal"] = control.free_tension
    for task in (unloading, free):
        task["ramps"], task["speed"] = True, control.free_speed
    return tasks


@cache
def _work_dtype(limbs: int) -> Any:
    """Build the dtype of limb_control_work for m limbs.

    Cached, as a call of compiled code takes microseconds longer for a record whose dtype is equal
    to the one that it was compiled for, but not the same object.
    """
    fields = [
        ("mode", np.int64),
        ("moving", np.int64),
        ("current_limit", np.float64),
        ("tasks", TASK, (max(OperatingMode) + 1,)),
        ("limbs", LIMB, (limbs,)),
    ]
    return np.dtype(fields, align=True)


def limb_control_work(rig: Rig, limbs: Sequence[int]) -> Any:
    """Build the records of `step_limbs`, at rest.

    Args:
        rig: gains and limits.
        limbs: indices of the m limbs to drive, from 0.

    Returns:
        (1,) record: `mode` and whether `moving` at the newest state, `current_limit` [A], `tasks`
        (one of TASK for each mode), `limbs` ((m,) of LIMB).
    """
    work = np.zeros(1, _work_dtype(len(limbs)))
    work["current_limit"] = rig.control.current_limit
    work["tasks"] = _task_records(rig)
    records = limb_records([rig.gains.limbs[i] for i in limbs], limbs)
    models = [rig.limbs.models[i] for i in limbs]
    records["current_per_speed"] = [1.0 / model.gain for model in models]
    records["current_per_change"] = [model.time_constant / model.gain for model in models]
    records["stiffness"] = rig.springs.nominal[list(limbs)]
    records["backlash"] = rig.limbs.backlash
    work["limbs"] = records
    return work


@cache
def sample_dtypes(cables: int, limbs: int) -> tuple[Any, Any]:
    """Build the records of the fields that the step reads of a limb state and writes of its answer.

    For callers without messages: the fields are those of LimbState and MotorCurrent, by dotted
    name, flags as bytes.

    Args:
        cables: number n of the rig's cables.
        limbs: number m of limbs that are driven.

    Returns:
        dtypes of the limb state and of the motor current.
    """
    header = [("header.stamp.sec", np.int32), ("header.stamp.nanosec", np.uint32)]
    state = [
        *header,
        ("sequence", np.uint64),
        ("limb", np.uint8, (cables,)),
        *((name, np.float64, (cables,)) for name in ("wound_length", "elongation", "tension")),
        *((name, np.uint8, (cables,)) for name in ("switch_closed", "zeroed")),
        *((name, np.float64, (cables,)) for name in ("cable_speed", "cable_acceleration")),
    ]
    answer = [
        *header,
        ("sequence", np.uint64),
        ("current", np.float64, (limbs,)),
        ("saturated", np.uint8, (limbs,)),
    ]
    return np.dtype(state, align=True), np.dtype(answer, align=True)
