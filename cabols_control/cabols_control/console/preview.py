# SPDX-License-Identifier: Apache-2.0
"""A load programme as a small picture, in SVG."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape

WIDTH, HEIGHT, LEFT, RIGHT, GAP = 292, 178, 40, 8, 24
COLOURS = ("#60a5fa", "#4ade80", "#fbbf24")
PARTS = (("Force [N]", 0), ("Torque [N m]", 3))
SOFT, LINE = "#9fb0bf", "#2c3742"


def preview_svg(
    time: Sequence[float], wrench: Sequence[float], worst_time: float, name: str
) -> str:
    """Draw force and torque over time.

    Args:
        time: (k,) [s].
        wrench: k rows of six, one after the other [N, N m].
        worst_time: marked by a line and a word; NaN: none [s].
        name: of the programme, for screen readers.
    """
    panel = (HEIGHT - GAP) / 2 - 10
    end = max(time[-1], 1e-9) if time else 1.0
    parts = [
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" font-size="10" fill="{SOFT}" '
        f'aria-label="Load programme {escape(name, quote=True)}: force and torque over {end:g} s">'
    ]

    def x(t: float) -> float:
        return LEFT + (WIDTH - LEFT - RIGHT) * t / end

    for index, (title, first) in enumerate(PARTS):
        top = 12 + index * (panel + 12)
        columns = [[wrench[6 * k + first + i] for k in range(len(time))] for i in range(3)]
        most = max((abs(v) for column in columns for v in column), default=0.0) or 1.0
        middle = top + panel / 2

        def y(v: float, middle: float = middle, most: float = most) -> float:
            return middle - 0.46 * panel * v / most

        parts.append(
            f'<text x="{LEFT}" y="{top - 2:.0f}">{title}</text>'
            f'<line x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{middle:.1f}" y2="{middle:.1f}" '
            f'stroke="{LINE}"/>'
        )
        parts += [
            f'<text x="{LEFT - 4}" y="{y(value) + 3:.1f}" text-anchor="end">{value:.3g}</text>'
            for value in (most, 0.0, -most)
        ]
        for colour, column in zip(COLOURS, columns, strict=True):
            points = " ".join(f"{x(t):.1f},{y(v):.1f}" for t, v in zip(time, column, strict=True))
            parts.append(
                f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="1.4"/>'
            )
    parts.append(_foot(x, end, worst_time))
    return "".join([*parts, "</svg>"])


def _foot(x: object, end: float, worst_time: float) -> str:
    assert callable(x)
    bottom = HEIGHT - 14
    marks = [
        f'<text x="{x(0.0):.0f}" y="{HEIGHT - 3}">0</text>',
        f'<text x="{x(end):.0f}" y="{HEIGHT - 3}" text-anchor="end">{end:g} s</text>',
    ]
    for colour, name, k in zip(COLOURS, ("x", "y", "z"), range(3), strict=True):
        at = WIDTH / 2 - 30 + 30 * k
        marks.append(
            f'<line x1="{at}" x2="{at + 12}" y1="{HEIGHT - 6}" y2="{HEIGHT - 6}" '
            f'stroke="{colour}" stroke-width="2"/>'
            f'<text x="{at + 15}" y="{HEIGHT - 3}">{name}</text>'
        )
    if math.isfinite(worst_time):
        at = x(worst_time)
        marks.append(
            f'<line x1="{at:.1f}" x2="{at:.1f}" y1="12" y2="{bottom}" stroke="#ff6b5e" '
            f'stroke-dasharray="3 2"/><text x="{at:.1f}" y="{bottom - 2}" fill="#ff6b5e" '
            f'text-anchor="middle">not feasible</text>'
        )
    return "".join(marks)
