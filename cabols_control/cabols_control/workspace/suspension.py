# SPDX-License-Identifier: Apache-2.0
"""What happens to a platform that hangs on its cables when the amplifiers go off.

A gear that lets no pull turn its motor, or whose friction is more than the pull, holds its cable.
Another one pays out, at v = k (c T - f) by (3.11) without current, with the pull T, the current c T
that it takes through the gear, and the friction's f.

How fast the platform then sinks follows from the cables' speeds alone. With w its weight and l_i'
the lengths' rates, w . nu = sum t_i l_i' for any tensions t with A t + w = 0; so, where no cable
grows faster than s_i, the weight does not sink faster than sum t_i s_i / |w| for any t from 0. The
least of these is a linear programme. It holds whatever the platform's motion, and where cables are
slack; the cables' stretch comes on top.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cabols_control.checks import BoolArray, FloatArray, finite_array, in_range, one_or_each
from cabols_control.geometry import RigGeometry
from cabols_control.kinematics import structure_matrix
from cabols_control.naming import limb_name
from cabols_control.rig import LimbsConfig, Rig
from cabols_control.workspace.robot import GRAVITY_M_S2

HELD_SHARE = 0.5
"""Share of a gear's least friction that a pull may take: friction falls with wear and shaking."""


@dataclass(frozen=True, eq=False)
class Suspension:
    """How gears bear the platform with the amplifiers off.

    Attributes:
        known: whether limbs.yaml says what the gears do.
        tension: the most that a cable may pull [N].
        holds_to: (n,) pull that each gear holds, HELD_SHARE counted [N]; inf: self-locking.
        payout: (n,) speed at which each cable is paid out under `tension` [m/s].
        sinking: the weight's largest speed over the poses that were asked for [m/s]; inf where it
            cannot be told, as at a pose at which the cables cannot bear the weight.
    """

    known: bool
    tension: float
    holds_to: FloatArray
    payout: FloatArray
    sinking: float

    @property
    def held(self) -> BoolArray:
        """(n,) whether each gear holds whatever its cable may pull."""
        return np.asarray(self.holds_to >= self.tension)

    def told(self) -> str:
        """Say for people what the gears do."""
        if not self.known:
            return (
                "limbs.yaml does not say what the gears do with the amplifiers off (gear: "
                "self_locking, or friction_current and load_current)"
            )
        if self.held.all():
            return f"by limbs.yaml all gears hold {self.tension:g} N with the amplifiers off"
        worst = int(self.holds_to.argmin())
        sinks = (
            f"the weight sinks at up to {self.sinking:.3g} m/s"
            if np.isfinite(self.sinking)
            else "how fast the weight sinks cannot be told, as the cables cannot bear it everywhere"
        )
        return (
            f"by limbs.yaml {int((~self.held).sum())} of {self.held.size} gears do not hold "
            f"{self.tension:g} N with the amplifiers off ({limb_name(worst)}: "
            f"{self.holds_to[worst]:.3g} N): {sinks}"
        )


def held_pulls(limbs: LimbsConfig) -> FloatArray:
    """(n,) pull that each gear holds without current, HELD_SHARE counted [N]; inf: any.

    Args:
        limbs: with what is known of the gears; without, nothing is held.
    """
    count, gear = len(limbs.gain), limbs.gear
    if gear is None:
        return np.zeros(count)
    if gear.self_locking:
        return np.full(count, np.inf)
    friction = HELD_SHARE * one_or_each("friction_current", gear.friction_current, count)
    load = one_or_each("load_current", gear.load_current, count)
    return np.asarray(friction / load)


def payout_speeds(limbs: LimbsConfig, tension: FloatArray) -> FloatArray:
    """(n,) steady speeds at which pulls turn motors without current [m/s]; inf: not known.

    Args:
        limbs: with what is known of the gears.
        tension: (n,) pulls [N].
    """
    count, gear = len(limbs.gain), limbs.gear
    if gear is None:
        return np.full(count, np.inf)
    if gear.self_locking:
        return np.zeros(count)
    friction = HELD_SHARE * one_or_each("friction_current", gear.friction_current, count)
    load = one_or_each("load_current", gear.load_current, count)
    return np.asarray(limbs.gain) * np.maximum(load * tension - friction, 0.0)


