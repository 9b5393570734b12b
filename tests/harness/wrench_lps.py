# SPDX-License-Identifier: Apache-2.0
"""Wrench feasibility by linear programmes: HiGHS asks for tensions at every vertex of the set.

An independent second opinion on the hyperplane test, and its opponent in the benchmark: one model
per solver object, reused; between the vertices of a pose only the right-hand side changes, in an
order that changes little (Gray code), so that the dual simplex starts from the last basis.
"""

from __future__ import annotations

import highspy
import numpy as np

from cabols_control.cable_kernels import structure_matrix_unchecked


def box_vertices(half_widths):
    """(64, 6) vertices of a box, each differing from the last in one component."""
    gray = [k ^ (k >> 1) for k in range(64)]
    signs = np.array([[1.0 if g >> b & 1 else -1.0 for b in range(6)] for g in gray])
    return signs * np.asarray(half_widths)


class VertexPrograms:
    """Whether A t = w has a solution within the limits, for every vertex w of a set."""

    def __init__(self, cables, low, high):
        self.solver = highspy.Highs()
        for name, value in (("output_flag", False), ("presolve", "off"), ("threads", 1)):
            self.solver.setOptionValue(name, value)
        for name in ("primal_feasibility_tolerance", "dual_feasibility_tolerance"):
            self.solver.setOptionValue(name, 1e-9)
        self.rows = np.arange(6, dtype=np.int32)
        lp = self.lp = highspy.HighsLp()
        lp.num_col_, lp.num_row_ = cables, 6
        lp.col_cost_ = np.zeros(cables)
        lp.col_lower_, lp.col_upper_ = np.full(cables, low), np.full(cables, high)
        lp.a_matrix_.format_ = highspy.MatrixFormat.kRowwise
        lp.a_matrix_.start_ = np.arange(7, dtype=np.int32) * cables
        lp.a_matrix_.index_ = np.tile(np.arange(cables, dtype=np.int32), 6)
        self.solved = 0

    def feasible(self, matrix, vertices):
        """Stop at the first vertex that has none."""
        self.lp.row_lower_ = self.lp.row_upper_ = vertices[0]
        self.lp.a_matrix_.value_ = np.ascontiguousarray(matrix).ravel()
        self.solver.passModel(self.lp)
        for k, wrench in enumerate(vertices):
            if k:
                self.solver.changeRowsBounds(6, self.rows, wrench, wrench)
            self.solver.run()
            self.solved += 1
            status = self.solver.getModelStatus()
            if status == highspy.HighsModelStatus.kInfeasible:
                return False
            assert status == highspy.HighsModelStatus.kOptimal, status
        return True


def feasible_poses(geometry, positions, rotations, vertices, low, high):
    """(k,) answers, and the number of linear programmes solved."""
    programs = VertexPrograms(geometry.cables, low, high)
    cables = geometry.records()
    answers = [
        programs.feasible(structure_matrix_unchecked(cables, p, r), vertices)
        for p, r in zip(positions, rotations, strict=True)
    ]
    return np.array(answers), programs.solved
