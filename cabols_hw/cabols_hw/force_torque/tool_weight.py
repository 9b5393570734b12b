# SPDX-License-Identifier: Apache-2.0
"""Weight of the tool on a force/torque sensor: its removal, and its identification with the bias.

With the platform turned by R (platform to base axes) the tool pulls on the sensor with the force
R^T m g at its centre of mass, in platform axes; gravity g is along -z of the base.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cabols_control.checks import FloatArray, finite_array, in_range, rotation_matrix
from cabols_control.compiling import njit
from cabols_control.errors import CabolsError
from cabols_control.rotations import cross_matrix
from cabols_hw.force_torque.ati import AXES, STANDARD_GRAVITY

UNKNOWNS = 10
"""Six biases, the mass, and the mass times the centre of mass."""
LARGEST_MISFIT = 0.1
"""Of what the orientations change in a component of the wrench; more is no tool's weight."""
SIGNIFICANCE = 5.0
"""Standard deviations that a tool's mass must have."""
LONGEST_REACH = 0.5
"""Of a tool's centre of mass from the platform's origin, unless the caller knows better [m]."""


def _signs(*axes: int) -> FloatArray:
    signs = np.ones(6)
    signs[list(axes)] = -1.0
    return signs


MISTAKES = {
    "all axes of the sensor are inverted": _signs(*range(6)),
    **{f"axis {name} of the sensor is inverted": _signs(i, i + 3) for i, name in enumerate("xyz")},
    **{f"the force along {name} is inverted": _signs(i) for i, name in enumerate("xyz")},
    **{f"the torque about {name} is inverted": _signs(i + 3) for i, name in enumerate("xyz")},
    **{f"the sensor is turned by 180 degrees about {name}":
       _signs(*(k for k in range(6) if k % 3 != i)) for i, name in enumerate("xyz")},
}  # fmt: skip
"""Signs of a wrench's components by which a mistake can be undone."""


class OrientationsError(CabolsError):
    """The orientations do not determine bias, mass and centre of mass."""


class ToolError(CabolsError):
    """The voltages are not those of a tool's weight alone."""


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


def identify_tool(
    matrix: ArrayLike, volts: ArrayLike, rotations: ArrayLike, reach: float = LONGEST_REACH
) -> ToolTare:
    """Compute bias, mass and centre of mass by least squares, without other load than the tool.

    Least squares are in volts, where every gauge has the same noise. Three orientations in which
    gravity points three ways are the fewest; turning the platform about the vertical adds nothing.
    The fit is looked at before it is returned: a tool that explains the voltages badly, that is not
    distinct from noise, or that is out of reach, is none.

    Args:
        matrix: (6, 6) wrench per volt [N/V, N m/V], platform axes at its origin.
        volts: (k, 6) of the gauges, a row for each orientation [V].
        rotations: (k, 3, 3) from platform to base axes.
        reach: largest distance of the centre of mass from the origin that is believed [m].

    Raises:
        ShapeError: if an argument is not of its shape or not finite.
        OrientationsError: if the orientations are too few or too much alike.
        ToolError: if no tool explains the voltages; with the cause, where one is found.
    """
    per_volt = finite_array("matrix", matrix, (6, 6))
    measured = finite_array("volts", volts, (None, 6))
    turned = finite_array("rotations", rotations, (measured.shape[0], 3, 3))
    for rotation in turned:
        rotation_matrix("rotations", rotation)
    fit = _fit(per_volt, measured, turned)
    if fit.rank < UNKNOWNS:
        raise OrientationsError(
            f"rotations: expected at least 3 that turn gravity about two axes, got {len(turned)} "
            f"that tell {fit.rank} of {UNKNOWNS} unknowns, mass {fit.mass:.3g} kg"
        )
    found = f"got {fit.mass:.3g} kg"
    if fit.mass > 0.0:
        found += f" at {np.linalg.norm(fit.centre_of_mass):.3g} m"
    if not fit.mass > 0.0 or not fit.misfit <= LARGEST_MISFIT:
        raise ToolError(
            f"volts: expected a tool's weight alone, {found} that leaves "
            f"{100.0 * fit.misfit:.3g} % of {AXES[fit.worst]} unexplained; "
            f"{_cause(per_volt, measured, turned)}"
        )
    if not fit.mass >= SIGNIFICANCE * fit.mass_deviation:
        raise ToolError(
            f"volts: expected a tool that is heavier than the noise, {found} +- "
            f"{fit.mass_deviation:.2g} kg; average longer, or give the bias by a tare"
        )
    if not np.linalg.norm(fit.centre_of_mass) <= reach:
        raise ToolError(
            f"volts: expected a centre of mass within {reach:g} m, {found}; was something else "
            "than the tool pulling, or is the matrix in other units?"
        )
    return ToolTare(fit.bias, fit.mass, fit.centre_of_mass, fit.residual)