def sinking_speed(
    geometry: RigGeometry,
    position: FloatArray,
    rotation: FloatArray,
    weight: FloatArray,
    payout: FloatArray,
) -> float:
    """Largest speed at which the weight sinks, where no cable is paid out faster than given [m/s].

    Args:
        geometry: of the rig.
        position: (3,) of the platform in the base frame [m].
        rotation: (3, 3) from platform to base axes.
        weight: (6,) about the platform's origin, base axes [N, N m].
        payout: (n,) speeds [m/s].

    Returns:
        The speed; inf where no tensions bear the weight.

    Raises:
        ShapeError: if an array has another shape or is not finite.
        DegenerateGeometryError: if a cable has no length.
    """
    from scipy.optimize import linprog  # seconds to import, seldom used

    pulls = structure_matrix(geometry, position, rotation)
    load = finite_array("weight", weight, (6,))
    size = float(np.linalg.norm(load[:3]))
    in_range("weight", size, 1e-9, 1e9)
    speeds = np.asarray(payout, dtype=np.float64)
    if not np.isfinite(speeds).all():
        return float("inf")
    found = linprog(speeds, A_eq=pulls, b_eq=-load, bounds=(0.0, None), method="highs")
    return float(found.fun) / size if found.status == 0 else float("inf")


def borne_share(
    geometry: RigGeometry,
    position: FloatArray,
    rotation: FloatArray,
    weight: FloatArray,
    most: FloatArray,
) -> float:
    """Largest share of a weight that cables of limited pull can bear, in balance.

    Args:
        geometry: of the rig.
        position: (3,) of the platform in the base frame [m].
        rotation: (3, 3) from platform to base axes.
        weight: (6,) about the platform's origin, base axes [N, N m].
        most: (n,) pulls [N].

    Returns:
        From 0 on; inf where nothing bounds it; NaN where it cannot be told.
    """
    from scipy.optimize import linprog  # seconds to import, seldom used

    pulls = structure_matrix(geometry, position, rotation)
    load = finite_array("weight", weight, (6,))
    bounds = [(0.0, float(pull)) for pull in most] + [(0.0, None)]
    found = linprog(
        np.r_[np.zeros(len(most)), -1.0],
        A_eq=np.column_stack([pulls, load]),
        b_eq=np.zeros(6),
        bounds=bounds,
        method="highs",
    )
    if found.status == 3:
        return float("inf")
    return float(-found.fun) if found.status == 0 else float("nan")


def judge_suspension(
    rig: Rig,
    mass: float,
    centre: FloatArray,
    half_range: FloatArray,
) -> Suspension:
    """Judge by a rig's files what its platform does when the amplifiers go off.

    Args:
        rig: geometry, limbs, envelope.
        mass: of platform and tool [kg].
        centre: (3,) of mass, platform axes [m].
        half_range: (3,) that the platform may be away from its reference position [m].

    Raises:
        ShapeError: if an array has another shape or is not finite.
        OutOfRangeError: if there is no mass.
    """
    geometry, limbs = rig.geometry, rig.limbs
    rotation = np.asarray(geometry.reference_rotation)
    tension = rig.control.tension_max
    if rig.envelope is not None:
        tension = max(tension, rig.envelope.tension_max)
    payout = payout_speeds(limbs, np.full(geometry.cables, tension))
    in_range("mass", mass, 1e-9, 1e6)
    force = np.array([0.0, 0.0, -GRAVITY_M_S2 * mass])
    arm = rotation @ finite_array("centre", centre, (3,))
    weight = np.concatenate([force, np.cross(arm, force)])
    sinking = 0.0
    away = finite_array("half_range", half_range, (3,))
    for corner in np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3), -1).reshape(-1, 3):
        if not payout.any():
            break
        position = np.asarray(geometry.reference_position) + corner * away
        found = sinking_speed(geometry, position, rotation, weight, payout)
        sinking = max(sinking, found)
    return Suspension(
        known=limbs.gear is not None,
        tension=float(tension),
        holds_to=held_pulls(limbs),
        payout=payout,
        sinking=sinking,
    )
