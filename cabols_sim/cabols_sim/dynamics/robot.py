# SPDX-License-Identifier: Apache-2.0
"""A cable robot as chapter 2 sees it: a rigid platform and cables that are rods of variable length.

Everything is spatial; a planar robot is a spatial one in the plane z = 0 that keeps the degrees of
freedom x, y and the angle about z. Accelerations, forces and D are of its m = 3 or 6 degrees of
freedom.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cabols_control.cable_kernels import MIN_CABLE_LENGTH_M
from cabols_control.checks import FloatArray, finite_array, in_range
from cabols_control.errors import CabolsError, ConfigError, DegenerateGeometryError
from cabols_control.geometry import RigGeometry
from cabols_control.naming import cable_name

MassLaw = Literal["variable", "no_stream", "constant"]
MASS_LAWS: tuple[MassLaw, ...] = ("variable", "no_stream", "constant")
Datum = Literal["winch", "frame"]
DATUMS: tuple[Datum, ...] = ("winch", "frame")

SPATIAL = (0, 1, 2, 3, 4, 5)
PLANAR = (0, 1, 5)
"""Degrees of freedom kept, of [v; omega]."""
STANDARD_GRAVITY = 9.80665


class CableModel(NamedTuple):
    """How a cable's material moves: T_i = m_i / 2 (axial l_dot^2 + transverse |w|^2).

    w is the part of the platform point's velocity across the cable, l_dot the part along it.

    Attributes:
        axial: share of the cable's mass that moves at l_dot.
        transverse: share that moves at w.
    """

    axial: float
    transverse: float


CENTRE = CableModel(1.0 / 4.0, 1.0 / 3.0)
"""The source's (2.2) to (2.17): the cable's centre moves at half the platform point's velocity."""
MATERIAL = CableModel(1.0, 1.0 / 3.0)
"""A cable that is wound in and out: all of its material runs along it at l_dot. Obeys Newton."""
STRETCHING = CableModel(1.0 / 3.0, 1.0 / 3.0)
"""A rod that stretches evenly between its ends: the one whose mass is rightly constant."""
PLANAR_CASE = CableModel(1.0, 1.0 / 12.0)
"""What the Jacobians of (2.32) say: l_dot along the cable, and a turn about the resting centre."""


