# SPDX-License-Identifier: Apache-2.0
"""Vibration of the reference bench along a load programme, and the possible bandwidth of its loops.

This project chose these unpublished values: the platform's radius of gyration, the part of the
robot's wrist that moves with the flange, and the modes' damping.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cabols_control.checks import FloatArray
from cabols_control.kinematics import cable_lengths, structure_matrix
from cabols_control.load_programs.programs import LoadProgram
from cabols_control.rig import ControlConfig, Rig
from cabols_control.tension import distribute
from cabols_control.workspace.elastic import tension_stiffness
from cabols_sim.dynamics.loops import FREQUENCIES, design_margins
from cabols_sim.dynamics.timescales import Fastest, Split, fastest_design, split
from cabols_sim.dynamics.vibration import (
    VibrationModel,
    joint_target,
    rigid_body,
    spring_stiffness,
    string_frequency,
)

PLATFORM_GYRATION_M = 0.10
WRIST_MASS_KG, WRIST_GYRATION_M = 10.0, 0.06
DAMPING_RATIO = 0.02
CABLE_DENSITY = 0.004
"""Of a steel cable of 890 N breaking load, about 1 mm thick [kg/m]."""
LOOP_DELAY_S = 0.0015
"""Delay of a loop: half a sample for holding the current, one for computing and sending it [s]."""


@dataclass(frozen=True, eq=False)
class Held:
    """The platform in a robot's hand.

    Attributes:
        position: (3,) platform origin, base frame [m].
        rotation: (3, 3) from platform to base axes.
        jacobian: (6, 6) of the robot at the platform's origin, base axes.
        joint_stiffness: (6,) [N m/rad].
        platform_mass: on the sensor [kg].
    """

    position: FloatArray
    rotation: FloatArray
    jacobian: FloatArray
    joint_stiffness: FloatArray
    platform_mass: float

    def vibration(self, rig: Rig, tension: ArrayLike) -> VibrationModel:
        """Return the vibrating platform under (n,) tensions [N].

        Args:
            rig: with limbs and geometry.
            tension: (n,) of the cables [N].
        """
        pose = (self.position, self.rotation)
        platform = rigid_body(self.platform_mass, PLATFORM_GYRATION_M)
        return VibrationModel(
            mass=platform + rigid_body(WRIST_MASS_KG, WRIST_GYRATION_M),
            platform_mass=platform,
            target=joint_target(self.jacobian, self.joint_stiffness),
            springs=spring_stiffness(rig.geometry, *pose, rig.springs.nominal),
            tension=tension_stiffness(rig.geometry, *pose, tension),
            damping_ratio=DAMPING_RATIO,
        )


@dataclass(frozen=True, eq=False)
class Frequencies:
    """Natural frequencies along a load programme, k times.

    Attributes:
        time: (k,) [s].
        tension: (k, n) [N].
        held: (k, 6) platform in the robot's hand, rising [rad/s].
        free: (k, 6) the same without the robot, platform on its springs alone [rad/s].
        string: (k, n) first transverse one of every cable [rad/s].
    """

    time: FloatArray
    tension: FloatArray
    held: FloatArray
    free: FloatArray
    string: FloatArray


def along_program(rig: Rig, held: Held, program: LoadProgram, samples: int = 120) -> Frequencies:
    """Frequencies at the settled tensions of a programme's wrenches.

    Args:
        rig: with limbs and geometry.
        held: platform in the robot's hand.
        program: whose wrenches are held.
        samples: evenly spread over the programme.
    """
    time = np.linspace(0.0, program.duration, samples)
    matrix = structure_matrix(rig.geometry, held.position, held.rotation)
    length = cable_lengths(rig.geometry, held.position, held.rotation)
    limits = (rig.control.tension_min, rig.control.tension_max)
    tension, robot, free = [], [], []
    for instant in time:
        pulls = distribute(matrix, program.at(float(instant)), *limits).tension
        model = held.vibration(rig, pulls)
        tension.append(pulls)
        robot.append(model.modes()[0])
        alone = VibrationModel(
            model.platform_mass,
            model.platform_mass,
            np.zeros((6, 6)),
            model.springs,
            model.tension,
            DAMPING_RATIO,
        )
        free.append(alone.modes()[0])
    pulled = np.array(tension)
    strings = string_frequency(pulled, length[None, :], CABLE_DENSITY)
    return Frequencies(time, pulled, np.array(robot), np.array(free), strings)


@dataclass(frozen=True, eq=False)
class TargetCase:
    """One design on a target of some stiffness.

    Attributes:
        factor: of the robot's stiffness.
        first_mode: lowest natural frequency [rad/s].
        split: poles beside those of the slow and the fast model.
        fastest: how far the design may be scaled.
    """

    factor: float
    first_mode: float
    split: Split
    fastest: Fastest


def target_cases(
    rig: Rig, control: ControlConfig, vibration: VibrationModel, factors: Sequence[float]
) -> tuple[TargetCase, ...]:
    """Put a control design on targets of multiples of the robot's stiffness.

    Args:
        rig: with limbs and geometry.
        control: design of both loops.
        vibration: platform in the robot's hand.
        factors: multiples of the robot's stiffness.
    """
    cases = []
    design = Rig(rig.geometry, rig.limbs, control)
    stiffness, models = rig.springs.nominal, rig.limbs.models
    for factor in factors:
        model = vibration.with_target(factor)
        cases.append(
            TargetCase(
                factor,
                float(model.modes()[0][0]),
                split(design.gains, models[0], float(stiffness[0]), model),
                fastest_design(models, stiffness, control.poles, control.zero, model, LOOP_DELAY_S),
            )
        )
    return tuple(cases)


def margin_numbers(rig: Rig) -> dict[str, float]:
    """Margins of a rig's loops with LOOP_DELAY_S; the limbs' are the smallest of all limbs."""
    outer, inner = design_margins(rig.gains, rig.limbs.models, rig.springs.nominal, LOOP_DELAY_S)
    return {
        "wrench_gain_margin_db": 20.0 * float(np.log10(outer.gain)),
        "wrench_phase_margin_deg": float(np.degrees(outer.phase)),
        "wrench_crossover_rad_per_s": outer.crossover,
        "wrench_distance": outer.distance,
        "limb_gain_margin_db": 20.0 * float(np.log10(min(m.gain for m in inner))),
        "limb_gain_reduction_margin_db": 20.0 * float(np.log10(max(m.reduction for m in inner))),
        "limb_phase_margin_deg": float(np.degrees(min(m.phase for m in inner))),
        "limb_crossover_rad_per_s": max(m.crossover for m in inner),
        "limb_delay_margin_ms": 1e3 * min(m.delay for m in inner),
        "limb_distance": min(m.distance for m in inner),
        "delay_assumed_ms": 1e3 * LOOP_DELAY_S,
        "highest_frequency_rad_per_s": float(FREQUENCIES[-1]),
    }
