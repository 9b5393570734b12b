# SPDX-License-Identifier: Apache-2.0
"""Read all files of a rig, hold their numbers against each other, and say what was read."""

from __future__ import annotations

import warnings

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.command_line import DONE, CommandParser, command, rig_option
from cabols_control.frames import load_frames
from cabols_control.kinematics import cable_lengths
from cabols_control.rig import Rig, load_rig
from cabols_control.rig_checks import (
    Findings,
    check_geometry,
    check_limbs,
    check_limits,
    check_mounted,
)
from cabols_control.rig_folder import FILES, RigFolder, RigWarning, find_rig
from cabols_hw.abb.configurations import load_configurations
from cabols_hw.abb.speed_limit import check_speed
from cabols_hw.card.config import load_card
from cabols_hw.safety.config import load_safety
from cabols_hw.safety.not_held import not_held
from cabols_hw.tracker.config import load_tracker_config
from cabols_sim.devices.robot.kinematics import load_arm
from cabols_sim.devices.robot.robot_checks import check_robot
from cabols_sim.devices.robot.robot_config import load_robot_truth
from cabols_sim.devices.robot.robot_target import RobotTarget
from cabols_sim.devices.tracker.config import load_tracker_truth
from cabols_sim.plant.config import load_plant

LENGTHS_ALIKE = 0.1
"""Share by which cables may differ in length before one k_e for all is worth a word: cables that
stretch a fifth of what their springs do then differ by 2 % in k_e."""


def check_rig(folder: RigFolder) -> list[str]:
    """Read every file of a rig; return what was read, a line each.

    Args:
        folder: of the rig.

    Raises:
        ConfigError: if a file is missing or cannot be used, or numbers cannot belong together.
    """
    rig, card, safety = load_rig(folder), load_card(folder), load_safety(folder)
    geometry, frames = rig.geometry, load_frames(folder)
    card.wiring.require_limbs(geometry.cables)
    plant = load_plant(folder)
    plant.limbs.require_limbs(geometry.cables)
    plant.geometry(geometry)
    pose = (geometry.reference_position, geometry.reference_rotation)
    lengths = cable_lengths(geometry, *pose)
    found: list[Findings] = [
        check_geometry(geometry.records(), *pose),
        check_limbs(
            rig.springs.nominal,
            rig.limbs.gain,
            lengths,
            rig.control.tension_max,
            rig.control.current_limit,
        ),
        check_mounted("reflectors", np.array(frames.reflectors), geometry.platform_radius),
        check_limits(
            rig.control.tension_max,
            safety.tension_max,
            np.array(safety.wrench_max),
            rig.control.rated,
            card.sensor_limits,
        ),
    ]
    for findings in found:
        findings.settle(folder.path)
    held = _held_by_robot(folder) if safety.platform_held else _hangs(folder)
    cards = "1 card" if card.wiring.cards == 1 else f"{card.wiring.cards} cards on one clock"
    return [
        *(findings.read for findings in found),
        *_one_stiffness(rig, lengths),
        *held,
        f"{card.wiring.limbs} limbs wired to {cards}",
    ]


def _one_stiffness(rig: Rig, lengths: FloatArray) -> list[str]:
    """Say if one k_e stands for cables of quite different (n,) lengths [m]."""
    if isinstance(rig.limbs.stiffness, list) or np.ptp(lengths) <= LENGTHS_ALIKE * lengths.mean():
        return []
    return [
        f"one k_e for cables of {lengths.min():.3g} to {lengths.max():.3g} m: a longer one is "
        "softer, so that steps overshoot; give each limb its own (docs/your_rig.md, Springs)"
    ]


def _held_by_robot(folder: RigFolder) -> list[str]:
    """Check robot and tracker of a rig; return what was read."""
    rig, configurations = load_rig(folder), load_configurations(folder)
    for load in (load_tracker_config, load_tracker_truth):
        load(folder)
    robot = RobotTarget(load_robot_truth(folder), configurations, load_arm(folder))
    findings = check_robot(robot.arm, configurations, rig.geometry)
    findings.settle(folder.path)
    allowed = check_speed(rig, load_safety(folder), load_card(folder), configurations)
    return [
        findings.read,
        f"the robot moves the platform at {1e3 * configurations.speed:.0f} mm/s, "
        f"{1e3 * allowed:.0f} are allowed",
    ]


def _hangs(folder: RigFolder) -> list[str]:
    """Say of a platform that nothing but its cables holds whether it may move."""
    missing = not_held(load_rig(folder), load_safety(folder), load_card(folder))
    if missing is not None:
        return [f"it must not move: {missing.reason}"]
    return ["nothing but the cables holds the platform, and it may move (docs/safety.md)"]


@command
def main() -> int:
    """Check; returns 0, or 1 for a rig that cannot be used."""
    parser = CommandParser("check_rig", __doc__)
    parser.add_argument("folder", nargs="?", default="", help="name or folder; default: --rig")
    rig_option(parser)
    options = parser.parse_args()
    folder = find_rig(options.folder or options.rig)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always", RigWarning)
        lines = check_rig(folder)
    print(f"rig {folder.name} ({folder.path})")
    for line in lines:
        print(f"  {line}")
    for message in dict.fromkeys(str(warning.message) for warning in said):
        print(f"  odd: {message}")
    extra = sorted(
        path.name for path in folder.path.iterdir() if path.name not in {f.name for f in FILES}
    )
    if extra:
        print(f"  not read, unless another file names them: {', '.join(extra)}")
    return DONE


if __name__ == "__main__":
    raise SystemExit(main())
