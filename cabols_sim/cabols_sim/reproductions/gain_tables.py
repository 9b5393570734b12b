# SPDX-License-Identifier: Apache-2.0
"""Tables 3.2 and 4.2: gains of both loops from table 3.1 by (3.24), (3.25)."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from cabols_control.checks import FloatArray
from cabols_control.naming import limb_name, number
from cabols_control.run_report.pictures.run_figures import new_figure, tidy
from cabols_control.run_report.section import ReportSection
from cabols_sim.reproductions.common import bench

PRINTED_K_I = {
    "table 3.2": (4.3871, 1.0212, 3.2639, 2.8484, 2.9423, 2.7339, 1.0011, 3.6667),
    "table 4.2": (4.3871, 1.2622, 3.2639, 2.8485, 2.9423, 2.7339, 1.0011, 3.6667),
}
"""k_I as printed [A/mm]."""
PRINTED_K_P1 = {
    "table 3.2": (0.0740, 0.0213, 0.0551, 0.0483, 0.0498, 0.0463, 0.0168, 0.0620),
    "table 4.2": (0.0740, 0.0213, 0.0551, 0.0484, 0.0498, 0.0463, 0.0168, 0.0620),
}
"""k_P1 as printed [A s/mm]."""
PRINTED_K_P2 = 9.0177
"""k_P2 of table 3.2, all limbs [mm/s/N]."""
PRINTED_K_IO, PRINTED_K_PO = 360.0 / 49.0, 9.0 / 49.0
ROUNDING = 0.6e-4
"""Half of the last printed digit, and a little for the rounding of table 3.1."""


def reproduce_gains() -> ReportSection:
    """Compute both tables of gains and mark what the source misprints."""
    gains = bench().rig.gains
    k_i = np.array([g.integral for g in gains.limbs]) * 1e-3
    k_p1 = np.array([g.velocity for g in gains.limbs]) * 1e-3
    k_p2 = np.array([g.tension for g in gains.limbs]) * 1e3
    rows, errata = _compare(k_i, k_p1)
    implied = PRINTED_K_P2**-1 * k_p2[0] * float(bench().rig.springs.nominal[0]) * 1e-3
    errata.append(
        f"k_P2: printed {PRINTED_K_P2}, computed {k_p2[0]:.4f}; printed belongs to "
        f"k_e = {implied:.2f} N/mm"
    )
    numbers = {
        "k_i_a_per_mm": k_i.tolist(),
        "k_p1_as_per_mm": k_p1.tolist(),
        "k_p2_mm_per_s_n": float(k_p2[0]),
        "k_p2_printed_mm_per_s_n": PRINTED_K_P2,
        "k_e_implied_by_printed_k_p2_n_per_mm": float(implied),
        "k_io_per_s": gains.integral,
        "k_po": gains.proportional,
        "k_io_printed_per_s": PRINTED_K_IO,
        "k_po_printed": PRINTED_K_PO,
        "errata": errata,
    }
    text = (
        "Gains by (3.24), (3.25) from k and T of table 3.1, poles -10, -90, -40, -40 and zero -40 "
        f"1/s, k_e = 2.20 N/mm. Outer loop: k_Io = {gains.integral:.4f} 1/s (printed 360/49), k_Po "
        f"= {gains.proportional:.4f} (printed 9/49). All agree to the printed digits except: "
        + "; ".join(errata)
        + "."
    )
    header = (
        "limb",
        "k_I [A/mm]",
        "table 3.2",
        "table 4.2",
        "k_P1 [A s/mm]",
        "table 3.2",
        "table 4.2",
        "k_P2 [mm/s/N]",
        "table 3.2",
    )
    table = tuple((*row, f"{k_p2[0]:.4f}", f"{PRINTED_K_P2} *") for row in rows)
    return ReportSection(
        "gains",
        "Tables 3.2 and 4.2: gains of inner and outer loop",
        text,
        numbers,
        header,
        table,
        _draw(k_i, k_p1),
        {"k_i": k_i, "k_p1": k_p1, "k_p2": k_p2},
    )


def _compare(k_i: FloatArray, k_p1: FloatArray) -> tuple[list[tuple[str, ...]], list[str]]:
    """Rows of the table, misprints marked with a star, and the misprints in words."""
    rows, errata = [], []
    for limb in range(k_i.size):
        row = [str(number(limb))]
        for name, value, printed in (
            ("k_I", k_i[limb], PRINTED_K_I),
            ("k_P1", k_p1[limb], PRINTED_K_P1),
        ):
            row.append(f"{value:.4f}")
            for table, columns in printed.items():
                wrong = not abs(value - columns[limb]) <= ROUNDING
                row.append(f"{columns[limb]:.4f}" + " *" * wrong)
                if wrong:
                    errata.append(
                        f"{limb_name(limb)}: {name} computed {value:.4f}, "
                        f"{table} prints {columns[limb]:.4f}"
                    )
        rows.append(tuple(row))
    return rows, errata


def _draw(k_i: FloatArray, k_p1: FloatArray) -> Figure:
    figure = new_figure(10.0, 3.6)
    left, right = figure.subplots(1, 2)
    limbs = np.arange(1, k_i.size + 1)
    for axes, value, printed, label in (
        (left, k_i, PRINTED_K_I, "$k_I$ [A/mm]"),
        (right, k_p1, PRINTED_K_P1, "$k_{P1}$ [A s/mm]"),
    ):
        axes.bar(limbs, value, width=0.55, color="#9ecae1", label="computed by (3.24)")
        markers = (("x", "#b2182b"), ("+", "#222222"))
        for (table, columns), (marker, colour) in zip(printed.items(), markers, strict=True):
            axes.plot(
                limbs, columns, marker, color=colour, ms=10, mew=1.8, label=f"{table}, printed"
            )
        tidy(axes, label, "limb")
    left.text(2, 0.72, "misprint", color="#b2182b", ha="center", va="top", fontsize=9)
    left.legend(fontsize=9)
    return figure
