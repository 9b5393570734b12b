"""Weight of the tool on a force/torque sensor: its removal, and its identification with the bias.

With the platform turned by R (platform to base axes) the tool pulls on the sensor with the force
R^T m g at its centre of mass, in platform axes; gravity g is along -z of the base.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from cabols_control.checks import FloatArray, finite_array, in_range, rotation_matrix
from cabols_control.errors import CabolsError
from cabols_control.rotations import cross_matrix
from cabols_hw.force_torque.ati import STANDARD_GRAVITY

UNKNOWNS = 10
"""Six biases, the mass, and the mass times the centre of mass."""


class OrientationsError(CabolsError):
    """The orientations do not determine bias, mass and centre of mass."""


@dataclass(frozen=True, eq=False)
class ToolTare:
    """Bias and tool identified from gauge voltages at several orientations.

    Attributes:
        bias: (6,) voltage of each gauge without any load [V].
        mass: [kg].
        centre_of_mass: (3,) in the frame of the calibration matrix [m].
        residual: root mean square of the voltages that the fit does not explain [V].
    """

    bias: FloatArray
    mass: float
    centre_of_mass: FloatArray
    residual: float


@njit(cache=True)
def tool_weight_into(
    mass: float, centre_of_mass: FloatArray, rotation: FloatArray, wrench: FloatArray
) -> None:
    """Fill wrench (6,); as tool_weight, unchecked.

    Args:
        mass: of the tool [kg].
        centre_of_mass: (3,) from the origin, platform axes [m].
        rotation: (3, 3) from platform to base axes.
        wrench: (6,), filled [N, N m].
    """
    for axis in range(3):
        wrench[axis] = -mass * STANDARD_GRAVITY * rotation[2, axis]
    c0, c1, c2 = centre_of_mass[0], centre_of_mass[1], centre_of_mass[2]
    wrench[3] = c1 * wrench[2] - c2 * wrench[1]
    wrench[4] = c2 * wrench[0] - c0 * wrench[2]
    wrench[5] = c0 * wrench[1] - c1 * wrench[0]


def tool_weight(mass: float, centre_of_mass: ArrayLike, rotation: ArrayLike) -> FloatArray:
    """Wrench of the tool's weight on the sensor.

    Args:
        mass: [kg].
        centre_of_mass: (3,) from the origin, platform axes [m].
        rotation: (3, 3) from platform to base axes.

    Returns:
        (6,) force [N], then torque [N m] about the origin, platform axes.

    Raises:
        ShapeError, OutOfRangeError: if an argument is not valid.
    """
    wrench = np.zeros(6)
    tool_weight_into(
        in_range("mass", mass, 0.0, 1e6),
        finite_array("centre_of_mass", centre_of_mass, (3,)),
        rotation_matrix("rotation", rotation),
        wrench,
    )
    return wrench


def bias_at(
    matrix: ArrayLike, volts: ArrayLike, rotation: ArrayLike, mass: float, centre_of_mass: ArrayLike
) -> FloatArray:
    """Compute the gauges' bias from one orientation of a known tool without other load.

    Args:
        matrix: (6, 6) wrench per volt [N/V, N m/V], platform axes at its origin.
        volts: (6,) of the gauges [V].
        rotation: (3, 3) from platform to base axes.
        mass: [kg].
        centre_of_mass: (3,) from the origin, platform axes [m].

    Returns:
        (6,) [V].

    Raises:
        ShapeError, OutOfRangeError: if an argument is not valid.
    """
    weight = tool_weight(mass, centre_of_mass, rotation)
    per_volt = finite_array("matrix", matrix, (6, 6))
    return finite_array("volts", volts, (6,)) - np.linalg.solve(per_volt, weight)


def identify_tool(matrix: ArrayLike, volts: ArrayLike, rotations: ArrayLike) -> ToolTare:
    """Compute bias, mass and centre of mass by least squares, without other load than the tool.

    Least squares are in volts, where every gauge has the same noise. Three orientations in which
    gravity points three ways are the fewest; turning the platform about the vertical adds nothing.

    Args:
        matrix: (6, 6) wrench per volt [N/V, N m/V], platform axes at its origin.
        volts: (k, 6) of the gauges, a row for each orientation [V].
        rotations: (k, 3, 3) from platform to base axes.

    Raises:
        ShapeError: if an argument is not of its shape or not finite.
        OrientationsError: if the orientations are too few or too much alike.
    """
    per_volt = finite_array("matrix", matrix, (6, 6))
    measured = finite_array("volts", volts, (None, 6))
    turned = finite_array("rotations", rotations, (measured.shape[0], 3, 3))
    gauges = np.linalg.inv(per_volt)
    blocks = []
    for rotation in turned:
        gravity = rotation_matrix("rotations", rotation).T @ [0.0, 0.0, -STANDARD_GRAVITY]
        load = np.zeros((6, 4))
        load[:3, 0] = gravity
        load[3:, 1:] = -cross_matrix(gravity)
        blocks.append(np.hstack([np.eye(6), gauges @ load]))
    design = np.vstack(blocks) if blocks else np.zeros((0, UNKNOWNS))
    # Columns of one size, so that the rank does not depend on the units.
    size = np.maximum(np.linalg.norm(design, axis=0), 1e-300) if blocks else np.ones(UNKNOWNS)
    scaled, _, rank, _ = np.linalg.lstsq(design / size, measured.ravel(), rcond=1e-3)
    values = np.asarray(scaled / size, dtype=np.float64)
    bias, (mass, *moment) = values[:6], values[6:].tolist()
    if rank < UNKNOWNS or not mass > 0.0:
        raise OrientationsError(
            f"rotations: expected at least 3 that turn gravity about two axes, got {len(turned)} "
            f"that tell {rank} of {UNKNOWNS} unknowns, mass {mass:.3g} kg"
        )
    left = measured.ravel() - design @ values
    return ToolTare(bias, mass, np.array(moment) / mass, float(np.sqrt(np.mean(left**2))))
