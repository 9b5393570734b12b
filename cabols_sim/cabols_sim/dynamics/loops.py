# SPDX-License-Identifier: Apache-2.0
"""Open and closed loops of a control design, linear: margins of delay, gain and vibration.

The limb law (3.10) is opened at the motor's current, the wrench law (3.17) at the wrench's error.
With the limbs' loops all alike the wrench loop is the scalar g(s) = T_l (k_Po + k_Io / s) times
H(s), the (6, 6) response of the vibrating platform from the winches' commanded wrench to the one
that the sensor reads; H = 1 on a rigid target. Its characteristic loci are g times H's
eigenvalues, whatever tensions redundancy resolution chooses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cabols_control.checks import FloatArray, in_range, one_or_each
from cabols_control.gains import LimbGains, WrenchGains
from cabols_control.limb import LimbModel
from cabols_sim.dynamics.vibration import VibrationModel

ComplexArray = NDArray[np.complex128]
FREQUENCIES = np.geomspace(0.3, 3000.0, 4000)
"""[rad/s]; the Nyquist frequency of the 1 kHz loop is 3142."""


@dataclass(frozen=True)
class Margins:
    """Stability margins of a loop.

    Attributes:
        gain: by which its gain may grow [-]; inf: any.
        reduction: down to which its gain may shrink, as with a saturated motor [-]; 0: any.
        phase: that it may lose at its crossovers [rad]; inf: no crossover.
        crossover: highest frequency of gain one [rad/s]; 0: none.
        delay: that may be added [s]; inf: any.
        distance: smallest distance from -1, the inverse of the sensitivity's peak [-].
    """

    gain: float
    reduction: float
    phase: float
    crossover: float
    delay: float
    distance: float


def limb_loop(
    model: LimbModel, gains: LimbGains, stiffness: float, s: ComplexArray
) -> ComplexArray:
    """Limb loop opened at the current, at complex frequencies: (3.11) with (3.10).

    Args:
        model: of the limb.
        gains: of its law.
        stiffness: k_e of spring and cable [N/m].
        s: complex frequencies [rad/s].
    """
    motor = model.gain / (s * (1.0 + model.time_constant * s))
    law = gains.velocity * s + gains.integral * (s + gains.tension * stiffness) / s
    return np.asarray(motor * law)


def closed_limb(
    model: LimbModel, gains: LimbGains, stiffness: float, s: ComplexArray, delay_s: float = 0.0
) -> ComplexArray:
    """T_l: tension per desired tension, (3.13).

    Args:
        model: of the limb.
        gains: of its law.
        stiffness: k_e of spring and cable [N/m].
        s: complex frequencies [rad/s].
        delay_s: from the sample to the current [s].
    """
    late = np.exp(-s * delay_s)
    motor = late * model.gain / (s * (1.0 + model.time_constant * s))
    ahead = motor * stiffness * gains.integral * gains.tension / s
    return np.asarray(ahead / (1.0 + late * limb_loop(model, gains, stiffness, s)))


def wrench_loop(
    gains: WrenchGains, model: LimbModel, stiffness: float, s: ComplexArray, delay_s: float = 0.0
) -> ComplexArray:
    """g(s): wrench loop on a rigid target, opened at the error; any limb, as all are alike.

    Args:
        gains: of both loops.
        model: of the first limb.
        stiffness: k_e [N/m].
        s: complex frequencies [rad/s].
        delay_s: of every sample on its way to the current: hold, computation, transport.
    """
    inner = closed_limb(model, gains.limbs[0], stiffness, s, delay_s)
    return np.asarray(inner * (gains.proportional + gains.integral / s))


def platform_response(model: VibrationModel, s: ComplexArray) -> ComplexArray:
    """H(s), (k, 6, 6): measured wrench per commanded wrench of the winches, at k frequencies.

    Args:
        model: of the vibrating platform.
        s: (k,) complex frequencies [rad/s].
    """
    square = (s * s)[:, None, None]
    damping = s[:, None, None] * model.damping()
    moved = np.linalg.inv(square * model.mass + damping + model.stiffness)
    return np.asarray(np.eye(6) - (model.springs + square * model.platform_mass) @ moved)


def margins(frequency: FloatArray, loop: ComplexArray) -> Margins:
    """Margins of a loop whose closed loop is stable, from its open-loop frequency response.

    Args:
        frequency: (k,) rising, so dense that resonances are seen [rad/s].
        loop: (k,) open loop, negative feedback.

    Returns:
        The margins.
    """
    size, angle = np.abs(loop), np.angle(loop)
    real, imaginary = loop.real, loop.imag
    swap = np.flatnonzero((imaginary[:-1] * imaginary[1:] <= 0.0) & (imaginary[:-1] != 0.0))
    share = imaginary[swap] / (imaginary[swap] - imaginary[swap + 1])
    crossing = real[swap] + share * (real[swap + 1] - real[swap])
    above, below = crossing[crossing < -1.0], crossing[(crossing < 0.0) & (crossing > -1.0)]
    gain = float(1.0 / -below.min()) if below.size else np.inf
    reduction = float(1.0 / -above.max()) if above.size else 0.0
    falls = np.flatnonzero((size[:-1] - 1.0) * (size[1:] - 1.0) <= 0.0)
    if not falls.size:
        return Margins(gain, reduction, np.inf, 0.0, np.inf, float(np.abs(1.0 + loop).min()))
    share = np.log(size[falls]) / np.log(size[falls] / size[falls + 1])
    at = frequency[falls] * (frequency[falls + 1] / frequency[falls]) ** share
    turn = np.angle(loop[falls + 1] / loop[falls])
    lag = np.mod(np.pi + angle[falls] + share * turn, 2.0 * np.pi)
    return Margins(
        gain=gain,
        reduction=reduction,
        phase=float(np.minimum(lag, 2.0 * np.pi - lag).min()),
        crossover=float(at.max()),
        delay=float((lag / at).min()),
        distance=float(np.abs(1.0 + loop).min()),
    )


def design_margins(
    gains: WrenchGains, models: Sequence[LimbModel], stiffness: ArrayLike, delay_s: float
) -> tuple[Margins, tuple[Margins, ...]]:
    """Margins of the wrench loop on a rigid target and of every limb's loop, with a delay.

    Args:
        gains: of both loops.
        models: (n,) of the limbs.
        stiffness: k_e, one for all limbs or (n,) [N/m].
        delay_s: of every sample on its way to the current [s].
    """
    in_range("delay_s", delay_s, 0.0, 0.1)
    s = np.multiply(1j, FREQUENCIES)
    late = np.exp(-s * delay_s)
    springs = one_or_each("stiffness", stiffness, len(models))
    outer = margins(FREQUENCIES, wrench_loop(gains, models[0], float(springs[0]), s, delay_s))
    inner = tuple(
        margins(FREQUENCIES, late * limb_loop(model, limb, float(k_e), s))
        for model, limb, k_e in zip(models, gains.limbs, springs, strict=True)
    )
    return outer, inner
