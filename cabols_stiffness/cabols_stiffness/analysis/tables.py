# SPDX-License-Identifier: Apache-2.0
"""The tables of an analysis: for the terminal, for the report and as CSV."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cabols_control.naming import joint_name, number
from cabols_stiffness.analysis.study import Study
from cabols_stiffness.identification.validation import Validation
from cabols_stiffness.ladder.texts import ladder_text
from cabols_stiffness.measurements.measured_load import columns, to_cells
from cabols_stiffness.model.result import StiffnessResult
from cabols_stiffness.model.robot import JOINTS
from cabols_stiffness.model.verdict_text import verdict_lines

Rows = list[list[str]]


def stiffness_table(study: Study) -> tuple[list[str], Rows]:
    """Return table 4.3: each joint's stiffness by configuration, their mean, the pooled result."""
    each = (f"conf. {number(index)}" for index, _ in study.by_configuration)
    header = ["joint", *each, "mean", "pooled", "deviation", "95 %"]
    values = np.array([found for _, found in study.by_configuration])
    result, rows = study.result, []
    for j in range(JOINTS):
        known = values[:, j][np.isfinite(values[:, j])]
        mean = _whole(known.mean()) if known.size else "-"
        low, high = result.interval[j]
        relative = 100.0 * result.standard_deviation[j] / result.stiffness[j]
        rows.append(
            [
                f"k{number(j)}",
                *(_whole(value) for value in values[:, j]),
                mean,
                _whole(result.stiffness[j]),
                f"{relative:.2f} %" if result.identifiable[j] else "not identifiable",
                f"{_whole(low)} to {_whole(high)}" if result.identifiable[j] else "-",
            ]
        )
    return header, rows


def summary(study: Study) -> str:
    """What an analysis found, for the terminal: its verdict, then numbers."""
    result, frames = study.result, study.frames
    lines = [] if result.verdict is None else verdict_lines(result.verdict)
    lines.append("joint   stiffness [Nm/rad]   deviation    95 % interval")
    for j in range(JOINTS):
        if not result.identifiable[j]:
            lines.append(f"{number(j):5d}   not identifiable from these loads")
            continue
        relative = 100.0 * result.standard_deviation[j] / result.stiffness[j]
        low, high = result.interval[j]
        lines.append(
            f"{number(j):5d}   {result.stiffness[j]:18.0f}   {relative:7.2f} %    "
            f"{low:.0f} to {high:.0f}"
        )
    lines += _cubic_lines(result) + _friction_lines(result)
    lines.append(
        f"{result.model} model, {result.samples} samples, normalised residual "
        f"{result.residual_rms:.3f}, {result.outliers.size} outliers"
    )
    if frames.poses:
        lines.append(
            f"tracker registered from {frames.poses} configurations, references within "
            f"{1e6 * frames.residual:.0f} um of where the robot says"
        )
        if not frames.fits:
            lines.append(
                f"the references do not fit one place of the tracker (p = {frames.probability:.1g})"
                ": was it moved, or is the robot less accurate than it repeats?"
            )
    else:
        lines.append("tracker's frame and reflectors: nominal")
    if study.climbed is not None:
        lines.append(ladder_text(study.climbed, study.robot))
    if study.choice is not None:
        errors = ", ".join(
            f"{model} {1e6 * error:.2f} um" for model, error in study.choice.held_out_error.items()
        )
        lines.append(f"held-out loads prefer the {study.choice.model} model: error {errors}")
    if study.point_validation is not None:
        lines.append(_validation_line(study.point_validation))
    return "\n".join(lines)


def _cubic_lines(result: StiffnessResult) -> list[str]:
    """Cubic terms of (4.8), if the model has them."""
    if result.cubic is None or result.cubic_deviation is None:
        return []
    lines = ["joint   cubic term [Nm/rad^3]   deviation"]
    for j in range(JOINTS):
        if result.cubic_identifiable[j]:
            lines.append(
                f"{number(j):5d}   {result.cubic[j]:21.4g}   {result.cubic_deviation[j]:9.2g}"
            )
        else:
            lines.append(f"{number(j):5d}   not identifiable from these loads")
    return lines


def _friction_lines(result: StiffnessResult) -> list[str]:
    """Joints whose two branches differ."""
    return [
        f"{joint_name(j)}: hysteresis, {result.friction[j]:.3g} N m of friction "
        f"(deviation {result.friction_deviation[j]:.2g})"
        for j in range(JOINTS)
        if result.friction[j] > 0.0
    ]


def _validation_line(validation: Validation) -> str:
    error = float(np.sqrt(np.sum(validation.error_rms**2)))
    return (
        f"validation at another configuration, under other loads: {100 * validation.explained:.2f} "
        f"% of the deflection predicted, error {1e6 * error:.1f} um rms, normalised "
        f"{validation.normalised_rms:.2f}"
    )


def write_tables(study: Study, folder: Path) -> list[Path]:
    """Write stiffness.csv, loads.csv and, with a validation, validation.csv.

    Args:
        study: what was found.
        folder: to write them to.

    Returns:
        Their paths.
    """
    found = [folder / "stiffness.csv", folder / "loads.csv"]
    _write(found[0], *_stiffness_csv(study))
    _write(found[1], columns(study.plan.limbs), [to_cells(load) for load in study.loads])
    if study.pose_validation is not None:
        found.append(folder / "validation.csv")
        _write(found[2], *_validation_csv(study.pose_validation))
    return found


def _stiffness_csv(study: Study) -> tuple[list[str], Rows]:
    header = [
        "joint",
        *(f"configuration_{number(i)}_nm_per_rad" for i, _ in study.by_configuration),
    ]
    header += ["pooled_nm_per_rad", "deviation_nm_per_rad", "low_95_nm_per_rad"]
    header += ["high_95_nm_per_rad"]
    result = study.result
    rows = []
    for j in range(JOINTS):
        single = [found[j] for _, found in study.by_configuration]
        pooled = (result.stiffness[j], result.standard_deviation[j], *result.interval[j])
        rows.append([str(number(j)), *(repr(float(value)) for value in (*single, *pooled))])
    return header, rows


def _validation_csv(validation: Validation) -> tuple[list[str], Rows]:
    axes = ("x_m", "y_m", "z_m", "rx_rad", "ry_rad", "rz_rad")
    kinds = ("measured", "predicted", "band_95")
    header = ["load", *(f"{kind}_{axis}" for kind in kinds for axis in axes)]
    tables = (validation.measured, validation.predicted, validation.band)
    rows = [
        [str(number(k)), *(repr(float(value)) for table in tables for value in table[k])]
        for k in range(len(validation.measured))
    ]
    return header, rows


def _write(path: Path, header: Sequence[str], rows: Rows) -> None:
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(rows)


def _whole(value: float) -> str:
    return f"{value:.0f}" if np.isfinite(value) else "-"