@dataclass(frozen=True, eq=False)
class CableRobot:
    """Platform, cables and which of the source's models they follow.

    Attributes:
        base_points: (n, 3) A_i, base frame [m].
        platform_points: (n, 3) b_i, platform axes [m].
        mass: of the platform [kg].
        inertia: (3, 3) of the platform about its centre of mass, platform axes [kg m^2].
        density: (n,) of the cables [kg/m]; one number for all.
        centre_of_mass: (3,) of the platform from its origin, platform axes [m].
        gravity: (3,) acceleration of a falling body, base axes [m/s^2].
        freedom: indices of the degrees of freedom in [v; omega]: SPATIAL or PLANAR.
        cable: how a cable's material moves; CENTRE is the source's (2.17).
        mass_law: "variable": (2.11) with the mass stream (2.28); "no_stream": (2.11) without
            (2.28), what section 2.5 compares with; "constant": the mass of `constant_length`.
        constant_length: (n,) lengths whose mass the constant law gives the cables [m].
        datum: where the potential energy of a cable's mass is counted from. "winch": from A_i, so
            that paying out lifts nothing; "frame": from the frame's origin as (2.22) does, whose G
            then depends on where that origin is.
    """

    base_points: FloatArray
    platform_points: FloatArray
    mass: float
    inertia: FloatArray
    density: FloatArray
    centre_of_mass: FloatArray = field(default_factory=lambda: np.zeros(3))
    gravity: FloatArray = field(default_factory=lambda: np.array([0.0, 0.0, -STANDARD_GRAVITY]))
    freedom: tuple[int, ...] = SPATIAL
    cable: CableModel = CENTRE
    mass_law: MassLaw = "variable"
    constant_length: FloatArray | None = None
    datum: Datum = "winch"

    @property
    def cables(self) -> int:
        """Number n of cables."""
        return int(self.base_points.shape[0])

    @property
    def planar(self) -> bool:
        """Whether it stays in the plane z = 0."""
        return self.freedom == PLANAR

    @property
    def selection(self) -> FloatArray:
        """(6, m) matrix from the velocities of the degrees of freedom to [v; omega]."""
        return np.eye(6)[:, list(self.freedom)]

    def __post_init__(self) -> None:
        """Check shapes, signs and that the options are known and fit together."""
        set_field = object.__setattr__
        set_field(self, "base_points", finite_array("base_points", self.base_points, (None, 3)))
        n = self.cables
        points = finite_array("platform_points", self.platform_points, (n, 3))
        set_field(self, "platform_points", points)
        set_field(self, "mass", in_range("mass", self.mass, 1e-9, 1e9))
        inertia = finite_array("inertia", self.inertia, (3, 3))
        if not (np.allclose(inertia, inertia.T) and np.linalg.eigvalsh(inertia)[0] > 0.0):
            raise CabolsError(
                f"inertia: expected a symmetric positive definite matrix, got {inertia.tolist()}; "
                "is it about the centre of mass?"
            )
        set_field(self, "inertia", inertia)
        set_field(self, "density", _per_cable("density", self.density, n))
        for value in self.density:
            in_range("density", float(value), 0.0, 1e4)
        for name in ("centre_of_mass", "gravity"):
            set_field(self, name, finite_array(name, getattr(self, name), (3,)))
        self._check_options(n)

    def _check_options(self, n: int) -> None:
        if self.freedom not in (SPATIAL, PLANAR):
            raise CabolsError(f"freedom: expected {SPATIAL} or {PLANAR}, got {self.freedom}")
        if self.mass_law not in MASS_LAWS:
            raise CabolsError(f"mass_law: expected one of {MASS_LAWS}, got {self.mass_law!r}")
        if self.datum not in DATUMS:
            raise CabolsError(f"datum: expected one of {DATUMS}, got {self.datum!r}")
        if not min(self.cable) >= 0.0:
            raise CabolsError(f"cable: expected shares of at least 0, got {self.cable}")
        if self.constant_length is not None:
            lengths = _per_cable("constant_length", self.constant_length, n)
            object.__setattr__(self, "constant_length", lengths)
        elif self.mass_law == "constant":
            raise CabolsError(
                "constant_length: expected (n,) lengths for the constant mass law, got none; "
                "use with_constant_mass"
            )
        flat = (self.base_points, self.platform_points, self.centre_of_mass, self.gravity)
        if self.planar and any(np.any(points[..., 2] != 0.0) for points in flat):
            raise CabolsError("freedom: expected a planar robot in z = 0, got points beside it")

    def with_options(
        self,
        cable: CableModel | None = None,
        mass_law: MassLaw | None = None,
        density: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        datum: Datum | None = None,
    ) -> CableRobot:
        """Return the same robot with some of the options changed.

        Args:
            cable: model of the cables' mass; None: as it is, also below.
            mass_law: terms of (2.28) that are used.
            density: of the cables [kg/m], one or (n,).
            gravity: (3,) in the base frame [m/s^2].
            datum: where the potential energy of a cable's mass is counted from.
        """
        values = {
            "cable": cable,
            "mass_law": mass_law,
            "density": density,
            "gravity": gravity,
            "datum": datum,
        }
        return replace(self, **{k: v for k, v in values.items() if v is not None})  # type: ignore[arg-type]

    def with_constant_mass(self, lengths: ArrayLike, cable: CableModel | None = None) -> CableRobot:
        """Return the constant-mass model beside this one.

        Args:
            lengths: (n,) whose mass the cables get [m].
            cable: how the material moves; None: as here.
        """
        fixed = finite_array("lengths", lengths, (self.cables,))
        return replace(self, mass_law="constant", constant_length=fixed, cable=cable or self.cable)

    def cable_mass(self, length: FloatArray) -> FloatArray:
        """(n,) masses [kg] at (n,) lengths [m]: (2.11), or constant."""
        if self.mass_law == "constant" and self.constant_length is not None:
            return self.density * self.constant_length
        return self.density * length

    @property
    def mass_per_length(self) -> FloatArray:
        """(n,) d m_i / d l_i [kg/m]: the density, or zero with constant mass."""
        return np.zeros(self.cables) if self.mass_law == "constant" else self.density

    @property
    def stream_density(self) -> FloatArray:
        """(n,) density of the stream whose effect is (2.28) [kg/m]; zero if left out."""
        return self.density if self.mass_law == "variable" else np.zeros(self.cables)


