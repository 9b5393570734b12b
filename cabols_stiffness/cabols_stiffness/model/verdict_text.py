# SPDX-License-Identifier: Apache-2.0
"""A verdict in words, for the terminal and for reports."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cabols_control.checks import FloatArray
from cabols_stiffness.model.verdict import Verdict

MEASURED = ("x", "y", "z", "rx", "ry", "rz")


def verdict_lines(verdict: Verdict) -> list[str]:
    """Grade with its reason, other findings, and the figures that it rests on.

    Args:
        verdict: on an identification.
    """
    lines = [f"verdict: {verdict.grade.value}: {verdict.reason}"]
    first = next((one for one in verdict.findings if one.grave), None)
    lines += [f"  {one.text}" for one in verdict.findings if one is not first]
    lines.append(
        f"  {100.0 * verdict.explained:.1f} % explained; chi-square {verdict.chi_square:.0f} for "
        f"{verdict.degrees_of_freedom} degrees of freedom (p = {verdict.probability:.2g}); "
        f"between configurations Q {verdict.cochran_q:.0f} for {verdict.cochran_freedom}"
    )
    return lines


def verdict_rows(verdict: Verdict, joint_names: Sequence[str]) -> list[tuple[str, str]]:
    """(what, value) of every figure of a verdict.

    Args:
        verdict: on an identification.
        joint_names: n of them.
    """
    axes = ", ".join(
        f"{axis} {100.0 * share:.1f} %"
        for axis, share in zip(MEASURED, verdict.explained_by_axis, strict=False)
    )
    rows = [
        ("motion explained", f"{100.0 * verdict.explained:.2f} % ({axes})"),
        ("of it by each joint", _joints(verdict.share_of_joint, joint_names, "{:.1f} %")),
        (
            "residuals against the stated noise",
            f"chi-square {verdict.chi_square:.1f} for {verdict.degrees_of_freedom} degrees of "
            f"freedom, p = {verdict.probability:.2g}",
        ),
        (
            "between configurations",
            f"Cochran's Q {verdict.cochran_q:.1f} for {verdict.cochran_freedom}, "
            f"p = {verdict.cochran_probability:.2g}",
        ),
    ]
    if np.any(verdict.scatter):
        rows.append(
            (
                "standard deviation between configurations",
                _joints(verdict.scatter, joint_names, "{:.1f} %"),
            )
        )
    if verdict.leave_one_out.size:
        largest = np.abs(verdict.leave_one_out).max(axis=0)
        rows.append(
            (
                "largest change without one configuration",
                _joints(largest, joint_names, "{:.2f} %"),
            )
        )
    left = f"{verdict.missing} without a number, {verdict.repeated} repeated"
    rows.append(("rows left out", left))
    return rows


def _joints(values: FloatArray, names: Sequence[str], form: str) -> str:
    parts = zip(names, values, strict=True)
    return ", ".join(f"{name} {form.format(100.0 * value)}" for name, value in parts)
