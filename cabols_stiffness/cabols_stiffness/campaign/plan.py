# SPDX-License-Identifier: Apache-2.0
"""The plan of a campaign: campaign.yaml, checked."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass as plain_dataclass
from dataclasses import field
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from pydantic.dataclasses import dataclass

from cabols_control.checks import FloatArray, finite_array, in_range
from cabols_control.configuration import STRICT, load_config, read_yaml
from cabols_control.errors import ConfigError
from cabols_control.files.given_file import read_given
from cabols_control.frames import FRAMES, load_frames
from cabols_control.rig_folder import RigFolder, find_rig, rig_file
from cabols_stiffness.measurements.measuring_rig import MeasuringRig
from cabols_stiffness.measurements.samples import LOADING, REFERENCE, UNLOADING
from cabols_stiffness.model.model_words import MODELS

PLAN, ROBOT = "campaign.yaml", "robot.urdf"


@dataclass(frozen=True, config=STRICT)
class TensionPath:
    """One way in joint space from rest to a peak and back, measured at stops (figure 4.10).

    Attributes:
        peak: of each limb [N].
        stops: shares of the way from rest to the peak at which it is measured; rising, over 0 to 1.
        down: whether it is measured at the same stops on the way back, but for the peak.
    """

    peak: list[float]
    stops: list[float] = field(default_factory=lambda: [1.0])
    down: bool = False

    def __post_init__(self) -> None:
        """Check the numbers."""
        finite_array("peak", self.peak, (None,))
        stops = finite_array("stops", self.stops, (None,))
        if not (stops.size and stops[0] > 0.0 and (np.diff(stops) > 0.0).all()):
            raise ConfigError(f"stops: expected rising numbers over 0 to 1, got {self.stops}")
        in_range("last stop", float(stops[-1]), 0.0, 1.0)


@dataclass(frozen=True, config=STRICT)
class Settling:
    """When a load has settled: limits of the difference between means over two successive windows.

    Attributes:
        window: [s].
        force: [N].
        torque: [N m].
        tension: largest distance of a limb's estimate from its setpoint [N].
        timeout: longest settling after the tensions were reached [s].
    """

    window: float = 0.04
    force: float = 0.15
    torque: float = 0.03
    tension: float = 5.0
    timeout: float = 5.0

    def __post_init__(self) -> None:
        """Check signs."""
        in_range("window", self.window, 0.005, 10.0)
        for name in ("force", "torque", "tension"):
            in_range(name, getattr(self, name), 1e-4, 1e3)
        in_range("timeout", self.timeout, 0.05, 600.0)


@plain_dataclass(frozen=True, eq=False)
class Point:
    """One stop of the trajectory, the same at every reflector of a configuration.

    Attributes:
        load: number, from 0.
        leg: which of the trajectory's ways it belongs to, from 0; a reference is one of its own.
        branch: 1 on the way up, -1 on the way down, 0 an unloaded reference.
        tension: (n,) [N].
    """

    load: int
    leg: int
    branch: int
    tension: FloatArray


@dataclass(frozen=True, config=STRICT)
class CampaignPlan:
    """The plan of a campaign.

    Attributes:
        rig: see MeasuringRig.
        configurations: of the robot, in this order.
        reflectors: of the tracker, in this order, at every configuration.
        paths: tensions at every configuration.
        validation_configurations: of the comparison of prediction and other loads, at the end.
        validation_paths: those loads.
        reference_every: number of paths between two unloaded references.
        averaging_time: of a measurement [s].
        tension_rate: rate of the tensions [N/s].
        settling: see Settling.
        steady_force: largest standard deviation of a force during a measurement [N].
        steady_torque: likewise of a torque [N m].
        retries: of a failed step, which is then skipped.
        accuracy: stop when every joint's relative standard deviation is below it; 0: never.
        model: of the running estimate: linear, cubic or as_published.
        wrench_limit: (6,) largest wrench on the platform; a load beyond it is skipped [N, N m].
        move_timeout: of a motion [s].
        pretighten_timeout: [s].
        measure_timeout: of a measurement besides its averaging time [s].
    """

    rig: MeasuringRig
    configurations: list[int]
    paths: list[TensionPath]
    reflectors: list[int] = field(default_factory=lambda: [0, 1, 2])
    validation_configurations: list[int] = field(default_factory=list)
    validation_paths: list[TensionPath] = field(default_factory=list)
    reference_every: int = 2
    averaging_time: float = 0.2
    tension_rate: float = 250.0
    settling: Settling = field(default_factory=Settling)
    steady_force: float = 1.0
    steady_torque: float = 0.1
    retries: int = 2
    accuracy: float = 0.0
    model: str = "linear"
    wrench_limit: list[float] = field(
        default_factory=lambda: [140.0, 140.0, 420.0, 12.0, 12.0, 12.0]
    )
    move_timeout: float = 60.0
    pretighten_timeout: float = 30.0
    measure_timeout: float = 30.0

    def __post_init__(self) -> None:
        """Check numbers and that the lists fit each other."""
        for name in ("configurations", "reflectors", "paths"):
            if not getattr(self, name):
                raise ConfigError(f"{name}: expected at least one, got none")
        both = [*self.configurations, *self.validation_configurations]
        if len(set(both)) != len(both) or len(set(self.reflectors)) != len(self.reflectors):
            raise ConfigError("configurations, reflectors: expected each only once")
        last = len(self.rig.reflectors) - 1
        for number in self.reflectors:
            in_range("reflectors", number, 0, last)
        for number in both:
            in_range("configurations", number, 0, 65535)
        if bool(self.validation_configurations) != bool(self.validation_paths):
            raise ConfigError("validation: expected both configurations and paths, or neither")
        lengths = {len(path.peak) for path in (*self.paths, *self.validation_paths)}
        if len(lengths) != 1:
            raise ConfigError(f"peak: expected one tension for each limb, got {sorted(lengths)}")
        if self.model not in MODELS:
            raise ConfigError(f"model: expected one of {', '.join(MODELS)}, got {self.model!r}")
        finite_array("wrench_limit", self.wrench_limit, (6,))
        in_range("reference_every", self.reference_every, 1, 1000)
        in_range("averaging_time", self.averaging_time, 0.01, 600.0)
        in_range("tension_rate", self.tension_rate, 1.0, 1e4)
        in_range("steady_force", self.steady_force, 1e-3, 1e3)
        in_range("steady_torque", self.steady_torque, 1e-4, 1e3)
        in_range("retries", self.retries, 0, 100)
        in_range("accuracy", self.accuracy, 0.0, 1.0)
        for name in ("move_timeout", "pretighten_timeout", "measure_timeout"):
            in_range(name, getattr(self, name), 0.1, 3600.0)

    @property
    def limbs(self) -> int:
        """Number of tensions of a path."""
        return len(self.paths[0].peak)

    def is_validation(self, configuration: int) -> bool:
        """Whether a configuration's loads are excluded from the identification."""
        return configuration in self.validation_configurations

    def stops(self, rest_tension: float) -> list[tuple[int, list[Point]]]:
        """Every configuration in order, with its trajectory.

        Args:
            rest_tension: of the unloaded limbs [N].
        """
        here = points(self.paths, self.reference_every, rest_tension)
        there = points(self.validation_paths, self.reference_every, rest_tension)
        return [
            *((number, here) for number in self.configurations),
            *((number, there) for number in self.validation_configurations),
        ]

    def total(self, rest_tension: float) -> int:
        """Number of loads, references included."""
        trajectories = self.stops(rest_tension)
        return len(self.reflectors) * sum(len(trajectory) for _, trajectory in trajectories)


