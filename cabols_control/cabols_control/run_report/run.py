# SPDX-License-Identifier: Apache-2.0
"""A recorded run as arrays over samples, joined by stamp."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from cabols_control.bags.reader import Bag, Series, read_bag
from cabols_control.checks import BoolArray, FloatArray, IntArray
from cabols_control.errors import CabolsError
from cabols_control.run_report.motion import RecordedMotion, join_motion
from cabols_control.run_report.programme import TOPIC, RecordedProgram, join_program
from cabols_control.run_report.user_frame import (
    UserFrame,
    frame_of,
    poses_at,
    recorded_frames,
    recorded_uncertainty,
    user_frame,
)
from cabols_control.supervision.modes import OperatingMode

NEEDED = ("limb_state", "wrench", "tension_command", "motor_current", "mode")
FORCES = tuple(f"wrench.force.{axis}" for axis in "xyz")
TORQUES = tuple(f"wrench.torque.{axis}" for axis in "xyz")
QUATERNION = tuple(f"pose.orientation.{axis}" for axis in "xyzw")
COUNTERS = ("cycles", "lost", "late", "infeasible")
TIMINGS = ("work_time", "work_time_p99", "round_trip", "round_trip_p99")
STATUS_FAULT = 2


class RunError(CabolsError):
    """A bag does not hold a run that can be judged."""


@dataclass(frozen=True)
class ModeInterval:
    """Time spent in one mode.

    Attributes:
        mode: which.
        start: [s] from the start of LOADING.
        end: [s] likewise; the last sample for the mode that ended the run.
        reason: why it was entered.
    """

    mode: OperatingMode
    start: float
    end: float
    reason: str


@dataclass(frozen=True)
class NodeHealth:
    """Summary of one node's loop_status during LOADING.

    Attributes:
        cycles: samples handled.
        lost: samples or answers missing.
        late: cycles that began late.
        infeasible: cycles whose wrench was not feasible.
        work_time: median work per cycle [s]; 0 in lockstep.
        work_time_p99: median over the run of its 99th percentiles [s].
        round_trip: median time from state to current [s]; 0 in lockstep, bridge only.
        round_trip_p99: median over the run of its 99th percentiles [s].
        round_trip_worst: largest of its 99th percentiles [s].
        fault: newest reason of a FAULT in the whole bag; empty if there was none.
    """

    cycles: int
    lost: int
    late: int
    infeasible: int
    work_time: float
    work_time_p99: float
    round_trip: float
    round_trip_p99: float
    round_trip_worst: float
    fault: str


@dataclass(frozen=True, eq=False)
class BenchRun:
    """One run; k samples, n limbs. Rows without an answer are NaN (False in BoolArrays).

    Wrenches act on the platform, at its origin, in base axes.

    Attributes:
        name: of the bag's folder.
        metadata: text by key, as given to the recorder.
        time: (k,) from the start of LOADING, negative before it [s].
        loading: (k,) whether the mode was LOADING.
        sequence: (k,) number of the sample.
        desired: (k, 6) reference of the wrench law at the sample [N, N m].
        control: (k, 6) u of (3.17) [N, N m].
        measured: (k, 6) by the force/torque sensor [N, N m].
        tension: (k, n) estimates (3.9) [N].
        tension_command: (k, n) [N].
        current: (k, n) commanded [A].
        feasible: (k,) whether the control was feasible.
        answered: (k,) whether a tension command answers the sample.
        switch_closed: (k, n) limit switches.
        command_delay: (k,) age of the tension command that a motor current used [samples].
        modes: in order of time.
        health: by node.
        lost: samples missing in the bag, by topic.
        motion: of robot and platform.
        program: what the load programme asked for.
        uncertainty: (k, 6) half widths that hold 95 % of the errors of `measured` in the frame of
            the desired wrench, of the newest that were told; NaN: not recorded [N, N m].
        loading_log_ns: when the first and the last sample of LOADING were recorded, system clock.
    """

    name: str
    metadata: dict[str, str]
    time: FloatArray
    loading: BoolArray
    sequence: IntArray
    desired: FloatArray
    control: FloatArray
    measured: FloatArray
    tension: FloatArray
    tension_command: FloatArray
    current: FloatArray
    feasible: BoolArray
    answered: BoolArray
    switch_closed: BoolArray
    command_delay: FloatArray
    modes: tuple[ModeInterval, ...]
    health: dict[str, NodeHealth]
    lost: dict[str, int]
    motion: RecordedMotion
    program: RecordedProgram
    uncertainty: FloatArray
    loading_log_ns: tuple[int, int] = (0, 0)

    @property
    def limbs(self) -> int:
        """Number n of limbs."""
        return int(self.tension.shape[1])


def load_run(bag_folder: str | Path) -> BenchRun:
    """Read a bag that the recorder wrote and join its topics.

    Raises:
        BagError: if the bag cannot be read.
        RunError: if it lacks a topic or never reached LOADING.
    """
    return join_run(read_bag(bag_folder))


def join_run(bag: Bag) -> BenchRun:
    """Join the topics of a bag in memory; see load_run."""
    missing = [topic for topic in NEEDED if topic not in bag or not len(bag[topic])]
    if missing:
        raise RunError(
            f"{bag.folder}: expected the topics {', '.join(NEEDED)}, got no messages of "
            f"{', '.join(missing)}; was every node running?"
        )
    state = bag["limb_state"]
    stamps, order = np.unique(state.stamp_ns, return_index=True)
    begin, end = _loading_interval(bag, int(stamps[-1]))
    loading = (stamps >= begin) & (stamps < end)
    logged = state.log_time_ns[order][loading]
    n = int(np.asarray(state["tension"]).shape[1])
    sequence = np.asarray(state["sequence"]).astype(np.int64)[order]
    command, answer = bag["tension_command"], bag["motor_current"]
    command_rows, answer_rows = _rows(stamps, command), _rows(stamps, answer)
    desired = _spread(command_rows, _column(command, "desired"), stamps.size)
    used = _spread(answer_rows, _column(answer, "tension_sequence"), stamps.size)
    return BenchRun(
        name=bag.folder.name,
        metadata=dict(bag.metadata),
        time=np.multiply(1e-9, stamps - begin),
        loading=loading,
        sequence=sequence,
        desired=desired,
        control=_spread(command_rows, _column(command, "control"), stamps.size),
        measured=_measured(bag, stamps),
        tension=_column(state, "tension")[order],
        tension_command=_by_limb(command, "tension", command_rows, stamps.size, n),
        current=_by_limb(answer, "current", answer_rows, stamps.size, n),
        feasible=_spread(command_rows, _column(command, "feasible"), stamps.size) == 1.0,
        answered=np.isin(np.arange(stamps.size), command_rows),
        switch_closed=_column(state, "switch_closed")[order] != 0.0,
        command_delay=np.where(used > 0.0, sequence - used, np.nan),
        modes=_modes(bag, begin, int(stamps[-1])),
        health=_health(bag, begin, end),
        lost=_lost(bag, stamps),
        motion=join_motion(bag, begin),
        program=join_program(bag, stamps, desired, _program_frame(bag, stamps)),
        uncertainty=recorded_uncertainty(bag, stamps),
        loading_log_ns=(int(logged.min()), int(logged.max())) if logged.size else (0, 0),
    )


def _column(series: Series, field: str) -> FloatArray:
    return np.asarray(series[field], dtype=np.float64)


def _rows(samples_ns: IntArray, series: Series) -> IntArray:
    """Row of the sample that each message belongs to; -1 where the bag has no such sample."""
    place = np.searchsorted(samples_ns, series.stamp_ns)
    place = np.minimum(place, samples_ns.size - 1)
    return np.where(samples_ns[place] == series.stamp_ns, place, -1)


def _spread(rows: IntArray, values: FloatArray, samples: int) -> FloatArray:
    """Put each message's value in its row; of several the first: a node's last is a repeat."""
    spread = np.full((samples, *values.shape[1:]), np.nan)
    used = np.flatnonzero(rows >= 0)[::-1]
    spread[rows[used]] = values[used]
    return spread


def _by_limb(series: Series, field: str, rows: IntArray, samples: int, n: int) -> FloatArray:
    """Like _spread, each value in its limb's column; several nodes may serve subsets of limbs."""
    limbs, values = series["limb"], series[field]
    spread = np.full((samples, n), np.nan)
    used = np.flatnonzero(rows >= 0)[::-1]
    if isinstance(limbs, np.ndarray) and isinstance(values, np.ndarray):
        spread[rows[used][:, None], limbs[used].astype(np.int64)] = values[used]
        return spread
    for k in used:
        spread[rows[k], np.asarray(limbs[k]).astype(np.int64)] = values[k]
    return spread


