# SPDX-License-Identifier: Apache-2.0
"""Vibration of the loaded rig: platform and target as one body on springs and robot's joints.

About an equilibrium with the motors standing, x being the platform's small twist displacement,

    M x_dd + C x_d + (K_target + K_springs + K_tension) x = A k_e p

where p (n,) is cable wound in by the motors. K_springs = k_e A A^T, K_tension is what the tensions'
turning directions add. The sensor between platform and flange reads A tau - M_platform x_dd.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import eigh

from cabols_control.checks import FloatArray, finite_array, in_range, one_or_each
from cabols_control.errors import CabolsError
from cabols_control.geometry import RigGeometry
from cabols_control.kinematics import structure_matrix


@dataclass(frozen=True, eq=False)
class VibrationModel:
    """A vibrating platform; all (6, 6) matrices at its origin, base axes, force before torque.

    Attributes:
        mass: of all that moves: platform, tool and what of the target moves with them.
        platform_mass: the part on the cables' side of the force/torque sensor.
        target: stiffness of the target.
        springs: stiffness of springs and cables, k_e A A^T.
        tension: stiffness by the tensions, see tension_stiffness.
        damping_ratio: of every mode, of critical.
    """

    mass: FloatArray
    platform_mass: FloatArray
    target: FloatArray
    springs: FloatArray
    tension: FloatArray
    damping_ratio: float

    def __post_init__(self) -> None:
        """Check shapes, symmetry and that the masses are masses."""
        for name in ("mass", "platform_mass", "target", "springs", "tension"):
            matrix = finite_array(name, getattr(self, name), (6, 6))
            if not np.allclose(matrix, matrix.T, rtol=1e-6, atol=1e-6 * np.abs(matrix).max()):
                raise CabolsError(f"{name}: expected a symmetric matrix, got {matrix.tolist()}")
            object.__setattr__(self, name, 0.5 * (matrix + matrix.T))
        if not np.linalg.eigvalsh(self.mass)[0] > 0.0:
            raise CabolsError("mass: expected a positive definite matrix; add the platform's")
        in_range("damping_ratio", self.damping_ratio, 0.0, 1.0)

    @property
    def stiffness(self) -> FloatArray:
        """(6, 6) of everything together."""
        return self.target + self.springs + self.tension

    def modes(self) -> tuple[FloatArray, FloatArray]:
        """Natural frequencies and mode shapes with the motors standing.

        Returns:
            (6,) rising [rad/s]; (6, 6) shapes in columns, with shapes^T M shapes = 1.

        Raises:
            CabolsError: if the equilibrium is not stable: a mode has no stiffness.
        """
        squares, shapes = eigh(self.stiffness, self.mass)
        if not squares[0] > 0.0:
            raise CabolsError(
                f"modes: expected a stable equilibrium, got a mode of stiffness {squares[0]:.3g} "
                "1/s^2; give the platform a target or more cables"
            )
        return np.sqrt(squares), shapes

    def damping(self) -> FloatArray:
        """(6, 6) modal damping matrix C."""
        frequency, shapes = self.modes()
        left = self.mass @ shapes
        return np.asarray(left @ np.diag(2.0 * self.damping_ratio * frequency) @ left.T)

    def with_target(self, factor: float) -> VibrationModel:
        """Return the same rig with the target's stiffness multiplied."""
        return replace(self, target=factor * self.target)

    def shares(self) -> FloatArray:
        """(6, 3) of each mode's elastic energy: in target, springs, tension."""
        frequency, shapes = self.modes()
        parts = [
            np.einsum("ij,ik,kj->j", shapes, part, shapes) / frequency**2
            for part in (self.target, self.springs, self.tension)
        ]
        return np.array(parts).T


def spring_stiffness(
    geometry: RigGeometry, position: ArrayLike, rotation: ArrayLike, stiffness: ArrayLike
) -> FloatArray:
    """(6, 6) k_e A A^T: what springs and cables give the platform with the motors standing.

    Args:
        geometry: of the rig.
        position: (3,) of the platform in the base frame [m].
        rotation: (3, 3) from platform to base axes.
        stiffness: k_e of spring and cable [N/m], one or (n,).
    """
    matrix = structure_matrix(geometry, position, rotation)
    springs = one_or_each("stiffness", stiffness, geometry.cables)
    in_range("stiffness", float(springs.min()), 0.0, 1e9)
    return np.asarray((matrix * springs) @ matrix.T)


def joint_target(jacobian: ArrayLike, stiffness: ArrayLike) -> FloatArray:
    """(6, 6) Cartesian stiffness J^-T K J^-1 of a robot with flexible joints, unloaded.

    Args:
        jacobian: (6, 6) at the platform's origin, base axes.
        stiffness: (6,) of the joints [N m/rad].
    """
    inverse = np.linalg.inv(finite_array("jacobian", jacobian, (6, 6)))
    return np.asarray(inverse.T @ np.diag(finite_array("stiffness", stiffness, (6,))) @ inverse)


def rigid_body(mass: float, gyration: float) -> FloatArray:
    """(6, 6) mass matrix of a body about its centre of mass, the same about all axes.

    Args:
        mass: [kg].
        gyration: radius of gyration [m].
    """
    turning = in_range("mass", mass, 0.0, 1e6) * in_range("gyration", gyration, 0.0, 1e3) ** 2
    return np.diag([mass] * 3 + [turning] * 3)


def string_frequency(tension: ArrayLike, length: ArrayLike, density: float) -> FloatArray:
    """(n,) first transverse frequency of cables between fixed ends [rad/s].

    Args:
        tension: (n,) of the cables [N].
        length: (n,) of the cables [m].
        density: of the cables [kg/m].
    """
    pull = np.maximum(np.asarray(tension, dtype=np.float64), 0.0)
    span = np.asarray(length, dtype=np.float64)
    return np.asarray(np.pi / span * np.sqrt(pull / in_range("density", density, 1e-9, 1e3)))
