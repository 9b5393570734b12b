# SPDX-License-Identifier: Apache-2.0
"""Configuration of the laser tracker's client: its place, the reflectors, time limits."""

from __future__ import annotations

from dataclasses import field
from functools import cached_property
from itertools import combinations
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from pydantic.dataclasses import dataclass
from scipy.spatial.transform import Rotation

from cabols_control.checks import FloatArray, finite_array, in_range, rotation_matrix
from cabols_control.configuration import STRICT, load_config
from cabols_control.errors import ConfigError, OutOfRangeError
from cabols_control.frames import FRAMES, load_frames
from cabols_control.registration.rigid_fit import RegistrationError, require_spread
from cabols_control.rig_folder import RigFolder, find_rig, rig_file
from cabols_hw.tracker.beam import BeamNoise


@dataclass(frozen=True, config=STRICT)
class TrackerConfig:
    """The rig's laser tracker. Its nominal values are improved by registration.

    Attributes:
        address: host:port of the tracker's server.
        frame: of the measured points, in message headers.
        reflectors: a row [x, y, z] for each reflector, in platform axes [m]; three or more.
        base_position: [x, y, z] of the tracker in the rig's base frame [m].
        base_rotation_xyz_deg: from tracker to base axes, intrinsic x-y-z Euler angles.
        averaging_time: of a measurement, unless the request gives another [s].
        rate: of the single samples [Hz]; 0 for the tracker's own.
        search_radius: around the expected position [m]; a reflector found farther away from it is
            refused as another one, so it is less than half the distance between two reflectors.
        noise: for the covariance, where the tracker's server reports none.
        rms_max: of the samples of one measurement around their mean [m]; more is a platform that
            moves, or a server that reports in other units.
        averaging_floor: share of the noise's standard deviation that averaging does not remove.
        call_timeout: limit of a call that does not move the beam [s].
        aim_timeout: limit of pointing the beam [s].
        search_timeout: limit of a search [s].
        measure_timeout: limit of a measurement, besides its averaging time [s].
        time_stretch: wall time in a second of the tracker's time; above 1 for a simulated rig in
            slow motion.
    """

    reflectors: list[list[float]]
    base_position: list[float]
    base_rotation_xyz_deg: list[float]
    address: str = "127.0.0.1:50551"
    frame: str = "tracker"
    averaging_time: float = 1.0
    rate: float = 0.0
    search_radius: float = 0.03
    noise: BeamNoise = field(default_factory=BeamNoise)
    rms_max: float = 5e-4
    averaging_floor: float = 0.3
    call_timeout: float = 2.0
    aim_timeout: float = 10.0
    search_timeout: float = 30.0
    measure_timeout: float = 5.0
    time_stretch: float = 1.0

    def __post_init__(self) -> None:
        """Check shapes, ranges and that the reflectors determine a pose."""
        points = finite_array("reflectors", self.reflectors, (None, 3))
        if points.shape[0] < 3:
            raise ConfigError(f"reflectors: expected at least 3, got {points.shape[0]}")
        try:
            require_spread("reflectors", points)
        except RegistrationError as error:
            raise ConfigError(str(error)) from error
        finite_array("base_position", self.base_position, (3,))
        finite_array("base_rotation_xyz_deg", self.base_rotation_xyz_deg, (3,))
        nearest = min(float(np.linalg.norm(a - b)) for a, b in combinations(points, 2))
        in_range("search_radius", self.search_radius, 1e-3, 0.499 * nearest)
        in_range("averaging_time", self.averaging_time, 1e-3, 600.0)
        in_range("rate", self.rate, 0.0, 1e5)
        in_range("rms_max", self.rms_max, 1e-6, 0.1)
        in_range("averaging_floor", self.averaging_floor, 0.0, 1.0)
        for name in ("call_timeout", "aim_timeout", "search_timeout", "measure_timeout"):
            in_range(name, getattr(self, name), 0.05, 600.0)
        in_range("time_stretch", self.time_stretch, 1e-3, 1e3)

    @cached_property
    def reflector_points(self) -> FloatArray:
        """(n, 3) reflectors in platform axes [m]."""
        return np.array(self.reflectors, dtype=np.float64)

    @cached_property
    def base_rotation(self) -> FloatArray:
        """(3, 3) R_BT, from tracker to base axes."""
        angles = self.base_rotation_xyz_deg
        return np.asarray(Rotation.from_euler("XYZ", angles, degrees=True).as_matrix())

    def expected(self, reflector: int, position: ArrayLike, rotation: ArrayLike) -> FloatArray:
        """Return a reflector's expected position, by the nominal frame and offsets.

        Args:
            reflector: index, from 0.
            position: (3,) platform's origin in the base [m].
            rotation: (3, 3) from platform to base axes.

        Returns:
            (3,) in the tracker's frame [m].

        Raises:
            OutOfRangeError: if there is no such reflector.
            ShapeError: if the pose has another shape, is not finite or is no rotation.
        """
        turn = rotation_matrix("rotation", rotation)
        point = finite_array("position", position, (3,)) + turn @ self.point(reflector)
        return np.asarray(self.base_rotation.T @ (point - np.array(self.base_position)))

    def point(self, reflector: int) -> FloatArray:
        """(3,) one reflector in platform axes [m].

        Raises:
            OutOfRangeError: if there is no such reflector.
        """
        if reflector not in range(len(self.reflectors)):
            raise OutOfRangeError("reflector", reflector, 0, len(self.reflectors) - 1)
        return np.asarray(self.reflector_points[reflector])


def load_tracker_config(
    rig: str | Path | RigFolder = "", path: str | Path | None = None
) -> TrackerConfig:
    """Read a rig's laser tracker.

    Args:
        rig: name or folder, see find_rig; empty: the reference bench.
        path: YAML in place of the folder's tracker.yaml; None or empty: the folder's.

    Raises:
        ConfigError: if the file cannot be used; the message names file, key and reason.
    """
    folder = find_rig(rig)
    shared = load_frames(folder).for_tracker()
    return load_config(TrackerConfig, rig_file("tracker.yaml", path, folder), shared, FRAMES)