def points(paths: list[TensionPath], reference_every: int, rest_tension: float) -> list[Point]:
    """The trajectory's stops: paths, and references before, between and behind them.

    Args:
        paths: of tensions, in their order.
        reference_every: paths from one reference to the next.
        rest_tension: of every limb at a reference [N].
    """
    found: list[Point] = []
    rest = np.full(len(paths[0].peak) if paths else 0, rest_tension)
    leg = 0
    for number, path in enumerate(paths):
        if number % reference_every == 0:
            found.append(Point(len(found), leg, REFERENCE, rest))
            leg += 1
        for share, branch in _ways(path):
            tension = rest + share * (np.array(path.peak) - rest)
            found.append(Point(len(found), leg, branch, tension))
        leg += 1
    if paths:
        found.append(Point(len(found), leg, REFERENCE, rest))
    return found


def _ways(path: TensionPath) -> Iterator[tuple[float, int]]:
    for share in path.stops:
        yield share, LOADING
    if path.down:
        for share in reversed(path.stops[:-1]):
            yield share, UNLOADING


def load_plan(path: str | Path = "", rig: str | Path | RigFolder = "") -> CampaignPlan:
    """Read a campaign.

    Args:
        path: YAML of the campaign; empty: the campaign.yaml of the rig.
        rig: name or folder, see find_rig; empty: the reference bench. Describes the rig where the
            campaign does not.

    Raises:
        ConfigError: if the file cannot be used; the message names file, key and reason.
    """
    folder = find_rig(rig)
    file = rig_file(PLAN, path, folder)
    missing = {} if "rig" in read_yaml(file) else {"rig": _described(folder)}
    return load_config(CampaignPlan, file, defaults=missing)


def plan_text(path: str | Path = "", rig: str | Path | RigFolder = "") -> str:
    """Text of a campaign that describes its rig itself; see load_plan.

    Args:
        path: of a campaign.yaml; empty: the rig's.
        rig: folder or name of the rig; empty: the bench.

    Raises:
        ConfigError: if the file cannot be used.
    """
    folder = find_rig(rig)
    file = rig_file(PLAN, path, folder)
    content = read_yaml(file)
    text = read_given(file)
    if "rig" in content:
        return text
    described = _described(folder)
    if described["urdf"]:
        described["urdf"] = Path(described["urdf"]).name
    part = yaml.safe_dump({"rig": described}, default_flow_style=None, sort_keys=False)
    return f"{text.rstrip()}\n# The rig, nominal, as its {FRAMES} describes it.\n{part}"


def _described(folder: RigFolder) -> dict[str, Any]:
    """The part `rig` of a campaign; without urdf for the bench's robot, which is installed."""
    robot = folder.file(ROBOT)
    bench = robot.read_bytes() == find_rig().file(ROBOT).read_bytes()
    return {**load_frames(folder).for_campaign(), "urdf": "" if bench else str(robot)}
