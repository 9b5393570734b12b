# SPDX-License-Identifier: Apache-2.0
"""k_e of every limb, and how it changes with the cable's length.

Spring and cable are in series, so that 1/k_e(l) = c + l / EA: the cable's own share grows with its
length l. What is identified is k_e at the reference pose, which gives c.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cabols_control.checks import FloatArray, finite_array
from cabols_control.errors import ConfigError, ShapeError
from cabols_control.naming import limb_name


@dataclass(frozen=True, eq=False)
class LimbSprings:
    """Stiffness of the limbs between motor and platform.

    Attributes:
        nominal: (n,) k_e at the reference pose [N/m].
        fixed: (n,) compliance of all but the cable's length [m/N].
        per_metre: (n,) compliance of a metre of cable, 1 / EA [1/N]; 0: k_e does not depend on
            the length.
    """

    nominal: FloatArray
    fixed: FloatArray
    per_metre: FloatArray

    def stiffness(self, length: ArrayLike) -> FloatArray:
        """(..., n) k_e of the limbs at the cables' lengths [N/m].

        Args:
            length: (..., n) of the cables [m].

        Raises:
            ShapeError: if the lengths are of another number of cables.
        """
        given = np.asarray(length, dtype=np.float64)
        if given.shape[-1:] != self.nominal.shape:
            raise ShapeError(
                f"length: expected the last axis of {self.nominal.size} cables, got {given.shape}"
            )
        if not self.per_metre.any():
            return np.broadcast_to(self.nominal, given.shape)
        return np.asarray(1.0 / (self.fixed + self.per_metre * given), dtype=np.float64)


def limb_springs(
    stiffness: FloatArray, axial: FloatArray | None, length: FloatArray
) -> LimbSprings:
    """Build the springs of the limbs.

    Args:
        stiffness: (n,) k_e at the reference pose [N/m].
        axial: (n,) EA of the cables [N]; None: not known, k_e is taken as constant.
        length: (n,) of the cables at the reference pose [m].

    Raises:
        ConfigError: if a cable alone would give way more than the whole limb.
        ShapeError: if an array is not (n,) or not finite.
    """
    count = len(stiffness)
    nominal = finite_array("stiffness", stiffness, (count,))
    if axial is None:
        return LimbSprings(nominal, 1.0 / nominal, np.zeros(count))
    per_metre = 1.0 / finite_array("axial_stiffness", axial, (count,))
    fixed = 1.0 / nominal - per_metre * finite_array("length", length, (count,))
    for i, left in enumerate(fixed):
        if not left >= 0.0:
            raise ConfigError(
                f"axial_stiffness of {limb_name(i)}: expected at least "
                f"{nominal[i] * length[i]:.4g} N, at which the cable's {length[i]:.3g} m alone "
                f"are as soft as stiffness says of the whole limb ({nominal[i]:.4g} N/m), got "
                f"{1.0 / per_metre[i]:.4g} N"
            )
    return LimbSprings(nominal, fixed, per_metre)