def _program_frame(bag: Bag, samples_ns: IntArray) -> UserFrame | None:
    """Frame of the programme along the run, by the poses and the rig's files in the bag."""
    name = frame_of(bag, TOPIC)
    if not name:
        return UserFrame()
    return user_frame(recorded_frames(bag.metadata), name, poses_at(bag, samples_ns))


def _measured(bag: Bag, samples_ns: IntArray) -> FloatArray:
    """Measured wrench, turned from platform to base axes by the newest pose of each sample."""
    wrench = bag["wrench"]
    columns = np.column_stack([_column(wrench, name) for name in (*FORCES, *TORQUES)])
    measured = _spread(_rows(samples_ns, wrench), columns, samples_ns.size)
    if "platform_pose" not in bag or not len(bag["platform_pose"]):
        return measured
    pose = bag["platform_pose"]
    quaternion = np.column_stack([_column(pose, name) for name in QUATERNION])
    order = np.argsort(pose.stamp_ns, kind="stable")
    newest = np.searchsorted(pose.stamp_ns[order], samples_ns, side="right") - 1
    rotation = Rotation.from_quat(quaternion[order][np.maximum(newest, 0)])
    return np.column_stack([rotation.apply(measured[:, :3]), rotation.apply(measured[:, 3:])])


def _mode_changes(bag: Bag) -> list[tuple[int, OperatingMode, str]]:
    """Stamp [ns], mode and reason of each change; the supervisor repeats the mode in between."""
    series = bag["mode"]
    changes: list[tuple[int, OperatingMode, str]] = []
    numbers = np.asarray(series["mode"]).astype(np.int64)
    for stamp, number, reason in zip(series.stamp_ns, numbers, series["reason"], strict=True):
        mode = OperatingMode(int(number))
        if not changes or changes[-1][1] != mode:
            changes.append((int(stamp), mode, str(reason)))
    return changes


