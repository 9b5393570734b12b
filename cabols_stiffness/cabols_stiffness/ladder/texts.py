# SPDX-License-Identifier: Apache-2.0
"""What the ladder chose, for people and for result.yaml."""

from __future__ import annotations

from typing import Any

import numpy as np

from cabols_control.checks import FloatArray
from cabols_stiffness.ladder.choose import Step
from cabols_stiffness.ladder.identified import Combination, Identified
from cabols_stiffness.model.robot import RobotModel

HEADER = ("tried", "parameters", "held-out error", "gain", "taken")


def ladder_rows(found: Identified) -> list[list[str]]:
    """Return the choice as a table under HEADER.

    Args:
        found: by the ladder.
    """
    rows = []
    for step in _steps(found):
        gain = f"{100.0 * step.gain:.1f} +- {100.0 * step.doubt:.1f} %" if step.gain else "-"
        taken = "yes" if step.taken else "no"
        rows.append([step.name, str(step.parameters), f"{step.rms:.3f}", gain, taken])
    return rows


def ladder_text(found: Identified, robot: RobotModel) -> str:
    """Table of the choice, bounds and combinations, for the terminal.

    Args:
        found: by the ladder.
        robot: that it is of.
    """
    table = [list(HEADER), *ladder_rows(found)]
    width = max(len(row[0]) for row in table)
    lines = ["ladder of models, errors at held-out configurations in the stated noise:"]
    lines += [
        f"  {name:{width}s} {parameters:>10s} {error:>15s} {gain:>18s} {taken:>6s}"
        for name, parameters, error, gain, taken in table
    ]
    if found.choice.rivals:
        names = ", ".join(candidate.name for candidate, _ in found.choice.rivals)
        lines.append(f"  predicts as well, and is held by the deviations: {names}")
    if found.fit.scatter.any:
        lines.append("  configurations differ beyond it; predictions hold that scatter")
    for j in np.flatnonzero(~found.result.identifiable):
        unit = "N/m" if robot.slides[j] else "N m/rad"
        lines.append(f"  {robot.joint_names[j]}: at least {found.lower_bound[j]:.4g} {unit} (95 %)")
    lines += [f"  known together: {_combined(one, robot)}" for one in found.combinations]
    return "\n".join(lines)


def ladder_mapping(found: Identified) -> dict[str, Any]:
    """Return the key `ladder` of result.yaml.

    Args:
        found: by the ladder.
    """
    steps = [
        {
            "rung": step.rung.value,
            "variant": step.name,
            "parameters": step.parameters,
            "held_out_rms": float(step.rms),
            "gain": float(step.gain),
            "gain_deviation": float(step.doubt),
            "taken": bool(step.taken),
        }
        for step in _steps(found)
    ]
    return {
        "ladder": {
            "steps": steps,
            "rivals_of_friction": [candidate.name for candidate, _ in found.choice.rivals],
            "covariance_widened_by": float(found.fit.widened),
            "lower_bound_95_nm_per_rad": _plain(found.lower_bound),
            "combinations": [
                {"share": _plain(one.share), "deviation": float(one.deviation)}
                for one in found.combinations
            ],
        }
    }


def _steps(found: Identified) -> tuple[Step, ...]:
    more = () if found.calibration is None else found.calibration.steps
    return (*found.choice.steps, *more)


def _combined(one: Combination, robot: RobotModel) -> str:
    parts = [
        f"{share:+.2f} {name}"
        for share, name in zip(one.share, robot.joint_names, strict=True)
        if abs(share) > 0.05
    ]
    return f"{' '.join(parts)} (relative compliances), deviation {100.0 * one.deviation:.2f} %"


def _plain(values: FloatArray) -> list[float]:
    return [float(value) for value in values]
