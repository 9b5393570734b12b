# SPDX-License-Identifier: Apache-2.0
"""Dynamics of cable robots with cables of variable mass: chapter 2 of the source.

`planar_robot`, `robot_of_rig` or `CableRobot` make a model; `mass_matrix`, `bias`, `gravity`,
`inverse_dynamics` and `forward_dynamics` are (2.29) in the source's coordinates; `simulate`
integrates it.
"""

from .body import BodyState, equations
from .energy import kinetic_energy, potential_energy, power
from .lagrange import (
    bias,
    forward_dynamics,
    gravity,
    inverse_dynamics,
    mass_matrix,
    state_at,
    stream,
    transmission,
)
from .robot import (
    CENTRE,
    MATERIAL,
    PLANAR,
    PLANAR_CASE,
    SPATIAL,
    STRETCHING,
    CableModel,
    CableRobot,
    planar_robot,
    robot_of_rig,
)
from .simulation import Trajectory, simulate, winch_springs

__all__ = [
    "CENTRE",
    "MATERIAL",
    "PLANAR",
    "PLANAR_CASE",
    "SPATIAL",
    "STRETCHING",
    "BodyState",
    "CableModel",
    "CableRobot",
    "Trajectory",
    "bias",
    "equations",
    "forward_dynamics",
    "gravity",
    "inverse_dynamics",
    "kinetic_energy",
    "mass_matrix",
    "planar_robot",
    "potential_energy",
    "power",
    "robot_of_rig",
    "simulate",
    "state_at",
    "stream",
    "transmission",
    "winch_springs",
]
