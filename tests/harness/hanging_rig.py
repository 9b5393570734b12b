# SPDX-License-Identifier: Apache-2.0
"""A rig whose platform hangs on its cables alone, and what happens when the amplifiers go off."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cabols_control.kinematics import structure_matrix
from cabols_control.limb_control.controller import TensionSetpoint
from cabols_control.rig import GearConfig
from cabols_control.supervision.modes import OperatingMode
from cabols_control.tension import distribute
from cabols_control.workspace.suspension import payout_speeds, sinking_speed
from cabols_sim.plant.free_platform import FreePlatform, RigidBody
from one_process import OneProcess

MASS = 4.0
CENTRE = np.array([0.01, -0.01, -0.02])
INERTIA = np.diag([0.02, 0.02, 0.03])
DAMPING = (2.0, 2.0, 2.0, 0.02, 0.02, 0.02)
GEARS = {
    "self-locking": {"self_locking": True},
    "friction of the bench": {"coulomb_current": 0.03, "load_current": 2e-4},
    "gives way slowly": {"coulomb_current": 0.005, "load_current": 5e-4},
    "gives way": {"coulomb_current": 0.002, "load_current": 2e-3},
}
"""True gears."""
KINDS = ("supply lost", "stop while it rises", "controller killed", "cable breaks")
WATCHDOG_S = 0.01


@dataclass(frozen=True)
class Fall:
    """What a platform did.

    Attributes:
        sank: how far its weight sank from where it was highest before [m].
        speed: the largest mean speed at which it sank over 0.5 s [m/s].
        fastest: the largest speed of its centre of mass [m/s].
        tension: the largest of any cable [N].
        bound: the sinking speed that the gears allow, over all poses on the way [m/s].
        slack: what the cables' stretch adds to the way [m].
    """

    sank: float
    speed: float
    fastest: float
    tension: float
    bound: float
    slack: float


def believed_gear(gear):
    """What limbs.yaml says of a true gear: its numbers, of which half the friction is counted."""
    if gear.get("self_locking"):
        return GearConfig(self_locking=True)
    return GearConfig(friction_current=gear["coulomb_current"], load_current=gear["load_current"])


def hanging(rig, card, plant_config, gear, seed=1):
    """A rig under tension control whose stand has just been taken away."""
    limbs = replace(plant_config.limbs, **gear)
    target = FreePlatform(rig.geometry, RigidBody.checked(MASS, CENTRE, INERTIA), DAMPING)
    bench = OneProcess(rig, card, replace(plant_config, limbs=limbs), seed, target)
    bench.pretighten()
    matrix = structure_matrix(rig.geometry, target.position, target.rotation)
    found = distribute(matrix, -weight(target), 12.0, 100.0)
    bench.setpoint = TensionSetpoint(0.0, found.tension, True)
    bench.mode = OperatingMode.LOADING
    bench.run(1.5)
    target.release()
    bench.run(0.2)
    return bench


def weight(target):
    """(6,) about the platform's origin."""
    force = np.array([0.0, 0.0, -9.80665 * MASS])
    return np.concatenate([force, np.cross(target.rotation @ CENTRE, force)])


def let_go(bench, kind, gear, duration_s=3.0, limb=None):
    """Cause a fault after which the amplifiers are off; follow the platform."""
    plant, target = bench.plant, bench.target
    if kind == "controller killed":
        # The last currents stay until the card's watchdog ends them.
        for _ in range(round(WATCHDOG_S / 1e-3)):
            plant.advance(1e-3)
    if kind == "stop while it rises":
        lift = np.array([0.0, 0.0, 5.0, 0.0, 0.0, 0.0])
        matrix = structure_matrix(bench.rig.geometry, target.position, target.rotation)
        found = distribute(matrix, lift - weight(target), 12.0, 100.0)
        bench.setpoint = TensionSetpoint(0.0, found.tension, True)
        bench.run(0.1)
    if kind == "cable breaks":
        plant.inject("cable_break", limb)
    plant.enabled = False
    plant.drive(np.zeros(plant.tension.size))
    heights, tension, fastest, bound = [], 0.0, 0.0, 0.0
    stretch = float(plant.tension.max()) / 2200.0
    believed = replace(bench.rig.limbs, gear=believed_gear(gear))
    for step in range(round(duration_s / 1e-3)):
        plant.advance(1e-3)
        arm = target.rotation @ CENTRE
        heights.append(float(target.position[2] + arm[2]))
        speed = target.twist[:3] + np.cross(target.twist[3:], arm)
        fastest = max(fastest, float(np.linalg.norm(speed)))
        tension = max(tension, float(plant.tension.max()))
        if step % 100 == 0:
            pose = (target.position, target.rotation)
            payout = payout_speeds(believed, np.full(plant.tension.size, tension))
            bound = max(bound, sinking_speed(bench.rig.geometry, *pose, weight(target), payout))
    heights = np.array(heights)
    falls = (heights[:-500] - heights[500:]) / 0.5
    return Fall(
        sank=float((np.maximum.accumulate(heights) - heights).max()),
        speed=float(falls.max()),
        fastest=fastest,
        tension=tension,
        bound=bound,
        slack=max(stretch, tension / 2200.0),
    )
