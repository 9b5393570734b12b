# SPDX-License-Identifier: Apache-2.0
"""Result of a pose, narrowed by one pair of facets after the other, compiled.

Every reduction starts without a facet, lets NaN through, and ends by `finish_result`, which makes
NaN and a result without facets the worst.
"""

from __future__ import annotations

import math

from cabols_control.checks import FloatArray
from cabols_control.tension.kernels.static_size import compiled

MARGIN, FACTOR, CLOSURE, LOWEST, HIGHEST = 0, 1, 2, 3, 4
"""Places in a result: see `capacity_at`."""
RESULTS = 5


@compiled
def start_result(out: FloatArray) -> None:
    """Start without any facet; `finish_result` lets no result pass that took none."""
    out[MARGIN], out[HIGHEST], out[CLOSURE], out[LOWEST] = math.inf, math.inf, math.inf, 0.0


@compiled
def worst_result(out: FloatArray) -> None:
    """Write the result of a pose that is out of reach: nothing fits."""
    out[MARGIN], out[FACTOR], out[CLOSURE] = -math.inf, 0.0, 0.0
    out[LOWEST] = out[HIGHEST] = math.nan


@compiled
def _shrink(reach: float, need: float, out: FloatArray) -> None:
    """Narrow the range of factors s with s need <= reach."""
    if need > 0.0:
        out[HIGHEST] = min(out[HIGHEST], reach / need)
    elif need < 0.0:
        out[LOWEST] = max(out[LOWEST], reach / need)
    elif reach < 0.0:
        out[HIGHEST] = -math.inf


@compiled
def _least(so_far: float, value: float) -> float:
    """Smaller of the two, NaN as soon as one is NaN and from then on."""
    return value if value < so_far or value != value else so_far


@compiled
def take_facet(
    length: float,
    up: float,
    down: float,
    need_up: float,
    need_down: float,
    ahead: float,
    behind: float,
    out: FloatArray,
) -> None:
    """Take one pair of opposite facets into the result.

    Args:
        length: of the normal.
        up: how far the zonotope reaches along the normal, times length [N].
        down: the same against it.
        need_up: how far the required set reaches along it, times length [N].
        need_down: against it.
        ahead: sum of the positive y, what unit tensions can give along the normal.
        behind: the same against it.
        out: result, updated.
    """
    scale = 1.0 / length
    out[MARGIN] = _least(out[MARGIN], _least(up - need_up, down - need_down) * scale)
    out[CLOSURE] = _least(out[CLOSURE], min(ahead, behind) * scale)
    _shrink(up, need_up, out)
    _shrink(down, need_down, out)


@compiled
def finish_result(out: FloatArray) -> None:
    """Judge what the facets left: NaN, and a result that no facet bounded, are the worst.

    The figure of merit FACTOR is the largest multiple that fits, if all from 1 or less up to it
    do: 0 where the set fits only when it is enlarged, or never.
    """
    if not (out[MARGIN] < math.inf and out[CLOSURE] < math.inf):
        worst_result(out)
        return
    if not out[HIGHEST] >= out[LOWEST]:
        out[FACTOR], out[LOWEST], out[HIGHEST] = 0.0, math.nan, math.nan
        return
    out[FACTOR] = out[HIGHEST] if out[LOWEST] <= 1.0 or out[MARGIN] >= 0.0 else 0.0
    if not out[MARGIN] >= 0.0 and out[FACTOR] > 1.0:
        out[FACTOR] = 1.0
