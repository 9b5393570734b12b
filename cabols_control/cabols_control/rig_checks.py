# SPDX-License-Identifier: Apache-2.0
"""A rig's numbers against each other: mistakes that no number shows by itself.

Points in millimetres, platform and frame swapped, a cable twice, a stiffness in N/mm, limits of two
files that disagree. What cannot be is refused, what is odd is warned of; both say what was read.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from cabols_control.cable_kernels import cable_lengths_unchecked
from cabols_control.checks import BoolArray, FloatArray
from cabols_control.errors import ConfigError
from cabols_control.naming import cable_name, cable_names, limb_name
from cabols_control.rig_folder import RigWarning

FRAME_MAX_M, FRAME_ODD_M = 1000.0, 100.0
"""Largest side of a frame; larger ones are refused, or warned of: millimetres?"""
FRAME_LEAST_M = 0.05
SAME_M = 1e-6
STRETCH_MAX, STRETCH_ODD = 2.0, 0.25
"""Elongation of a limb at the largest tension, as a share of its cable's length."""
STRETCH_LEAST_M = 1e-5
SPEED_MAX_M_S = 100.0
"""Steady speed of a cable at the current's limit."""
PULLEY_SHARE, PULLEY_LEAST_M = 0.25, 1e-3
"""Radius of a pulley: largest share of the frame's size; smaller ones than the least are odd."""
FAR = 4.0
"""Distance of a point from the middle of all of them, in the median's, beyond which it is odd."""
INSIDE = 0.02
"""Way of a cable through the body of the platform, in platform sizes, that is odd."""
REACH = 5.0
"""Distance of what is mounted on the platform from its origin, in platform radii."""


@dataclass
class Findings:
    """What a check found.

    Attributes:
        read: meaning of the numbers, for a person who knows the rig.
        refused: mistakes.
        odd: what may be a mistake.
    """

    read: str = ""
    refused: list[str] = field(default_factory=list)
    odd: list[str] = field(default_factory=list)

    def settle(self, source: object) -> None:
        """Warn of what is odd, refuse what is wrong.

        Args:
            source: file or folder that the numbers are of.

        Raises:
            ConfigError: if anything is wrong.
        """
        if self.refused:
            raise ConfigError(f"{source}: {'; '.join(self.refused)}; read: {self.read}")
        if self.odd:
            warnings.warn(
                f"{source}: {'; '.join(self.odd)}; read: {self.read}", RigWarning, stacklevel=3
            )


def check_geometry(cables: Any, position: FloatArray, rotation: FloatArray) -> Findings:
    """Look at attachment points and reference pose.

    Args:
        cables: (n,) records of CABLE.
        position: (3,) of the platform at the reference pose, base frame [m].
        rotation: (3, 3) from platform to base axes.
    """
    found = Findings()
    base_points, platform_points = cables["base"], cables["platform"]
    sides = np.ptp(base_points, axis=0)
    size, radius = float(sides.max()), float(np.linalg.norm(platform_points, axis=1).max())
    lengths = cable_lengths_unchecked(cables, position, rotation)
    found.read = (
        f"frame {' x '.join(f'{side:.3g}' for side in sides)} m, platform radius {radius:.3g} m, "
        f"{lengths.size} cables of {lengths.min():.3g} to {lengths.max():.3g} m"
    )
    wheels = cables["radius"]
    if wheels.any():
        found.read += f", pulleys of {wheels.min():.3g} to {wheels.max():.3g} m"
        if not wheels.max() <= PULLEY_SHARE * size:
            found.refused.append(
                f"pulley_radius: expected metres, got {wheels.max():.4g} in a frame of {size:.3g} "
                "m; millimetres?"
            )
        elif wheels[wheels > 0.0].min() < PULLEY_LEAST_M:
            found.odd.append(f"pulley_radius: {wheels[wheels > 0.0].min():.3g} m; metres?")
    if not 2.0 * radius <= size:
        found.refused.append(
            f"platform: expected smaller than the frame, got {2.0 * radius:.3g} m across in a "
            f"frame of {size:.3g} m; are base_points and platform_points swapped, or one of them "
            "in millimetres?"
        )
    if size > FRAME_MAX_M:
        found.refused.append(
            f"base_points: expected metres, got a frame of {size:.3g} m; millimetres?"
        )
    elif size > FRAME_ODD_M or size < FRAME_LEAST_M:
        found.odd.append(f"base_points: a frame of {size:.3g} m; is that in metres?")
    away = float(np.linalg.norm(position - base_points.mean(axis=0)))
    if away > float(np.linalg.norm(sides)):
        found.refused.append(
            f"reference_pose: expected the platform in its frame, got it {away:.3g} m from the "
            "frame's middle; is the position in the base frame, in metres?"
        )
    held = position + platform_points @ rotation.T
    for name, points in (("base_points", base_points), ("platform_points", platform_points)):
        distances = np.linalg.norm(points - np.median(points, axis=0), axis=1)
        far, usual = int(distances.argmax()), float(np.median(distances))
        if distances[far] > FAR * usual > 0.0:
            found.odd.append(
                f"{name}: {cable_name(far)} is {distances[far]:.3g} m from the others' middle, "
                f"most are {usual:.3g} m; a slip of the pen, or another unit?"
            )
    within, ways = _inside_platform(base_points, held)
    if within.any():
        found.refused.append(
            "base_points: expected outside the platform, got inside it at the reference pose for "
            f"{cable_names(np.flatnonzero(within))}; are they in the base frame?"
        )
    elif (ways > INSIDE).any():
        found.odd.append(
            "platform_points: at the reference pose the platform's body is in the way of "
            f"{cable_names(np.flatnonzero(ways > INSIDE))}; are points exchanged or mirrored?"
        )
    for i in range(lengths.size):
        for j in range(i):
            apart = max(
                np.abs(base_points[i] - base_points[j]).max(),
                np.abs(platform_points[i] - platform_points[j]).max(),
            )
            if apart < SAME_M:
                found.refused.append(
                    f"cables: expected each once, got {limb_name(j)} and {limb_name(i)} between "
                    "the same points"
                )
    return found


