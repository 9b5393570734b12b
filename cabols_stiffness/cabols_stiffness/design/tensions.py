# SPDX-License-Identifier: Apache-2.0
"""Optimal tensions for given configurations, in an order that is quick to measure."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from cabols_control.checks import FloatArray
from cabols_control.geometry import RigGeometry
from cabols_stiffness.design.candidates import Candidates, candidate_loads
from cabols_stiffness.design.information import Information, Setup
from cabols_stiffness.design.search import Design, choose


def optimal_tensions(
    setup: Setup,
    geometry: RigGeometry,
    configurations: FloatArray,
    peaks: int,
    *,
    tension: tuple[float, float],
    wrench_limit: ArrayLike,
    criterion: str = "D",
    directions: int = 24,
    seed: int = 0,
) -> tuple[list[FloatArray], Design]:
    """Peaks of the tension trajectory at each of the rig's stored configurations.

    Args:
        setup: robot, guessed stiffness, tracker.
        geometry: of the rig.
        configurations: (c, 6) joints [rad].
        peaks: loads at each configuration.
        tension: least (holding) and greatest of every cable [N].
        wrench_limit: (6,) of the sensor, platform axes [N, N m].
        criterion: "D" or "A".
        directions: candidates at each configuration.
        seed: of the directions.

    Returns:
        c arrays (peaks, cables) [N], and the design they are from.

    Raises:
        CabolsError: as candidate_loads and choose.
    """
    candidates = candidate_loads(
        setup.robot,
        geometry,
        configurations,
        directions,
        tension=tension,
        wrench_limit=wrench_limit,
        seed=seed,
    )
    count = candidates.configurations.shape[0]
    design = choose(Information(setup, candidates), peaks * count, count, criterion, peaks)
    return tensions_of(candidates, design, tension[0]), design


def tensions_of(candidates: Candidates, design: Design, holding: float) -> list[FloatArray]:
    """Chosen tensions of each candidate configuration, (m, cables) [N]; m may be 0.

    Neighbours in the order differ as little as the nearest of the remaining ones allows.

    Args:
        candidates: what there was to choose from.
        design: what was chosen.
        holding: tension at which a trajectory begins [N].
    """
    found = []
    for index in range(candidates.configurations.shape[0]):
        here = design.chosen[candidates.configuration[design.chosen] == index]
        left = list(candidates.tension[here])
        ordered: list[FloatArray] = []
        at = np.full(candidates.tension.shape[1], holding)
        while left:
            away = [float(np.abs(peak - at).max()) for peak in left]
            at = left.pop(int(np.argmin(away)))
            ordered.append(at)
        found.append(np.array(ordered).reshape(-1, candidates.tension.shape[1]))
    return found
