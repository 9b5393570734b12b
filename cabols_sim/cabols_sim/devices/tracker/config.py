# SPDX-License-Identifier: Apache-2.0
"""True values of the simulated laser tracker, unknown to its client."""

from __future__ import annotations

from dataclasses import field
from functools import cached_property
from pathlib import Path

import numpy as np
from pydantic.dataclasses import dataclass
from scipy.spatial.transform import Rotation

from cabols_control.checks import FloatArray, finite_array, in_range
from cabols_control.configuration import STRICT, load_config
from cabols_control.frames import load_frames
from cabols_control.rig_folder import RigFolder, find_rig
from cabols_hw.tracker.beam import BeamNoise


@dataclass(frozen=True, config=STRICT)
class DriftConfig:
    """Slow errors of the instrument: a warm-up that decays, and a drift that does not.

    Attributes:
        age: time since switch-on when the simulation starts [s].
        warm_up_time: time constant of the warm-up [s].
        warm_up_radial: of the distance, at switch-on, standard deviation over seeds [m].
        warm_up_angle: of both angles, likewise [rad].
        wander_radial: of the distance, standard deviation [m].
        wander_angle: of both angles, standard deviation [rad].
        wander_time: fastest period of the wandering [s]; the slowest is ten times that.
        warm_below: expected remaining warm-up at 3 m under which it counts as over [m].
    """

    age: float = 5400.0
    warm_up_time: float = 1800.0
    warm_up_radial: float = 10e-6
    warm_up_angle: float = 15e-6
    wander_radial: float = 0.5e-6
    wander_angle: float = 0.5e-6
    wander_time: float = 600.0
    warm_below: float = 10e-6

    def __post_init__(self) -> None:
        """Check ranges."""
        in_range("age", self.age, 0.0, 1e7)
        in_range("warm_up_time", self.warm_up_time, 1.0, 1e6)
        in_range("wander_time", self.wander_time, 1.0, 1e6)
        for name in ("warm_up_radial", "warm_up_angle", "wander_radial", "wander_angle"):
            in_range(name, getattr(self, name), 0.0, 1e-2)
        in_range("warm_below", self.warm_below, 1e-9, 1.0)


@dataclass(frozen=True, config=STRICT)
class TrackerTruthConfig:
    """The simulated tracker, and the true places of it and the reflectors.

    Attributes:
        reflectors: a row for each reflector, in platform axes [m].
        reflector_axis: where the reflectors look, in platform axes; any length but zero.
        acceptance_deg: greatest angle between that axis and the beam.
        base_position: of the tracker in the rig's base frame [m].
        base_rotation_xyz_deg: from tracker to base axes, intrinsic x-y-z Euler angles.
        noise: of one sample.
        averaging_floor: part of its standard deviation that no averaging removes (air, mostly).
        drift: slow errors.
        rate: of the samples, if the client does not say [Hz].
        max_speed: of a reflector; the beam breaks above it [m/s].
        nearest: least distance that the tracker measures [m].
        farthest: greatest distance [m].
        capture_radius: how far beside the aimed beam a reflector is still caught [m].
        aim_time: that pointing takes [s].
        search_speed: of the beam's spiral, area per time [m^2/s].
        temperature: of the air [degrees Celsius].
        wall_limit: greatest wall time that a call waits for the rig's time to pass [s].
        seed: of noise and drift.
    """

    reflectors: list[list[float]]
    base_position: list[float]
    base_rotation_xyz_deg: list[float]
    reflector_axis: list[float] = field(default_factory=lambda: [0.0, 1.0, 0.0])
    acceptance_deg: float = 60.0
    noise: BeamNoise = field(default_factory=BeamNoise)
    averaging_floor: float = 0.3
    drift: DriftConfig = field(default_factory=DriftConfig)
    rate: float = 1000.0
    max_speed: float = 0.5
    nearest: float = 0.5
    farthest: float = 50.0
    capture_radius: float = 0.002
    aim_time: float = 0.1
    search_speed: float = 0.005
    temperature: float = 20.0
    wall_limit: float = 60.0
    seed: int = 1

    def __post_init__(self) -> None:
        """Check shapes and ranges."""
        finite_array("reflectors", self.reflectors, (None, 3))
        axis = finite_array("reflector_axis", self.reflector_axis, (3,))
        in_range("length of reflector_axis", float(np.linalg.norm(axis)), 1e-6, 1e6)
        finite_array("base_position", self.base_position, (3,))
        finite_array("base_rotation_xyz_deg", self.base_rotation_xyz_deg, (3,))
        in_range("acceptance_deg", self.acceptance_deg, 1.0, 180.0)
        in_range("averaging_floor", self.averaging_floor, 0.0, 1.0)
        in_range("rate", self.rate, 1.0, 1e5)
        in_range("max_speed", self.max_speed, 1e-3, 1e3)
        in_range("nearest", self.nearest, 1e-3, self.farthest)
        in_range("farthest", self.farthest, self.nearest, 1e3)
        in_range("capture_radius", self.capture_radius, 1e-5, 1.0)
        in_range("aim_time", self.aim_time, 0.0, 60.0)
        in_range("search_speed", self.search_speed, 1e-6, 1e3)
        in_range("temperature", self.temperature, -30.0, 60.0)
        in_range("wall_limit", self.wall_limit, 0.01, 3600.0)

    @cached_property
    def reflector_points(self) -> FloatArray:
        """(n, 3) reflectors in platform axes [m]."""
        return np.array(self.reflectors, dtype=np.float64)

    @cached_property
    def base_rotation(self) -> FloatArray:
        """(3, 3) from tracker to base axes."""
        angles = self.base_rotation_xyz_deg
        return np.asarray(Rotation.from_euler("XYZ", angles, degrees=True).as_matrix())


def load_tracker_truth(
    rig: str | Path | RigFolder = "", path: str | Path | None = None
) -> TrackerTruthConfig:
    """Read the true values of a rig's simulated tracker; nominal where the file has none.

    Args:
        rig: name or folder, see find_rig; empty: the reference bench.
        path: YAML in place of the folder's tracker_truth.yaml; None or empty: the folder's.

    Raises:
        ConfigError: if the file cannot be used; the message names file, key and reason.
    """
    folder = find_rig(rig)
    nominal = load_frames(folder).for_tracker()
    file = Path(path) if path else folder.optional("tracker_truth.yaml")
    if file is None:
        return TrackerTruthConfig(**nominal)
    return load_config(TrackerTruthConfig, file, defaults=nominal)