def check_reach(lengths: FloatArray, shortest: float, longest: float) -> Findings:
    """Look at the reference pose beside the limits of the cables' lengths.

    Args:
        lengths: (n,) of the cables at the reference pose [m].
        shortest: limit [m].
        longest: limit; inf for none [m].
    """
    found = Findings(f"cables of {lengths.min():.3g} to {lengths.max():.3g} m")
    if not (shortest <= lengths.min() and lengths.max() <= longest):
        found.odd.append(
            f"cable_length_min, cable_length_max: {shortest:g} to {longest:g} m, which the "
            "reference pose is beyond; every map leaves it out"
        )
    return found


def check_motion(name: str, across: FloatArray, size: float) -> Findings:
    """Look at the plane that a planar platform moves in.

    Args:
        name: of the motion.
        across: (n,) of each cable, from its platform point across the plane [m].
        size: of the frame [m].
    """
    largest = float(np.abs(across).max())
    found = Findings(f"cables leave the plane by up to {largest:.3g} m")
    if largest > 1e-6 * size:
        found.odd.append(
            f"motion: {name}, but the cables pull across that plane; what guides the platform must "
            "bear it, as no map counts it"
        )
    return found


def _inside_platform(base: FloatArray, held: FloatArray) -> tuple[BoolArray, FloatArray]:
    """Which base points are inside the hull of the platform's points, and each cable's way in it.

    Args:
        base: (n, 3) [m].
        held: (n, 3) platform points at the reference pose, base frame [m].

    Returns:
        (n,) flags, and (n,) ways in sizes of the platform; none for platforms without a body.
    """
    nothing = np.zeros(len(base), dtype=np.bool_), np.zeros(len(base))
    middle = held.mean(axis=0)
    _, spread, axes = np.linalg.svd(held - middle, full_matrices=False)
    rank = int((spread > 1e-6 * max(float(spread[0]), 1e-12)).sum())
    if rank < 2:
        return nothing
    plane, normal = axes[:rank], axes[rank:]
    start, way = (held - middle) @ plane.T, (base - held) @ plane.T
    try:
        hull = ConvexHull(start)
    except QhullError:
        return nothing
    size = float(np.ptp(start, axis=0).max())
    # Sides of the body, drawn in a little: a cable may run along one of them.
    outward, offset = hull.equations[:, :-1], hull.equations[:, -1] + 1e-3 * size
    # A flat body is only run through by what lies in its plane.
    out_of_plane = np.abs((base - middle) @ normal.T).max(axis=1, initial=0.0) > 1e-3 * size
    within = ((start + way) @ outward.T + offset < 0.0).all(axis=1) & ~out_of_plane
    speed, gap = way @ outward.T, -(start @ outward.T + offset)
    with np.errstate(divide="ignore", invalid="ignore"):
        at = np.where(speed == 0.0, np.where(gap < 0.0, np.inf, -np.inf), gap / speed)
    enters = np.where(speed <= 0.0, at, -np.inf).max(axis=1).clip(0.0)
    leaves = np.where(speed > 0.0, at, np.inf).min(axis=1).clip(None, 1.0)
    ways = np.maximum(leaves - enters, 0.0) * np.linalg.norm(way, axis=1) / size
    return within, np.where(out_of_plane, 0.0, ways)


