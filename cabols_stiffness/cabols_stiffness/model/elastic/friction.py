# SPDX-License-Identifier: Apache-2.0
"""Friction of a joint that depends on its past, in several forms, relative to its full size.

Each form draws the friction from -1 to 1 along the joint's motion; `travel` is the motion after
which nearly all of it is drawn. Maxwell slip: springs behind sliders that give one after the other
(Iwan 1966), here evenly spread. Generalised: the same with sliders over more than a decade, so that
it rises steeply first. Dahl (1968): exponential. Coulomb: all at once.
"""

from __future__ import annotations

from enum import StrEnum

import numpy as np

from cabols_control.checks import FloatArray


class Form(StrEnum):
    """How friction is drawn along a joint's motion."""

    MAXWELL = "maxwell"
    GENERALISED = "generalised"
    DAHL = "dahl"
    COULOMB = "coulomb"


SLIDERS = {
    Form.MAXWELL: np.array([0.25, 0.5, 0.75, 1.0]),
    Form.GENERALISED: np.array([0.03, 0.08, 0.25, 1.0]),
}
"""Motion after which each slider gives, of the travel."""

DAHL_RATE = 3.0
"""After the travel, Dahl's friction is drawn to 1 - exp(-3)."""

STANDS_RAD = 1e-8
"""Motion below which Coulomb's friction keeps its sign [rad]."""


def friction_along(form: Form, path: FloatArray, travel: FloatArray) -> FloatArray:
    """Friction along a path that begins relaxed, at zero.

    Args:
        form: of the friction.
        path: (t, ..., n) deflections in their order; leading dimensions of `travel` broadcast
            [rad].
        travel: (..., n) see above [rad].

    Returns:
        (t, ..., n) from -1 to 1.
    """
    shape = np.broadcast_shapes(path.shape[1:], travel.shape)
    share = np.empty((path.shape[0], *shape))
    before, drawn = np.zeros(shape), np.zeros(shape)
    reach = SLIDERS.get(form)
    steps = np.ones(1)
    if reach is not None:
        steps = np.maximum(travel[..., None] * reach, 1e-12)
        drawn = np.zeros((*shape, reach.size))
    for index in range(path.shape[0]):
        now = np.broadcast_to(path[index], shape)
        step = now - before
        before = now
        if reach is not None:
            drawn = np.clip(drawn + step[..., None] / steps, -1.0, 1.0)
            share[index] = drawn.mean(axis=-1)
            continue
        sign = np.sign(step)
        if form is Form.DAHL:
            left = np.exp(-DAHL_RATE * np.abs(step) / np.maximum(travel, 1e-12))
            drawn = sign + (drawn - sign) * left
        else:
            drawn = np.where(np.abs(step) > STANDS_RAD, sign, drawn)
        share[index] = drawn
    return share
