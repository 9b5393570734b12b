# SPDX-License-Identifier: Apache-2.0
"""One load as it was measured, unprocessed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.files.plain_numbers import plain_integer, plain_number
from cabols_control.naming import number
from cabols_stiffness.errors import CampaignError
from cabols_stiffness.measurements.window import WindowAverage

AXES = ("fx_n", "fy_n", "fz_n", "mx_nm", "my_nm", "mz_nm")
UPPER = np.triu_indices(6)
POSITION_UPPER = np.triu_indices(3)
INDICES = ("configuration_index", "reflector_index", "load_index")
"""Columns that say where a load was measured; they count from 0."""


def present_name(column: str) -> str:
    """Return a column's name of today; version 0.1 called the indices by their nouns alone."""
    index = f"{column}_index"
    return index if index in INDICES else column


@dataclass(frozen=True, eq=False)
class MeasuredLoad:
    """One load at one reflector.

    Attributes:
        configuration: of the robot, from 0.
        reflector: from 0.
        load: of the trajectory, from 0.
        group: pass that it belongs to.
        branch: 1 loading, -1 unloading, 0 reference.
        begin_ns: of the window that was averaged, the rig's time [ns].
        end_ns: likewise.
        tension: (n,) setpoints of the limbs [N].
        average: of wrench and joints in that window.
        position: (3,) of the reflector, tracker's frame [m].
        position_covariance: (3, 3) likewise [m^2].
    """

    configuration: int
    reflector: int
    load: int
    group: int
    branch: int
    begin_ns: int
    end_ns: int
    tension: FloatArray
    average: WindowAverage
    position: FloatArray
    position_covariance: FloatArray


def columns(limbs: int) -> list[str]:
    """Names of the columns of a table of measured loads; units in the name."""
    pairs = [f"{AXES[i]}__{AXES[j]}" for i, j in zip(*UPPER, strict=True)]
    return [
        *INDICES,
        *("group", "branch", "begin_ns", "end_ns"),
        *("wrench_samples",),
        *(f"tension_{number(i)}_n" for i in range(limbs)),
        *(f"joint_{number(i)}_rad" for i in range(6)),
        *AXES,
        *(f"deviation_{axis}" for axis in AXES),
        *(f"covariance_{pair}" for pair in pairs),
        *(f"reflector_{axis}_m" for axis in "xyz"),
        *(f"covariance_{'xyz'[i]}{'xyz'[j]}_m2" for i, j in zip(*POSITION_UPPER, strict=True)),
    ]


def to_cells(load: MeasuredLoad) -> list[str]:
    """One line of that table; floats with all their digits."""
    average = load.average
    whole = (
        *(load.configuration, load.reflector, load.load, load.group, load.branch),
        *(load.begin_ns, load.end_ns, average.samples),
    )
    numbers = (
        load.tension,
        average.joints,
        average.wrench,
        average.deviation,
        average.covariance[UPPER],
        load.position,
        load.position_covariance[POSITION_UPPER],
    )
    return [
        *(str(int(value)) for value in whole),
        *(repr(float(value)) for part in numbers for value in part),
    ]


def from_cells(cells: Sequence[str], limbs: int) -> MeasuredLoad:
    """Read one line of that table.

    Args:
        cells: of the line, as text.
        limbs: number of the rig's limbs.

    Raises:
        CampaignError: if the cells are no such line.
    """
    expected = len(columns(limbs))
    if len(cells) != expected:
        raise CampaignError(f"expected {expected} cells, got {len(cells)}")
    try:
        whole = [plain_integer(cell) for cell in cells[:8]]
        numbers = np.array([plain_number(cell) for cell in cells[8:]])
    except ValueError as error:
        raise CampaignError(str(error)) from error
    tension, joints, wrench, deviation, upper, position, rest = np.split(
        numbers, np.cumsum([limbs, 6, 6, 6, UPPER[0].size, 3])
    )
    configuration, reflector, load, group, branch, begin_ns, end_ns, samples = whole
    return MeasuredLoad(
        configuration,
        reflector,
        load,
        group,
        branch,
        begin_ns,
        end_ns,
        tension,
        WindowAverage(wrench, _symmetric(upper, 6), deviation, joints, samples),
        position,
        _symmetric(rest, 3),
    )


def _symmetric(upper: FloatArray, size: int) -> FloatArray:
    matrix = np.zeros((size, size))
    rows, columns_ = np.triu_indices(size)
    matrix[rows, columns_] = upper
    matrix[columns_, rows] = upper
    return matrix