def check_limbs(
    stiffness: FloatArray,
    gain: list[float],
    lengths: FloatArray,
    tension_max: float,
    current_limit: float,
) -> Findings:
    """Look at limbs beside the cables that they pull.

    Args:
        stiffness: (n,) k_e [N/m].
        gain: (n,) of the limbs [m/s/A].
        lengths: (n,) of the cables at the reference pose [m].
        tension_max: largest tension that control commands [N].
        current_limit: [A].
    """
    softest, stiffest = float(stiffness.min()), float(stiffness.max())
    stretch, speed = tension_max / softest, max(gain) * current_limit
    least = tension_max / stiffest
    each = f"{softest:.4g}" if softest == stiffest else f"{softest:.4g} to {stiffest:.4g}"
    found = Findings(
        f"k_e {each} N/m: {stretch:.3g} m at {tension_max:.4g} N, cables of "
        f"{lengths.min():.3g} to {lengths.max():.3g} m; {speed:.3g} m/s at {current_limit:.3g} A"
    )
    if stretch > STRETCH_MAX * lengths.max():
        found.refused.append(
            f"stiffness: expected N/m, got {softest:.4g}, by which {tension_max:.4g} N stretch a "
            f"limb by {stretch:.3g} m; N/mm?"
        )
    elif stretch > STRETCH_ODD * lengths.min() or least < STRETCH_LEAST_M:
        found.odd.append(f"stiffness: {each} N/m; is that in N/m?")
    if speed > SPEED_MAX_M_S:
        found.refused.append(
            f"gain: expected m/s/A, got up to {max(gain):.4g}, by which {current_limit:.3g} A wind "
            f"a cable at {speed:.3g} m/s; mm/s/A?"
        )
    return found


def check_mounted(name: str, points: FloatArray, platform_radius: float) -> Findings:
    """Look at what is mounted on the platform.

    Args:
        name: of the points, for messages.
        points: (k, 3) in the platform frame [m].
        platform_radius: of the attachment points [m].
    """
    away = float(np.linalg.norm(points, axis=1).max()) if points.size else 0.0
    found = Findings(f"{name} up to {away:.3g} m from the platform's origin")
    if away > REACH * platform_radius:
        found.odd.append(
            f"{name}: {away:.3g} m from a platform of radius {platform_radius:.3g} m; metres?"
        )
    return found


def check_limits(
    tension_max: float,
    safety_tension_max: float,
    safety_wrench_max: FloatArray,
    rated: FloatArray,
    sensor_range: FloatArray,
) -> Findings:
    """Compare the limits of control, safety envelope and sensor.

    Args:
        tension_max: that the springs bear, of control [N].
        safety_tension_max: at which the bridge unloads [N].
        safety_wrench_max: (6,) likewise [N, N m].
        rated: (6,) wrench of control's design [N, N m].
        sensor_range: (6,) of the force/torque sensor, its axes [N, N m].
    """
    found = Findings(
        f"tension_max {safety_tension_max:g} N of the envelope, {tension_max:g} N of control; "
        f"wrench_max {_row(safety_wrench_max)}, sensor {_row(sensor_range)}"
    )
    if not safety_tension_max <= tension_max:
        found.refused.append(
            f"safety: tension_max: expected at most control's {tension_max:g} N, which the springs "
            f"bear, got {safety_tension_max:g}"
        )
    if not (safety_wrench_max <= np.maximum(sensor_range, 0.0)).all():
        found.refused.append(
            f"safety: wrench_max: expected at most the sensor's range {_row(sensor_range)}, got "
            f"{_row(safety_wrench_max)}"
        )
    if not (rated <= sensor_range).all():
        found.refused.append(
            f"control: force_rated, torque_rated: expected at most the sensor's range "
            f"{_row(sensor_range)}, got {_row(rated)}"
        )
    return found


def _row(values: FloatArray) -> str:
    return "[" + ", ".join(f"{value:g}" for value in values) + "]"