@dataclass(frozen=True, eq=False)
class _Fit:
    """Least squares without judgement.

    mass_deviation is a standard deviation by the residual. misfit: of what the orientations change
    in a component of the wrench, the largest share that the tool does not explain; worst: which.
    """

    rank: int
    bias: FloatArray
    mass: float
    centre_of_mass: FloatArray
    residual: float
    mass_deviation: float
    misfit: float
    worst: int


def _fit(per_volt: FloatArray, measured: FloatArray, turned: FloatArray) -> _Fit:
    gauges = np.linalg.inv(per_volt)
    blocks = []
    for rotation in turned:
        gravity = rotation.T @ [0.0, 0.0, -STANDARD_GRAVITY]
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
    left = measured.ravel() - design @ values
    residual = float(np.sqrt(np.mean(left**2))) if left.size else 0.0
    deviation = np.inf
    if rank == UNKNOWNS:
        variance = float(left @ left) / max(left.size - UNKNOWNS, 1)
        inverse = np.linalg.inv(design.T @ design / np.outer(size, size)) / np.outer(size, size)
        _, (of_mass, *_) = np.split(np.diag(inverse), [bias.size])
        deviation = float(np.sqrt(variance * of_mass))
    centre = np.array(moment) / mass if mass != 0.0 else np.full(3, np.inf)
    shares = _shares(per_volt, measured, left.reshape(-1, 6)) if left.size else np.zeros(6)
    worst = int(np.argmax(shares))
    return _Fit(
        rank=int(rank),
        bias=bias,
        mass=mass,
        centre_of_mass=centre,
        residual=residual,
        mass_deviation=deviation,
        misfit=float(shares[worst]),
        worst=worst,
    )


def _shares(per_volt: FloatArray, measured: FloatArray, left: FloatArray) -> FloatArray:
    """(6,) rms of what is left of each component, of what it changes between the orientations."""
    changes = np.sqrt(np.mean(((measured - measured.mean(axis=0)) @ per_volt.T) ** 2, axis=0))
    remains = np.sqrt(np.mean((left @ per_volt.T) ** 2, axis=0))
    # A component that hardly changes is judged by those of its kind.
    kinds = np.repeat([changes[:3].max(), changes[3:].max()], 3)
    return np.asarray(remains / np.maximum(np.maximum(changes, 0.1 * kinds), 1e-300))


def _cause(per_volt: FloatArray, measured: FloatArray, turned: FloatArray) -> str:
    """Say which single mistake makes the voltages best those of a tool, if one does.

    Args:
        per_volt: (6, 6) as given.
        measured: (k, 6) [V].
        turned: (k, 3, 3) as given.
    """
    undone = {
        f"{what}: correct sensor_rotation or the calibration": _fit(
            signs[:, None] * per_volt, measured, turned
        )
        for what, signs in MISTAKES.items()
    }
    other = np.ascontiguousarray(turned.transpose(0, 2, 1))
    what = "the rotations are transposed: give those from platform to base axes"
    undone[what] = _fit(per_volt, measured, other)
    fits = {
        what: fit.misfit
        for what, fit in undone.items()
        if fit.rank == UNKNOWNS and fit.mass > 0.0 and fit.misfit <= LARGEST_MISFIT
    }
    if not fits:
        return "was something else than the tool pulling, or did it not stand still?"
    return min(fits, key=lambda what: fits[what])
