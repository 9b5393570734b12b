# SPDX-License-Identifier: Apache-2.0
"""A verdict as plain numbers and lists, for result.yaml, and back."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np

from cabols_control.errors import ConfigError
from cabols_stiffness.model.verdict import Finding, Grade, Suspect, Verdict

ARRAYS = ("explained_by_axis", "share_of_joint", "scatter", "leave_one_out")


def verdict_mapping(verdict: Verdict) -> dict[str, Any]:
    """Return the content of the key `verdict`."""
    content: dict[str, Any] = {"grade": verdict.grade.value, "reason": verdict.reason}
    for field in fields(Verdict):
        value = getattr(verdict, field.name)
        if field.name in ARRAYS:
            content[field.name] = np.asarray(value).tolist()
        elif field.name not in ("grade", "findings"):
            content[field.name] = value if isinstance(value, int) else float(value)
    content["findings"] = [
        {
            "suspect": one.suspect.value,
            "text": one.text,
            "improvement": float(one.improvement),
            "probability": float(one.probability),
            "shift": float(one.shift),
            "grave": bool(one.grave),
        }
        for one in verdict.findings
    ]
    return content


def read_verdict(content: Any) -> Verdict | None:
    """Read what verdict_mapping wrote; None for a result without a verdict.

    Raises:
        ConfigError: if it is none.
    """
    if content is None:
        return None
    try:
        values: dict[str, Any] = {
            field.name: content[field.name]
            for field in fields(Verdict)
            if field.name not in ("grade", "findings", *ARRAYS)
        }
        found = [
            Finding(**{**one, "suspect": Suspect(one["suspect"])}) for one in content["findings"]
        ]
        values |= {name: np.array(content[name], dtype=np.float64) for name in ARRAYS}
        grade = Grade(content["grade"])
    except (KeyError, TypeError, ValueError) as error:
        raise ConfigError(f"verdict: expected what a report writes, got {error!r}") from error
    return Verdict(grade=grade, findings=tuple(found), **values)