def _per_cable(name: str, value: ArrayLike, n: int) -> FloatArray:
    each = np.full(n, value) if np.ndim(value) == 0 else value
    return finite_array(name, each, (n,))


def planar_robot(
    base_points: ArrayLike,
    platform_points: ArrayLike,
    mass: float,
    inertia: float,
    density: ArrayLike,
    gravity: ArrayLike = (0.0, -STANDARD_GRAVITY),
    cable: CableModel = CENTRE,
) -> CableRobot:
    """Make a planar robot with coordinates (x, y, phi).

    Args:
        base_points: (n, 2) A_i [m].
        platform_points: (n, 2) b_i, platform axes, from its centre of mass [m].
        mass: of the platform [kg].
        inertia: of the platform about its centre of mass [kg m^2].
        density: of the cables, one for all or (n,) [kg/m].
        gravity: (2,) [m/s^2].
        cable: how a cable's material moves.

    Raises:
        ShapeError, CabolsError: if an argument has another shape, sign or is not finite.
    """
    base = finite_array("base_points", base_points, (None, 2))
    platform = finite_array("platform_points", platform_points, (base.shape[0], 2))
    about_z = in_range("inertia", inertia, 1e-12, 1e15)
    return CableRobot(
        np.pad(base, ((0, 0), (0, 1))),
        np.pad(platform, ((0, 0), (0, 1))),
        mass,
        about_z * np.diag([0.5, 0.5, 1.0]),  # the first two never act
        _per_cable("density", density, base.shape[0]),
        gravity=np.pad(finite_array("gravity", gravity, (2,)), (0, 1)),
        freedom=PLANAR,
        cable=cable,
    )


def robot_of_rig(
    geometry: RigGeometry,
    mass: float,
    inertia: ArrayLike,
    density: ArrayLike,
    centre_of_mass: ArrayLike = (0.0, 0.0, 0.0),
    cable: CableModel = CENTRE,
) -> CableRobot:
    """Make a spatial robot of a rig's geometry; see CableRobot for the arguments.

    Args:
        geometry: of the rig.
        mass: of the platform [kg].
        inertia: (3, 3) about the centre of mass, platform axes [kg m^2].
        density: of the cables [kg/m], one or (n,).
        centre_of_mass: (3,) in platform axes [m].
        cable: model of the cables' mass.

    Raises:
        ConfigError: if cables leave pulleys, which these dynamics do not know.
    """
    if geometry.has_pulleys:
        raise ConfigError(
            "geometry: expected cables between points, got pulleys, which the dynamics of moving "
            "cables do not know; leave pulley_radius out for them"
        )
    return CableRobot(
        geometry.base_points,
        geometry.platform_points,
        mass,
        finite_array("inertia", inertia, (3, 3)),
        _per_cable("density", density, geometry.cables),
        centre_of_mass=finite_array("centre_of_mass", centre_of_mass, (3,)),
        cable=cable,
    )


def check_lengths(length: FloatArray) -> None:
    """Refuse cables so short that they have no direction.

    Raises:
        DegenerateGeometryError: naming the cable.
    """
    if not length.min() >= MIN_CABLE_LENGTH_M:
        shortest = cable_name(int(length.argmin()))
        raise DegenerateGeometryError(
            f"{shortest}: expected at least {MIN_CABLE_LENGTH_M} m between its "
            f"points, got {length.min():.3g} m; keep the platform away from the winch"
        )
