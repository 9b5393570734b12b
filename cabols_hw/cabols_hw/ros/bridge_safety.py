# SPDX-License-Identifier: Apache-2.0
"""Limits of the bridge's safety envelope, as a node takes them from its files."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cabols_control.rig import Rig
from cabols_control.rig_checks import check_limits
from cabols_control.rig_folder import RigFolder
from cabols_hw.card.config import CardConfig
from cabols_hw.safety.config import SafetyConfig, load_safety


def bridge_safety(
    rig: Rig, folder: RigFolder, path: str, card: CardConfig, watchdog_s: float
) -> SafetyConfig:
    """Read the limits, and hold them against the rig's others.

    A watchdog longer than the file's also raises the largest ages of samples and poses.

    Args:
        rig: limits of the control.
        folder: of the rig.
        path: of the file; empty: the folder's.
        card: limits of the sensor.
        watchdog_s: age of the newest command that cuts all currents [s].

    Raises:
        ConfigError: if the file cannot be used, or its limits contradict others.
    """
    config = load_safety(folder, path)
    check_limits(
        rig.control.tension_max,
        config.tension_max,
        np.array(config.wrench_max),
        rig.control.rated,
        card.sensor_limits,
    ).settle(folder.path)
    oldest = 2.0 * watchdog_s
    return replace(
        config,
        state_age=max(config.state_age, oldest),
        pose_age=max(config.pose_age, oldest),
    )