def _loading_interval(bag: Bag, last_ns: int) -> tuple[int, int]:
    """Start and end [ns] of the longest time in LOADING."""
    changes = _mode_changes(bag)
    ends = [stamp for stamp, _, _ in changes[1:]] + [last_ns + 1]
    found = [
        (stamp, end)
        for (stamp, mode, _), end in zip(changes, ends, strict=True)
        if mode == OperatingMode.LOADING
    ]
    if not found:
        went = ", ".join(f"{mode.name} ({reason})" for _, mode, reason in changes)
        health = _health(bag, 0, last_ns)
        faults = [f"{node}: {entry.fault}" for node, entry in health.items() if entry.fault]
        raise RunError(
            f"{bag.folder}: expected a run that reached LOADING, got the modes {went}"
            + (f"; {'; '.join(faults)}" if faults else "")
        )
    return max(found, key=lambda interval: interval[1] - interval[0])


def _modes(bag: Bag, zero_ns: int, last_ns: int) -> tuple[ModeInterval, ...]:
    changes = _mode_changes(bag)
    ends = [stamp for stamp, _, _ in changes[1:]] + [last_ns]
    # A supervisor that has seen no sample yet stamps with zero.
    first = int(bag["limb_state"].stamp_ns.min())
    return tuple(
        ModeInterval(
            mode, 1e-9 * (max(stamp, first) - zero_ns), 1e-9 * (max(end, first) - zero_ns), reason
        )
        for (stamp, mode, reason), end in zip(changes, ends, strict=True)
    )


def _health(bag: Bag, begin_ns: int, end_ns: int) -> dict[str, NodeHealth]:
    """Growth of each node's counters while loading; its reports come every 100 cycles."""
    if "loop_status" not in bag:
        return {}
    series = bag["loop_status"]
    nodes = np.array(series["node"])
    values = {name: _column(series, name) for name in (*COUNTERS, *TIMINGS)}
    state, reasons = np.asarray(series["state"]), series["reason"]
    over_ns = _over(bag)
    found: dict[str, NodeHealth] = {}
    for node in dict.fromkeys(nodes.tolist()):
        mine = np.flatnonzero(nodes == node)
        before = mine[series.stamp_ns[mine] <= begin_ns]
        within = mine[(series.stamp_ns[mine] > begin_ns) & (series.stamp_ns[mine] <= end_ns)]
        timed = within if within.size else mine
        grown: dict[str, Any] = {
            name: int(_last(values[name], within, before) - _last(values[name], before, []))
            for name in COUNTERS
        }
        timings: dict[str, Any] = {name: float(np.median(values[name][timed])) for name in TIMINGS}
        faults = [
            str(reasons[k])
            for k in mine
            if state[k] == STATUS_FAULT and series.log_time_ns[k] <= over_ns
        ]
        found[str(node)] = NodeHealth(
            **grown,
            **timings,
            round_trip_worst=float(values["round_trip_p99"][timed].max()),
            fault=faults[-1] if faults else "",
        )
    return found


def _over(bag: Bag) -> int:
    """Return the end of the run [ns]: after it, nodes that end one by one report each other.

    It is the last sample if the rig was STOPPED; in other modes a node's end is a finding.
    """
    changes = _mode_changes(bag)
    if not changes or changes[-1][1] != OperatingMode.STOPPED:
        return int(np.iinfo(np.int64).max)
    return int(bag["limb_state"].log_time_ns.max())


def _last(values: FloatArray, rows: Any, otherwise: Any) -> float:
    chosen = rows if len(rows) else otherwise
    return float(values[chosen[-1]]) if len(chosen) else 0.0


def _lost(bag: Bag, samples_ns: IntArray) -> dict[str, int]:
    """Samples between the first and the last of a topic that the bag does not have."""
    found = {}
    for topic in ("limb_state", "tension_command", "motor_current"):
        numbers = np.unique(np.asarray(bag[topic]["sequence"]).astype(np.int64))
        numbers = numbers[numbers > 0]
        found[topic] = int(numbers[-1] - numbers[0] + 1 - numbers.size) if numbers.size else 0
    stamps = bag["wrench"].stamp_ns
    spanned = samples_ns[(samples_ns >= stamps.min()) & (samples_ns <= stamps.max())]
    found["wrench"] = int(np.setdiff1d(spanned, stamps).size)
    return found
