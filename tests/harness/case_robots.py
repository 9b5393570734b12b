# SPDX-License-Identifier: Apache-2.0
"""Public cable robots of tests/cases/cables/robots, and independent answers about them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import quadprog
import yaml
from scipy.optimize import linprog

from cabols_control.geometry import load_geometry

FOLDER = Path(__file__).parents[1] / "cases" / "cables" / "robots"
LIMITS = yaml.safe_load((FOLDER / "limits.yaml").read_text("utf-8"))


def load(name):
    """Geometry, (n,) least and (n,) largest tension [N], (6,) wrench that holds the weight."""
    geometry, model = load_geometry(FOLDER / f"{name}.yaml"), LIMITS[name]
    low, high = (
        np.broadcast_to(np.asarray(model[key], dtype=float), geometry.cables).copy()
        for key in ("tension_min", "tension_max")
    )
    weight = np.array([0.0, 0.0, 9.81 * model["mass"]])
    return geometry, low, high, np.r_[weight, np.cross(model["com"], weight)]


def lp_margin(A, wrench, low, high):
    """Largest s with A t = wrench, low + s <= t <= high - s by HiGHS [N]; negative: infeasible."""
    n, scale, row = A.shape[1], np.abs(high).max(), np.abs(A).max(axis=1)
    found = linprog(
        np.r_[np.zeros(n), -1.0],
        A_eq=np.c_[A, np.zeros(len(A))] / row[:, None],
        b_eq=wrench / scale / row,
        A_ub=np.r_[np.c_[-np.eye(n), np.ones(n)], np.c_[np.eye(n), np.ones(n)]],
        b_ub=np.r_[-low, high] / scale,
        bounds=[(None, None)] * (n + 1),
        method="highs",
    )
    return -found.fun * scale if found.status == 0 else np.nan


def least_norm(A, wrench, low, high):
    """Least-norm tensions of quadprog, polished on the active set; None where it finds none."""
    n, scale, row = A.shape[1], np.abs(high).max(), np.abs(A).max(axis=1)
    constraints = np.hstack([(A / row[:, None]).T, np.eye(n), -np.eye(n)])
    bounds = np.r_[wrench / scale / row, low / scale, -high / scale]
    try:
        start = quadprog.solve_qp(np.eye(n), np.zeros(n), constraints, bounds, len(A))[0] * scale
    except ValueError:
        return None
    for tolerance in (1e-7, 1e-9, 1e-6):
        at_low = np.abs(start - low) < tolerance * scale
        at_high = np.abs(start - high) < tolerance * scale
        tension = np.where(at_low, low, np.where(at_high, high, 0.0))
        free = ~(at_low | at_high)
        if free.any():
            right = (wrench - A @ tension) / row
            tension[free] = np.linalg.lstsq(A[:, free] / row[:, None], right, rcond=1e-13)[0]
        if (
            np.abs(A @ tension - wrench).max() < 1e-9 * scale * max(1.0, row.max())
            and np.all(tension >= low - 1e-9 * scale)
            and np.all(tension <= high + 1e-9 * scale)
        ):
            return tension
    return start
