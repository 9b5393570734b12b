# SPDX-License-Identifier: Apache-2.0
"""The certificate as HTML and as PDF, with its plots."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure

from cabols_control.naming import number
from cabols_control.report_page import embedded_picture, render_page
from cabols_stiffness.certificate.document import Certificate, document

if TYPE_CHECKING:
    from matplotlib.axes import Axes

POINT, LINE = "#c0392b", "#1f5fa8"
A4 = (8.27, 11.69)
LINES = 62
"""Of text on a page."""


def write_certificate(folder: Path, found: Certificate) -> list[Path]:
    """Write certificate.html, .pdf and .json.

    Args:
        folder: to write them to.
        found: all that they show.

    Returns:
        Their paths.
    """
    figures = [single_figure(found), residual_figure(found)]
    paths = [folder / f"certificate.{kind}" for kind in ("html", "pdf", "json")]
    page, pdf, data = paths
    content = document(found)
    data.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    said = found.statement
    text = render_page(
        "cabols_stiffness",
        "certificate.html.j2",
        title=f"Certificate {said.number}",
        subtitle=f"Stiffness of {said.robot.name}, {said.begin} to {said.end}",
        said=said,
        facts=facts(found),
        stiffness=stiffness_rows(found),
        budget=budget_rows(found),
        names=found.robot.joint_names,
        correlation=found.budget.correlation,
        compliance=compliance_rows(found),
        left_out=found.left_out,
        pictures=[embedded_picture(figure, 110.0) for figure in figures],
    )
    page.write_text(text, encoding="utf-8")
    with PdfPages(pdf) as pages:
        lines = text_lines(found)
        for begin in range(0, len(lines), LINES):
            pages.savefig(_text_page(lines[begin : begin + LINES]))
        for figure in figures:
            pages.savefig(figure)
    return paths


def facts(found: Certificate) -> list[tuple[str, str]]:
    """Who, where, with what; and the verdict.

    Args:
        found: all that the certificate shows.
    """
    said, verdict = found.statement, found.result.verdict
    robot = " ".join(filter(None, (said.robot.manufacturer, said.robot.model)))
    rows = [
        ("certificate", said.number),
        ("laboratory", said.laboratory),
        ("customer", said.customer),
        ("operator", said.operator),
        ("place", ", ".join(filter(None, (said.place, said.country)))),
        ("measured", f"{said.begin} to {said.end}"),
        ("robot", f"{said.robot.name}: {robot}, serial {said.robot.serial or 'not stated'}"),
    ]
    for one in said.instruments:
        what = " ".join(filter(None, (one.manufacturer, one.model)))
        rows.append(
            (
                one.name,
                f"{what}, serial {one.serial or 'not stated'}, calibrated "
                f"{one.calibrated or 'not stated'}, {one.certificate or 'no certificate stated'}",
            )
        )
    rows += [
        (one.name, f"({one.value:g} +- {one.uncertainty:g}) {one.unit}") for one in said.conditions
    ]
    if verdict is not None:
        rows.append(("verdict", f"{verdict.grade.value}: {verdict.reason}"))
    return rows


def stiffness_rows(found: Certificate) -> list[list[str]]:
    """Joint, stiffness, expanded uncertainty, coverage factor, degrees of freedom.

    Args:
        found: all that the certificate shows.
    """
    rows = []
    for j, name in enumerate(found.robot.joint_names):
        value, part = found.result.stiffness[j], found.budget.expanded[j]
        unit = "N/m" if found.robot.slides[j] else "N m/rad"
        if not np.isfinite(value):
            rows.append([name, "not identifiable from these loads", "", "", ""])
            continue
        freedom = found.budget.freedom[j]
        rows.append(
            [
                name,
                f"{value:.5g} {unit}",
                f"{value * part:.2g} {unit} ({100.0 * part:.2f} %)",
                f"{found.budget.coverage[j]:.2f}",
                f"{freedom:.0f}" if freedom < 1e4 else "infinite",
            ]
        )
    return rows


def budget_rows(found: Certificate) -> list[list[str]]:
    """Source, type, standard uncertainty, then each joint's part in percent.

    Args:
        found: all that the certificate shows.
    """
    rows = []
    for row in found.budget.rows:
        size = "-" if not np.isfinite(row.standard_uncertainty) else (
            f"{row.standard_uncertainty:.2g} {row.unit}"
        )  # fmt: skip
        cells = [f"{100.0 * value:.3f}" for value in row.relative]
        rows.append([row.name, row.kind, size, *cells, row.evidence])
    cells = [f"{100.0 * value:.3f}" for value in found.budget.combined]
    rows.append(["combined", "", "", *cells, ""])
    return rows


def compliance_rows(found: Certificate) -> list[list[str]]:
    """Configuration, then compliance along x, y, z with its expanded uncertainty [um/N].

    Args:
        found: all that the certificate shows.
    """
    rows = []
    for one in found.compliance:
        cells = [
            f"{1e6 * value:.3f} +- {2e6 * spread:.3f}"
            if np.isfinite(value)
            else "not shown by these loads"
            for value, spread in zip(one.compliance, one.deviation, strict=True)
        ]
        force = ", ".join(f"{value:.0f}" for value in one.largest_force)
        rows.append([str(number(one.configuration)), *cells, force])
    return rows


def text_lines(found: Certificate) -> list[str]:
    """The certificate's text, for the PDF.

    Args:
        found: all that it shows.
    """
    lines = ["CERTIFICATE OF A ROBOT'S STIFFNESS", ""]
    lines += [f"{name:14s} {value}" for name, value in facts(found)]
    lines += ["", "Joint stiffness; expanded uncertainty at 95 %, coverage factor, freedom"]
    lines += ["  ".join(cells) for cells in stiffness_rows(found)]
    lines += ["", "Uncertainty budget: parts of each joint's stiffness [%]"]
    lines += [
        f"{cells[0][:34]:34s} {cells[1]:2s} " + " ".join(f"{cell:>7s}" for cell in cells[3:-1])
        for cells in budget_rows(found)
    ]
    lines += ["", "Measured static compliance at the mechanical interface [um/N], x, y, z"]
    lines += ["  ".join(cells) for cells in compliance_rows(found)]
    lines += ["", "Left out", *(found.left_out or ["nothing"])]
    if found.statement.remarks:
        lines += ["", found.statement.remarks]
    return [part for line in lines for part in _wrapped(line)]


def _wrapped(line: str, width: int = 96) -> list[str]:
    return [line[at : at + width] for at in range(0, max(len(line), 1), width)]


def _text_page(lines: list[str]) -> Figure:
    figure = Figure(figsize=A4)
    figure.text(
        0.07, 0.95, "\n".join(lines), family="monospace", fontsize=7.5, va="top", parse_math=False
    )
    return figure


def single_figure(found: Certificate) -> Figure:
    """Stiffness at each configuration alone, with error bars, and the pooled interval.

    Args:
        found: all that the certificate shows.
    """
    n = found.robot.n
    figure = Figure(figsize=(8.27, 1.7 * n), layout="constrained")
    for j, axis in enumerate(figure.subplots(n, 1, squeeze=False)[:, 0]):
        value, low, high = found.singles[:, j].T
        known = np.isfinite(value)
        at = 1 + np.arange(value.size)[known]
        bars = np.clip(np.array([value - low, high - value])[:, known], 0.0, None)
        axis.errorbar(at, value[known], yerr=bars, fmt="o", color=POINT, markersize=3, capsize=2)
        pooled, part = found.result.stiffness[j], found.budget.expanded[j]
        if np.isfinite(pooled):
            axis.axhspan(pooled * (1 - part), pooled * (1 + part), color=LINE, alpha=0.25)
            axis.axhline(pooled, color=LINE, linewidth=1.0)
            axis.set_ylim(0.5 * pooled, 1.5 * pooled)
        unit = "N/m" if found.robot.slides[j] else "N m/rad"
        axis.set_ylabel(f"{found.robot.joint_names[j]}\n[{unit}]", fontsize=8)
    axis.set_xlabel("configuration")
    return figure


def residual_figure(found: Certificate) -> Figure:
    """Residuals by load, by configuration and by each joint's torque.

    Args:
        found: all that the certificate shows.
    """
    n = found.robot.n
    figure = Figure(figsize=(8.27, 9.0), layout="constrained")
    axes = figure.subplots(2 + (n + 1) // 2, 2).ravel()
    _scatter(axes[0], found.load + 1.0, found.residual, "load")
    _scatter(axes[1], found.configuration + 1.0, found.residual, "configuration")
    for j in range(n):
        name = f"torque of {found.robot.joint_names[j]} [N m]"
        _scatter(axes[2 + j], found.torque[:, j], found.residual, name)
    for axis in axes[2 + n :]:
        axis.set_visible(False)
    figure.suptitle("largest component of each sample's residual, in the stated noise", fontsize=10)
    return figure


def _scatter(axis: Axes, x: Any, y: Any, label: str) -> None:
    axis.plot(x, y, "o", color=POINT, markersize=2)
    axis.axhline(0.0, color="0.6", linewidth=0.6)
    for edge in (-2.0, 2.0):
        axis.axhline(edge, color="0.6", linewidth=0.6, linestyle="dashed")
    axis.set_xlabel(label, fontsize=8)
    axis.tick_params(labelsize=7)
