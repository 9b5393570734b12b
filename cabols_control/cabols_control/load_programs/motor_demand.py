# SPDX-License-Identifier: Apache-2.0
"""How fast a programme may be: the least smoothing for which the motors' current suffices."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import uniform_filter1d

from cabols_control.checks import FloatArray
from cabols_control.kinematics import structure_matrix
from cabols_control.load_programs.preview import PERIOD_S, ShapedProgram, shape_program
from cabols_control.load_programs.programs import LoadProgram
from cabols_control.rig import Rig
from cabols_control.tension import TensionResolver

FASTER = (4.0, 2.8, 2.0, 1.4, 1.0)
"""Bandwidths that are tried, in units of the design's least one."""
CURRENT_SHARE = 0.6
"""Share of the current limit that a preview may take: friction and feedback need the rest."""
WINDOW = 31
"""Points of the moving average before tensions are differentiated: their kinks, where another cable
reaches its least tension, take no current that counts."""


def motor_current(
    rig: Rig, program: LoadProgram, position: FloatArray, rotation: FloatArray
) -> FloatArray:
    """Current that winds the springs along a programme, by (3.11) without friction.

    Args:
        rig: geometry, limbs, tension limits.
        program: wrench that is felt, a point per millisecond.
        position: (3,) platform's origin in the base frame [m].
        rotation: (3, 3) from platform to base axes.

    Returns:
        (k, n) [A].
    """
    matrix = structure_matrix(rig.geometry, position, rotation)
    resolver = TensionResolver(matrix, rig.control.tension_min, rig.control.tension_max)
    tension, _ = resolver.solve_batch(program.wrench + rig.borne(rotation))
    # Beyond its ends a programme rests.
    smooth = uniform_filter1d(tension, WINDOW, axis=0, mode="nearest")
    speed = np.gradient(smooth, PERIOD_S, axis=0) / rig.springs.nominal
    slope = np.gradient(speed, PERIOD_S, axis=0)
    gain, time_constant = np.array(rig.limbs.gain), np.array(rig.limbs.time_constant)
    current = (speed + time_constant * slope) / gain
    return np.asarray(current)


def fastest_preview(
    program: LoadProgram,
    rig: Rig,
    position: FloatArray,
    rotation: FloatArray,
    held_s: float = 0.0,
) -> ShapedProgram:
    """Shape a programme with the least smoothing that the motors bear.

    Args:
        program: as given.
        rig: geometry, limbs, design.
        position: (3,) platform's origin in the base frame [m].
        rotation: (3, 3) from platform to base axes.
        held_s: for how long the wrench law holds each value of the reference [s].

    Returns:
        The programme at the design's least bandwidth, or up to four times as fast.
    """
    least = rig.control.preview_bandwidth
    limit = CURRENT_SHARE * rig.control.current_limit
    for factor in FASTER:
        shaped = shape_program(program, rig.control, held_s, factor * least)
        if np.abs(motor_current(rig, shaped.smoothed, position, rotation)).max() <= limit:
            break
    return shaped
