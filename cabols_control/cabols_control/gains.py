# SPDX-License-Identifier: Apache-2.0
"""Gains of both loops by pole placement: (3.15) for a limb alone, (3.24), (3.25) for both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cabols_control.checks import FloatArray, in_range, one_or_each
from cabols_control.errors import ShapeError
from cabols_control.limb import LimbModel


@dataclass(frozen=True)
class LimbGains:
    """Gains of the limb law (3.10).

    Attributes:
        integral: k_I [A/m].
        velocity: k_P1 [A s/m].
        tension: k_P2 [m/s/N].
    """

    integral: float
    velocity: float
    tension: float


@dataclass(frozen=True)
class WrenchGains:
    """Gains of both loops, designed together.

    Attributes:
        limbs: gains of each limb's law (3.10).
        proportional: k_Po of the wrench law (3.17) [-].
        integral: k_Io of the wrench law (3.17) [1/s].
    """

    limbs: tuple[LimbGains, ...]
    proportional: float
    integral: float


def limb_gains(model: LimbModel, stiffness: float, poles: ArrayLike) -> LimbGains:
    """Place the three poles of one limb's closed tension loop (3.13), by (3.15).

    Args:
        model: identified limb (3.11).
        stiffness: k_e of spring and cable [N/m].
        poles: three poles with negative real parts, complex ones in pairs [1/s].

    Returns:
        Gains of (3.10).

    Raises:
        ShapeError: on other than three stable poles.
        OutOfRangeError: if the model or the stiffness is not positive and finite.
    """
    _, a, b, c = _characteristic(poles, 3)
    return _limb_gains(model, a, b, tension=c / (_positive("stiffness", stiffness) * b))


def wrench_gains(
    models: Sequence[LimbModel], stiffness: ArrayLike, poles: ArrayLike, zero: float
) -> WrenchGains:
    """Place the four poles and the zero of every wrench component's closed loop (3.26).

    The limbs' models and stiffnesses may differ: the gains make their closed loops the same,
    (3.27). That and the structure matrix make the wrench's response linear although redundancy
    resolution is not.

    Args:
        models: identified limbs (3.11).
        stiffness: k_e of spring and cable, one for all limbs or one for each [N/m].
        poles: four poles with negative real parts, complex ones in pairs [1/s].
        zero: the zero lies at -abs(zero) [1/s]. The source writes Z = -40, but its (3.24) and
            (3.25) hold with Z = +40; both spellings are taken here.

    Returns:
        Gains of (3.10) for each limb and of (3.17).

    Raises:
        ShapeError: on other than four stable poles, no limb, or another number of stiffnesses.
        OutOfRangeError: if a model, the stiffness or the zero is not positive and finite, or the
            zero is so slow that the inner loop would need a gain of the wrong sign.
    """
    _, a, b, c, d = _characteristic(poles, 4)
    z = _positive("abs(zero)", abs(zero))
    inner = in_range("c Z - d (is the zero too close to 0?)", c * z - d, 1e-9 * d, np.inf)
    if not models:
        raise ShapeError("models: expected at least one limb, got none")
    springs = one_or_each("stiffness", stiffness, len(models))
    limbs = tuple(
        _limb_gains(model, a, b, tension=inner / (_positive("stiffness", float(k_e)) * b * z))
        for model, k_e in zip(models, springs, strict=True)
    )
    return WrenchGains(limbs, proportional=d / inner, integral=d * z / inner)


def _limb_gains(model: LimbModel, a: float, b: float, tension: float) -> LimbGains:
    gain = _positive("model.gain", model.gain)
    time_constant = _positive("model.time_constant", model.time_constant)
    return LimbGains(
        integral=b * time_constant / gain,
        velocity=(a * time_constant - 1.0) / gain,
        tension=tension,
    )


def _positive(name: str, value: float) -> float:
    return in_range(name, value, np.finfo(float).tiny, np.finfo(float).max)


def _characteristic(poles: ArrayLike, order: int) -> FloatArray:
    """Coefficients of prod(s - p), highest power first."""
    values = np.asarray(poles, dtype=np.complex128)
    if np.ma.is_masked(poles):
        raise ShapeError(f"poles: expected {order} poles without a mask, got {poles!r}")
    if values.shape != (order,) or not np.isfinite(values).all():
        raise ShapeError(f"poles: expected {order} finite poles, got {poles!r}")
    if not values.real.max() < 0.0:
        raise ShapeError(f"poles: expected negative real parts, got {poles!r}")
    coefficients = np.poly(values)
    if np.iscomplexobj(coefficients) and np.abs(coefficients.imag).max() > 0.0:
        raise ShapeError(f"poles: expected complex poles in conjugate pairs, got {poles!r}")
    return np.asarray(coefficients.real, dtype=np.float64)
