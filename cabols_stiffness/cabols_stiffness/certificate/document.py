# SPDX-License-Identifier: Apache-2.0
"""Fields of a digital calibration certificate (DCC), as plain data for JSON.

Names follow PTB's DCC schema, version 3, and units its D-SI; the file is data to fill a DCC from,
and not itself a signed XML document.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.naming import number
from cabols_stiffness.certificate.budget import Budget
from cabols_stiffness.certificate.compliance import MeasuredCompliance
from cabols_stiffness.certificate.statement import Instrument, Statement
from cabols_stiffness.model.result import StiffnessResult
from cabols_stiffness.model.robot import RobotModel

ROTARY, SLIDING = r"\newton\metre\per\radian", r"\newton\per\metre"
PER_FORCE = r"\metre\per\newton"


@dataclass(frozen=True, eq=False)
class Certificate:
    """All that a certificate shows.

    Attributes:
        statement: who, where, with what.
        robot: that was identified.
        result: of it, judged.
        budget: of its uncertainty.
        compliance: measured at each configuration.
        left_out: what was not used, and why; sentences.
        residual: (k,) largest normalised residual component of each sample.
        load: (k,) number of each sample's load.
        configuration: (k,) of each sample.
        torque: (k, n) of the joints [N m].
        singles: (c, n, 3) stiffness at each configuration alone, low and high ends of its 95 %.
    """

    statement: Statement
    robot: RobotModel
    result: StiffnessResult
    budget: Budget
    compliance: Sequence[MeasuredCompliance]
    left_out: Sequence[str]
    residual: FloatArray
    load: FloatArray
    configuration: FloatArray
    torque: FloatArray
    singles: FloatArray


def software() -> dict[str, str]:
    """Name and release of this package."""
    try:
        release = version("cabols_stiffness")
    except PackageNotFoundError:
        release = "unknown"
    return {"name": "cabols_stiffness", "release": release}


def document(found: Certificate) -> dict[str, Any]:
    """Return the fields of the certificate.

    Args:
        found: all that it shows.
    """
    said = found.statement
    verdict = found.result.verdict
    return {
        "schema": "fields of DCC 3, see ptb.de/dcc",
        "administrativeData": {
            "dccSoftware": [software()],
            "coreData": {
                "countryCodeISO3166_1": said.country,
                "usedLangCodeISO639_1": ["en"],
                "mandatoryLangCodeISO639_1": ["en"],
                "uniqueIdentifier": said.number,
                "beginPerformanceDate": said.begin,
                "endPerformanceDate": said.end,
                "performanceLocation": said.place,
            },
            "items": [_item(said.robot)],
            "calibrationLaboratory": {"contact": {"name": said.laboratory}},
            "respPersons": [{"person": {"name": said.operator}, "mainSigner": True}],
            "customer": {"name": said.customer},
            "statements": [
                {"name": "verdict on the model", "declaration": _verdict(found)},
                *({"name": "left out", "declaration": text} for text in found.left_out),
                *([{"name": "remarks", "declaration": said.remarks}] if said.remarks else []),
            ],
        },
        "measurementResults": [
            {
                "name": "joint stiffness and static compliance",
                "usedMethods": [
                    {"name": "weighted orthogonal distance regression of joint deflections"},
                    {"name": "static compliance at the mechanical interface, after ISO 9283"},
                    {"name": "uncertainty after JCGM 100:2008"},
                ],
                "usedSoftware": [software()],
                "measuringEquipments": [_item(one) for one in said.instruments],
                "influenceConditions": [
                    {
                        "name": one.name,
                        "data": {
                            "value": one.value,
                            "unit": one.unit,
                            "expandedUnc": {"uncertainty": one.uncertainty, "coverageFactor": 2.0},
                        },
                    }
                    for one in said.conditions
                ],
                "results": [_stiffness(found), _compliance(found), _budget(found)],
                "adequate": bool(verdict is not None and verdict.adequate),
            }
        ],
    }


def _verdict(found: Certificate) -> str:
    verdict = found.result.verdict
    return "not judged" if verdict is None else f"{verdict.grade.value}: {verdict.reason}"


def _item(one: Instrument) -> dict[str, Any]:
    return {
        "name": one.name,
        "manufacturer": one.manufacturer,
        "model": one.model,
        "identifications": [{"issuer": "manufacturer", "value": one.serial, "name": "serial"}],
        "calibrated": one.calibrated,
        "certificate": one.certificate,
    }


def _stiffness(found: Certificate) -> dict[str, Any]:
    data = []
    for j, name in enumerate(found.robot.joint_names):
        value = found.result.stiffness[j]
        half = value * found.budget.expanded[j]
        data.append(
            {
                "name": f"stiffness of {name}",
                "real": {
                    "value": _plain(value),
                    "unit": SLIDING if found.robot.slides[j] else ROTARY,
                    "expandedUnc": {
                        "uncertainty": _plain(half),
                        "coverageFactor": _plain(found.budget.coverage[j]),
                        "coverageProbability": 0.95,
                        "distribution": "t",
                    },
                },
            }
        )
    return {
        "name": "joint stiffness",
        "data": data,
        "correlation": [[_plain(value) for value in row] for row in found.budget.correlation],
    }


def _compliance(found: Certificate) -> dict[str, Any]:
    data = []
    for one in found.compliance:
        for axis, letter in enumerate("xyz"):
            data.append(
                {
                    "name": f"compliance along {letter}, configuration {number(one.configuration)}",
                    "joints_rad": [float(value) for value in one.joints],
                    "largest_force_n": float(one.largest_force[axis]),
                    "real": {
                        "value": _plain(one.compliance[axis]),
                        "unit": PER_FORCE,
                        "expandedUnc": {
                            "uncertainty": _plain(2.0 * one.deviation[axis]),
                            "coverageFactor": 2.0,
                            "coverageProbability": 0.95,
                        },
                    },
                }
            )
    return {"name": "measured static compliance at the mechanical interface", "data": data}


def _budget(found: Certificate) -> dict[str, Any]:
    rows = [
        {
            "source": row.name,
            "evidence": row.evidence,
            "type": row.kind,
            "standard_uncertainty": _plain(row.standard_uncertainty),
            "unit": row.unit,
            "relative_of_stiffness": [_plain(value) for value in row.relative],
            "degrees_of_freedom": [_plain(value) for value in row.freedom],
        }
        for row in found.budget.rows
    ]
    return {
        "name": "uncertainty budget",
        "data": rows,
        "combined_relative": [_plain(value) for value in found.budget.combined],
        "effective_degrees_of_freedom": [_plain(value) for value in found.budget.freedom],
    }


def _plain(value: float) -> float | None:
    number_ = float(value)
    return number_ if np.isfinite(number_) else None
