# SPDX-License-Identifier: Apache-2.0
"""Where a rig's tool, sensor, tracker and reflectors are: one file for all packages."""

from __future__ import annotations

from dataclasses import field
from typing import Annotated, Any

from pydantic.dataclasses import dataclass

from cabols_control.checks import finite_array
from cabols_control.configuration import STRICT, load_config, within
from cabols_control.geometry import RigGeometry
from cabols_control.placement import Frame
from cabols_control.rig_folder import RigFolder, find_rig
from cabols_control.wrench_control.frames import WrenchFrame, WrenchFrames, wrench_frames
from cabols_control.wrench_control.uncertainty import (
    UncertaintyConfig,
    WrenchUncertainty,
    uncertainty_sources,
)

__all__ = [
    "FRAMES",
    "Frame",
    "RigFrames",
    "load_frames",
    "load_wrench_frames",
    "load_wrench_uncertainty",
]

FRAMES = "frames.yaml"


@dataclass(frozen=True, config=STRICT)
class RigFrames:
    """Nominal places of the devices mounted on a rig.

    Attributes:
        tool_frame: the platform, in the robot's flange.
        tracker_frame: the laser tracker, in the rig's base frame.
        reflectors: a row [x, y, z] for each, in platform axes [m].
        tool_mass: of all that hangs on the force/torque sensor [kg].
        tool_centre_of_mass: (3,) of it, from the platform's origin, platform axes [m].
        sensor_frame: the force/torque sensor, in the platform.
        wrench_frames: frames of the user's, by name, in which wrenches may be desired.
        wrench_uncertainty: largest errors of sensor, tool, pose and frames that are believed in.
    """

    tool_frame: Frame
    tracker_frame: Frame
    reflectors: list[list[float]]
    tool_mass: Annotated[float, within(0.0, 1000.0)] = 0.0
    tool_centre_of_mass: list[float] = field(default_factory=lambda: [0.0] * 3)
    sensor_frame: Frame = field(default_factory=lambda: Frame([0.0] * 3))
    wrench_frames: dict[str, WrenchFrame] = field(default_factory=dict)
    wrench_uncertainty: UncertaintyConfig = field(default_factory=UncertaintyConfig)

    def __post_init__(self) -> None:
        """Check shapes."""
        finite_array("reflectors", self.reflectors, (None, 3))
        finite_array("tool_centre_of_mass", self.tool_centre_of_mass, (3,))

    def for_card(self) -> dict[str, Any]:
        """Fields of the card's configuration that stand in this file."""
        return {
            "sensor_position": self.sensor_frame.position,
            "sensor_rotation": self.sensor_frame.rotation.tolist(),
            "tool_mass": self.tool_mass,
            "tool_centre_of_mass": self.tool_centre_of_mass,
        }

    def for_robot(self) -> dict[str, Any]:
        """Fields of the robot's configurations that stand in this file."""
        return {
            "tool_position": self.tool_frame.position,
            "tool_quaternion": self.tool_frame.wxyz,
        }

    def for_tracker(self) -> dict[str, Any]:
        """Fields of the tracker's configuration that stand in this file."""
        return {
            "reflectors": self.reflectors,
            "base_position": self.tracker_frame.position,
            "base_rotation_xyz_deg": self.tracker_frame.xyz_deg,
        }

    def for_campaign(self) -> dict[str, Any]:
        """The part `rig` of a campaign, which describes the rig that it is for."""
        return {
            **self.for_robot(),
            "reflectors": self.reflectors,
            "tool_mass": self.tool_mass,
            "tool_centre_of_mass": self.tool_centre_of_mass,
            "tracker_position": self.tracker_frame.position,
            "tracker_rotation_xyz_deg": self.tracker_frame.xyz_deg,
        }


def load_frames(rig: str | RigFolder = "") -> RigFrames:
    """Read a rig's frames; empty: the reference bench's.

    Raises:
        ConfigError: naming the file, the key, what was expected and what came.
    """
    return load_config(RigFrames, find_rig(rig).file(FRAMES))


def load_wrench_frames(geometry: RigGeometry, rig: str | RigFolder = "") -> WrenchFrames:
    """Read the frames in which a rig's wrenches may be desired.

    Args:
        geometry: names of base and platform frame.
        rig: name or folder, see find_rig; empty: the reference bench.

    Raises:
        ConfigError: naming the file, the key, what was expected and what came.
    """
    frames = load_frames(rig)
    names = (geometry.base_frame, geometry.platform_frame)
    return wrench_frames(*names, frames.tool_frame, frames.sensor_frame, frames.wrench_frames)


def load_wrench_uncertainty(
    frames: WrenchFrames, rig: str | RigFolder = "", config: UncertaintyConfig | None = None
) -> WrenchUncertainty:
    """Read how well a rig's wrenches are known.

    Args:
        frames: of the rig.
        rig: name or folder, see find_rig; empty: the reference bench.
        config: other errors than those of the rig's file; None: these.

    Raises:
        ConfigError: naming the file, the key, what was expected and what came.
    """
    known = load_frames(rig)
    sources = uncertainty_sources(
        config or known.wrench_uncertainty,
        known.tool_mass,
        known.tool_centre_of_mass,
        known.sensor_frame,
    )
    return WrenchUncertainty(sources, frames)
