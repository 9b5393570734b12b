# SPDX-License-Identifier: Apache-2.0
"""New places of the files and keys of 0.1, for migration by people or programs."""

from __future__ import annotations

from typing import NamedTuple

FILES_OF_0_1 = {
    "bench_geometry.yaml": "geometry.yaml",
    "designed_geometry.yaml": "geometry_designed.yaml",
    "bench_limbs.yaml": "limbs.yaml",
    "bench_control.yaml": "control.yaml",
    "fast_control.yaml": "control_fast.yaml",
    "bench_bodies.yaml": "bodies.yaml",
    "bench_arm_bodies.yaml": "bodies_arm.yaml",
    "bench_scene.yaml": "",
    "bench_card.yaml": "card.yaml",
    "bench_delta.cal": "sensor.cal",
    "bench_safety.yaml": "safety.yaml",
    "bench_robot_configurations.yaml": "robot.yaml",
    "bench_tracker.yaml": "tracker.yaml",
    "bench_plant.yaml": "plant.yaml",
    "bench_robot.yaml": "robot_truth.yaml",
    "bench_tracker_truth.yaml": "tracker_truth.yaml",
    "bench_campaign.yaml": "campaign.yaml",
    "irb1600_6_145.urdf": "robot.urdf",
}
"""Name of 0.1 and name in a rig's folder; empty: no longer needed."""


class Move(NamedTuple):
    """A key that went to another file.

    Attributes:
        file: of 0.1, by its new name; scene.yaml is the old scene.
        key: in it, dotted.
        target: file that has it now; empty: nowhere, it is read from elsewhere.
        target_key: dotted.
    """

    file: str
    key: str
    target: str
    target_key: str


KEYS_OF_0_1 = (
    Move("card.yaml", "tool_mass", "frames.yaml", "tool_mass"),
    Move("card.yaml", "tool_centre_of_mass", "frames.yaml", "tool_centre_of_mass"),
    Move("card.yaml", "sensor_position", "frames.yaml", "sensor_frame.position"),
    # A (3, 3) matrix, from sensor to platform axes.
    Move("card.yaml", "sensor_rotation", "frames.yaml", "sensor_frame.rotation_xyz_deg"),
    Move("robot.yaml", "tool_position", "frames.yaml", "tool_frame.position"),
    Move("robot.yaml", "tool_quaternion", "frames.yaml", "tool_frame.quaternion_wxyz"),
    Move("tracker.yaml", "reflectors", "frames.yaml", "reflectors"),
    Move("tracker.yaml", "base_position", "frames.yaml", "tracker_frame.position"),
    Move("tracker.yaml", "base_rotation_xyz_deg", "frames.yaml", "tracker_frame.rotation_xyz_deg"),
    Move("campaign.yaml", "rig", "frames.yaml", ""),
    Move("scene.yaml", "reflectors", "frames.yaml", "reflectors"),
    Move("scene.yaml", "tracker", "frames.yaml", "tracker_frame.position"),
    Move("scene.yaml", "joint_offsets", "robot.urdf", ""),
    Move("scene.yaml", "joint_axes", "robot.urdf", ""),
    Move("scene.yaml", "flange", "robot.urdf", ""),
    Move("plant.yaml", "limbs.gain", "limbs.yaml", "gain"),
    Move("plant.yaml", "limbs.time_constant", "limbs.yaml", "time_constant"),
    Move("plant.yaml", "sensors.switch_tension", "limbs.yaml", "switch_tension"),
    # A force; the mass times standard gravity.
    Move("plant.yaml", "sensors.tool_weight", "frames.yaml", "tool_mass"),
    Move("plant.yaml", "sensors.tool_centre_of_mass", "frames.yaml", "tool_centre_of_mass"),
)
"""The old keys are still read where they stand; those that moved to frames.yaml must agree with it,
those of plant.yaml are the simulation's truth and may differ."""
