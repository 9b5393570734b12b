# SPDX-License-Identifier: Apache-2.0
"""A campaign's loads from a bag alone, streaming: memory does not grow with the bag."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from cabols_control.bags.columns import Column
from cabols_control.bags.metadata import custom_data, read_metadata
from cabols_control.bags.names import relative
from cabols_control.bags.reader import batches
from cabols_control.geometry import load_geometry
from cabols_control.naming import place_name, reflector_name
from cabols_control.stamps import column_ns
from cabols_stiffness.campaign.plan import CampaignPlan
from cabols_stiffness.errors import CampaignError
from cabols_stiffness.measurements.measured_load import MeasuredLoad
from cabols_stiffness.measurements.window import Rolling, average

NEEDED = {
    "wrench": "geometry_msgs/msg/WrenchStamped",
    "joint_states": "sensor_msgs/msg/JointState",
    "reflector_measurement": "cabols_msgs/msg/ReflectorMeasurement",
    "stiffness_load": "cabols_msgs/msg/StiffnessLoad",
}
KEPT_S = 120.0
"""Longest time from a window's end to its load's message [s]: length of the kept streams."""
RATE_HZ = 2000.0
BATCH = 20_000
WRENCH = (
    *(f"wrench.force.{axis}" for axis in "xyz"),
    *(f"wrench.torque.{axis}" for axis in "xyz"),
)


@dataclass
class BagLoads:
    """A campaign's data from a bag.

    Attributes:
        loads: that succeeded, in the order of recording.
        failures: of the others: (configuration, reflector, load, reason).
        wrenches: samples of the wrench that were read.
        rig_s: of the rig's time, from the first to the last of them [s].
    """

    loads: list[MeasuredLoad] = field(default_factory=list)
    failures: list[tuple[int, int, int, str]] = field(default_factory=list)
    wrenches: int = 0
    rig_s: float = 0.0


@dataclass(frozen=True)
class _Announced:
    """One StiffnessLoad whose window has not ended yet."""

    whole: tuple[int, int, int, int, int]
    begin_ns: int
    end_ns: int
    tension: np.ndarray


def campaign_text(bag: str | Path) -> str:
    """The campaign.yaml that a bag carries; empty if it has none.

    Raises:
        BagError: if the bag has no metadata.
    """
    return custom_data(read_metadata(Path(bag))).get("campaign_yaml", "")


def loads_announced(bag: str | Path) -> int:
    """Number of StiffnessLoad messages in a bag, by its metadata.

    Raises:
        BagError: if the bag has no metadata.
    """
    for entry in read_metadata(Path(bag)).get("topics_with_message_count") or []:
        if relative(entry["topic_metadata"]["name"]) == "stiffness_load":
            return int(entry["message_count"])
    return 0


def read_loads(
    bag: str | Path,
    plan: CampaignPlan | None = None,
    geometry: str | Path | None = None,
    some: bool = True,
) -> BagLoads:
    """Read a bag's loads.

    Args:
        bag: folder of the bag, complete (`recover` makes it so).
        plan: whose reflectors and limbs the loads must have; None: not checked.
        geometry: YAML of the rig's geometry, for the wrench's frame; None: the bench's.
        some: whether there must be at least one load that succeeded.

    Raises:
        BagError: topic by topic, what is missing or of another type.
        CampaignError: for another frame, other numbers of joints or limbs, or windows without data.
    """
    reader = _Reader(Path(bag), plan, load_geometry(geometry).platform_frame)
    for batch in batches(bag, NEEDED, BATCH):
        reader.take(batch)
    reader.finish(some)
    return reader.found


class _Reader:
    def __init__(self, bag: Path, plan: CampaignPlan | None, frame: str) -> None:
        self._bag = bag
        self._plan = plan
        self._frame = frame
        self._wrenches = Rolling(6, round(KEPT_S * RATE_HZ))
        self._joints = Rolling(6, round(KEPT_S * RATE_HZ / 4))
        self._readings: list[dict[str, Any]] = []
        self._waiting: list[_Announced] = []
        self._tracker_frames: set[str] = set()
        self._first_ns = -1
        self.found = BagLoads()

    def take(self, batch: Mapping[str, Mapping[str, Column]]) -> None:
        """Take one batch."""
        if "wrench" in batch:
            self._take_wrenches(batch["wrench"])
        if "joint_states" in batch:
            self._take_joints(batch["joint_states"])
        if "reflector_measurement" in batch:
            self._take_readings(batch["reflector_measurement"])
        if "stiffness_load" in batch:
            self._take_loads(batch["stiffness_load"])
        self._settle(self._newest_ns())

    def finish(self, some: bool) -> None:
        """Finish the loads whose windows are over; the bag has ended."""
        self._settle(None)
        self.found.rig_s = 1e-9 * (self._wrenches.newest_ns - self._first_ns)
        if some and not self.found.loads:
            failed = f", {len(self.found.failures)} that failed" if self.found.failures else ""
            raise CampaignError(
                f"{self._bag}: stiffness_load: expected at least one load that succeeded, got "
                f"none{failed}; was a campaign running?"
            )

    def _newest_ns(self) -> int:
        return min(self._wrenches.newest_ns, self._joints.newest_ns)

    def _take_wrenches(self, columns: Mapping[str, Column]) -> None:
        _check_frames(self._bag, "wrench", columns, {self._frame})
        stamps = column_ns(columns)
        self._wrenches.add(stamps, np.column_stack([columns[name] for name in WRENCH]))
        self.found.wrenches += stamps.size
        if self._first_ns < 0:
            self._first_ns = int(stamps[0])

    def _take_joints(self, columns: Mapping[str, Column]) -> None:
        angles = columns["position"]
        if not (isinstance(angles, np.ndarray) and angles.shape[1:] == (6,)):
            sizes = sorted({len(row) for row in angles})
            raise CampaignError(
                f"{self._bag}: joint_states: expected six positions, got {sizes}; is it another "
                "robot's topic?"
            )
        self._joints.add(column_ns(columns), angles)

    def _take_readings(self, columns: Mapping[str, Column]) -> None:
        self._tracker_frames.update(columns["header.frame_id"])
        _check_frames(self._bag, "reflector_measurement", columns, self._tracker_frames)
        if len(self._tracker_frames) > 1:
            raise CampaignError(
                f"{self._bag}: reflector_measurement: expected one tracker's frame, got "
                f"{', '.join(sorted(self._tracker_frames))}"
            )
        stamps = column_ns(columns)
        for row in np.flatnonzero(np.asarray(columns["success"])):
            position = [columns[f"position.{axis}"][row] for axis in "xyz"]
            self._readings.append(
                {
                    "stamp": int(stamps[row]),
                    "reflector": int(columns["reflector"][row]),
                    "position": np.array(position, dtype=np.float64),
                    "covariance": np.array(columns["covariance"][row]).reshape(3, 3),
                }
            )

    def _take_loads(self, columns: Mapping[str, Column]) -> None:
        begins, ends = column_ns(columns, "begin"), column_ns(columns, "end")
        for row in range(begins.size):
            configuration, reflector, load, group, branch = (
                int(columns[name][row])
                for name in ("configuration", "reflector", "load", "group", "branch")
            )
            if not columns["success"][row]:
                reason = str(columns["reason"][row])
                self.found.failures.append((configuration, reflector, load, reason))
                continue
            tension = np.array(columns["tension"][row], dtype=np.float64)
            self._check_load(reflector, tension)
            whole = (configuration, reflector, load, group, branch)
            self._waiting.append(_Announced(whole, int(begins[row]), int(ends[row]), tension))

    def _check_load(self, reflector: int, tension: np.ndarray) -> None:
        plan = self._plan
        if plan is None:
            return
        if tension.size != plan.limbs or reflector >= len(plan.rig.reflectors):
            raise CampaignError(
                f"{self._bag}: stiffness_load: expected {plan.limbs} tensions and one of "
                f"{len(plan.rig.reflectors)} reflectors, got {tension.size} and "
                f"{reflector_name(reflector)}; is this its campaign.yaml?"
            )

    def _settle(self, newest_ns: int | None) -> None:
        """Finish the loads whose windows are over."""
        left = []
        for load in self._waiting:
            if newest_ns is not None and newest_ns <= load.end_ns:
                left.append(load)
            else:
                self.found.loads.append(self._measured(load))
        self._waiting = left

    def _measured(self, load: _Announced) -> MeasuredLoad:
        what = place_name(*load.whole[:3])
        reading = next(
            (
                r
                for r in reversed(self._readings)
                if r["reflector"] == load.whole[1] and load.begin_ns <= r["stamp"] <= load.end_ns
            ),
            None,
        )
        if reading is None:
            raise CampaignError(
                f"{self._bag}: reflector_measurement: expected one within the window of "
                f"{what}, got none; was that topic recorded throughout?"
            )
        try:
            mean = average(self._wrenches, self._joints, load.begin_ns, load.end_ns)
        except CampaignError as error:
            raise CampaignError(f"{self._bag}: {what}: {error}") from error
        place = (reading["position"], reading["covariance"])
        return MeasuredLoad(*load.whole, load.begin_ns, load.end_ns, load.tension, mean, *place)


def _check_frames(
    bag: Path, topic: str, columns: Mapping[str, Column], expected: Iterable[str]
) -> None:
    came = set(columns["header.frame_id"])
    if not came <= set(expected):
        wanted = ", ".join(sorted(expected))
        raise CampaignError(
            f"{bag}: {topic}: expected the frame {wanted}, got {', '.join(sorted(came))}; name the "
            "rig's geometry, or record the topic in its own frame"
        )
