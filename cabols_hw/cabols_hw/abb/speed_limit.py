# SPDX-License-Identifier: Apache-2.0
"""How fast the robot may move the platform while the cables' motors are held; pure.

If everything of the rig dies at once, the gears hold and the robot goes on for the heartbeat's
silence, then brakes. On that way each cable is stretched by at most the way itself, and the
platform is pulled back by the cables' stiffness A k_e A^T.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from cabols_control.checks import finite_array, in_range
from cabols_control.errors import ConfigError
from cabols_control.kinematics import structure_matrix
from cabols_control.rig import Rig
from cabols_hw.abb.configurations import RobotConfigurations
from cabols_hw.abb.heartbeat import PERIOD_S, SILENCE_S
from cabols_hw.card.config import CardConfig
from cabols_hw.safety.config import SafetyConfig

FREE_N = 15.0
"""Largest tension of a cable that follows a moving robot [N]."""


def allowed_speed(
    rig: Rig,
    tension_max: float,
    wrench_max: ArrayLike,
    sensor_limits: ArrayLike,
    brake_s: float,
    tension: ArrayLike | None = None,
) -> float:
    """Return the highest speed of the platform's origin [m/s].

    Args:
        rig: its cables, at the reference pose.
        tension_max: of a cable [N].
        wrench_max: (6,) that the safety envelope allows [N, N m].
        sensor_limits: (6,) range of the sensor [N, N m].
        brake_s: how long the robot takes to stand once it stops [s].
        tension: (n,) of the cables at the start [N]; None: FREE_N, of cables that follow.

    Raises:
        ShapeError, OutOfRangeError: if an argument cannot be used.
    """
    envelope = finite_array("wrench_max", wrench_max, (6,))
    sensor = finite_array("sensor_limits", sensor_limits, (6,))
    in_range("tension_max", tension_max, FREE_N, 1e6)
    in_range("brake_s", brake_s, 0.0, 10.0)
    geometry = rig.geometry
    pose = geometry.reference_position, geometry.reference_rotation
    directions = structure_matrix(geometry, *pose)[:3]
    springs = rig.springs.nominal
    platform = np.linalg.eigvalsh((directions * springs) @ directions.T).max()
    pulls = np.full(geometry.cables, FREE_N)
    if tension is not None:
        pulls = np.maximum(finite_array("tension", tension, (geometry.cables,)), 0.0)
    held = np.linalg.norm(directions @ pulls)
    force = float(np.minimum(envelope[:3], sensor[:3]).min()) - held
    way = min(float(((tension_max - pulls) / springs).min()), force / platform)
    return float(max(way, 0.0) / (SILENCE_S + PERIOD_S + 0.5 * brake_s))


def check_speed(
    rig: Rig, safety: SafetyConfig, card: CardConfig, configurations: RobotConfigurations
) -> float:
    """Return the highest speed of the platform's origin that a rig's files allow [m/s].

    Args:
        rig: its cables, at the reference pose.
        safety: limits of the envelope.
        card: range of the sensor.
        configurations: speed and braking of the robot.

    Raises:
        ConfigError: if the robot's speed is beyond it.
    """
    limits = safety.tension_max, safety.wrench_max, card.sensor_limits
    allowed = allowed_speed(rig, *limits, configurations.brake)
    if not configurations.speed <= allowed:
        raise ConfigError(
            f"speed of the robot: expected at most {1e3 * allowed:.0f} mm/s, at which it stands "
            "before the held cables pull too hard once the rig has died, got "
            f"{1e3 * configurations.speed:.0f} mm/s; lower it in robot.yaml and in cabols.mod"
        )
    return allowed
