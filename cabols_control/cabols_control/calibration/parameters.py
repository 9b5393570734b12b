# SPDX-License-Identifier: Apache-2.0
"""What a self-calibration estimates: names, places in one vector, and what is known before."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.kinematics import cable_lengths
from cabols_control.naming import cable_name
from cabols_control.rig import Rig

AXES = ("x", "y", "z")
WRENCH_AXES = ("f_x", "f_y", "f_z", "m_x", "m_y", "m_z")


@dataclass(frozen=True)
class Beforehand:
    """Standard deviations of the drawing's errors: how far it can be wrong.

    Attributes:
        base_point: each coordinate [m].
        platform_point: each coordinate [m].
        radius: of a pulley [m]; 0 keeps the radii.
        offset: of a cable's length where its encoder counts from [m].
        stiffness: of a limb, as a share of its k_e.
        sensor_turn: of the force/torque sensor's axes [rad].
        sensor_shift: of its origin [m].
        weight: of platform and tool [N].
        moment: of the weight about the platform's origin [N m].
        bias_force: of the sensor [N].
        bias_torque: [N m].
    """

    base_point: float = 0.015
    platform_point: float = 0.015
    radius: float = 0.006
    offset: float = 1.0
    stiffness: float = 0.06
    sensor_turn: float = 0.02
    sensor_shift: float = 0.005
    weight: float = 10.0
    moment: float = 2.0
    bias_force: float = 50.0
    bias_torque: float = 5.0


@dataclass(frozen=True, eq=False)
class Layout:
    """Places of the parameters in one vector.

    Attributes:
        cables: number n of cables.
        axes: (n, 3) unit vectors of the pulleys' swivels, which are taken as they are.
        per_metre: (n,) compliance of a metre of cable, which is taken as it is [1/N].
        length: (n,) of the cables at the reference pose, to which k_e belongs [m].
        start: (p,) values of the drawing.
        spread: (p,) standard deviations beforehand.
        names: (p,) for people.
    """

    cables: int
    axes: FloatArray
    per_metre: FloatArray
    length: FloatArray
    start: FloatArray
    spread: FloatArray
    names: tuple[str, ...]

    def parts(self, values: FloatArray) -> dict[str, FloatArray]:
        """Split a vector (p,) into its parts; views.

        Args:
            values: (p,) in SI units.
        """
        found, place = {}, 0
        for name, shape in part_shapes(self.cables):
            size = int(np.prod(shape))
            found[name] = values[place : place + size].reshape(shape)
            place += size
        return found


def part_shapes(cables: int) -> tuple[tuple[str, tuple[int, ...]], ...]:
    """Names and shapes of the parts, in their order.

    Args:
        cables: number n of cables.
    """
    return (
        ("base", (cables, 3)),
        ("platform", (cables, 3)),
        ("radius", (cables,)),
        ("offset", (cables,)),
        ("stiffness", (cables,)),
        ("sensor_turn", (3,)),
        ("sensor_shift", (3,)),
        ("weight", (1,)),
        ("moment", (3,)),
        ("bias", (6,)),
    )


def layout_of(
    rig: Rig, weight: float, centre_of_mass: FloatArray, known: Beforehand | None = None
) -> Layout:
    """Lay out the parameters of a rig.

    Args:
        rig: as its folder says.
        weight: of platform and tool [N].
        centre_of_mass: (3,) where it pulls, platform axes [m].
        known: how far the folder can be wrong; None: the defaults.
    """
    before, geometry, n = known or Beforehand(), rig.geometry, rig.geometry.cables
    records = geometry.records()
    cables = [cable_name(i) for i in range(n)]
    nominal = rig.springs.nominal
    table: list[tuple[FloatArray, float, list[str]]] = [
        (records["base"], before.base_point, [f"{c}, base {a}" for c in cables for a in AXES]),
        (
            records["platform"],
            before.platform_point,
            [f"{c}, platform {a}" for c in cables for a in AXES],
        ),
        (records["radius"], before.radius, [f"{c}, pulley radius" for c in cables]),
        (np.zeros(n), before.offset, [f"{c}, length offset" for c in cables]),
        (nominal, np.nan, [f"{c}, k_e" for c in cables]),
        (np.zeros(3), before.sensor_turn, [f"sensor turn {a}" for a in AXES]),
        (np.zeros(3), before.sensor_shift, [f"sensor shift {a}" for a in AXES]),
        (np.array([weight]), before.weight, ["weight"]),
        (weight * np.asarray(centre_of_mass), before.moment, [f"weight times {a}" for a in AXES]),
        (np.zeros(6), np.nan, [f"sensor bias {a}" for a in WRENCH_AXES]),
    ]
    start = np.concatenate([np.ravel(values) for values, _, _ in table])
    spread = np.concatenate([np.full(np.size(values), sigma) for values, sigma, _ in table])
    spread[-6:] = np.repeat([before.bias_force, before.bias_torque], 3)
    names = tuple(name for _, _, names in table for name in names)
    reference = geometry.reference_position, geometry.reference_rotation
    layout = Layout(
        cables=n,
        axes=records["axis"].copy(),
        per_metre=rig.springs.per_metre,
        length=cable_lengths(geometry, *reference),
        start=start,
        spread=np.asarray(spread, dtype=np.float64),
        names=names,
    )
    layout.parts(layout.spread)["stiffness"][:] = before.stiffness * nominal
    return layout
