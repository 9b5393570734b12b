# SPDX-License-Identifier: Apache-2.0
"""Which suspects explain the moments that were gathered.

A suspect must leave no more than noise may, and not much more than the one that explains most. The
first alone would be weak: the noise that is believed is wider than a good rig's, so that much may
be left over hundreds of residuals before it is too much. The second is a test of likelihood ratios
(Neyman and Pearson 1933): if a suspect is right, another one leaves less by chance alone.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.stats import chi2

from cabols_control.checks import FloatArray

from .hypotheses import (
    Fault,
    Frame,
    Suspect,
    effect,
    suspects_of,
    tool_columns,
    tool_residual,
    unknowns,
)
from .noise import AgreementNoise, joint_covariance

DOUBTFUL = 1e-6
"""Probability below which a suspect does not explain what was gathered."""
LIKELIER = float(chi2.isf(DOUBTFUL, 7))
"""By so much may the sum of squares that a suspect leaves exceed the best one's. If the suspect is
right, that difference is at most what the best one's unknowns, six at most, take off by chance."""
PLUGS_STD_M = 1e-3
"""Of what two limbs differed by when their encoders' plugs were exchanged, standard deviation,
beside what they have moved since the last moment at which all agreed [m]."""
TOOL_STD = np.array([0.1] * 3 + [0.2] * 3)
"""Of a wrong tool, standard deviations [m], [rad]: what is larger is no tool's error."""
STEPS = 3
"""Of Gauss-Newton."""


class Explanations:
    """Holds suspects against moments."""

    def __init__(self, noise: AgreementNoise, stiffness: FloatArray, cables: Any) -> None:
        """Take what does not change.

        Args:
            noise: what counts as agreement.
            stiffness: (n,) k_e [N/m].
            cables: (n,) records of CABLE.
        """
        self._noise, self._stiffness, self._cables = noise, stiffness, cables
        self._suspects = suspects_of(len(stiffness))

    def fitting(self, zero: Frame, frames: list[Frame], before: int) -> list[Suspect]:
        """Suspects that explain the moments.

        Args:
            zero: when the limbs were zeroed.
            frames: the moments, oldest first.
            before: how many of them are from when all seemed to agree.
        """
        # All moments at once: what is wrong all the time is nearly the same in near ones.
        root = np.linalg.inv(np.linalg.cholesky(joint_covariance(self._noise, frames)))
        residual = np.concatenate([frame.residual for frame in frames])
        squares = {}
        for suspect in self._suspects:
            if suspect.fault is Fault.ROBOT_TOOL:
                square, freedom = self._fit_tool(zero, frames, root, residual)
            else:
                square = self._left(suspect, frames, before, root, residual)
                freedom = residual.size - unknowns(suspect)
            if square <= chi2.isf(DOUBTFUL, freedom):
                squares[suspect] = square
        best = min(squares.values(), default=0.0)
        return [suspect for suspect, square in squares.items() if square <= best + LIKELIER]

    def _fit_tool(
        self, zero: Frame, frames: list[Frame], root: FloatArray, residual: FloatArray
    ) -> tuple[float, int]:
        """Sum of squares that the best error of the tool leaves, and its degrees of freedom."""
        tool, square = np.zeros(6), np.inf
        given = (frames, zero, self._stiffness, self._cables)
        for _ in range(STEPS):
            seen = tool_residual(*given, tool)
            left = np.concatenate([root @ (residual - seen), -tool / TOOL_STD])
            square = min(square, float(left @ left))
            free = np.vstack([root @ tool_columns(*given, tool, seen), np.diag(1.0 / TOOL_STD)])
            tool = tool + np.linalg.lstsq(free, left, rcond=1e-12)[0]
        return square, 6 * len(frames)

    def _left(
        self,
        suspect: Suspect,
        frames: list[Frame],
        before: int,
        root: FloatArray,
        residual: FloatArray,
    ) -> float:
        """Sum of squares that a suspect among the limbs leaves.

        A cable that slips has not yet slipped in the moments before; encoders may have been
        exchanged since zeroing, or just now: all that they counted, or their plugs.
        """
        given = (suspect, frames, root, residual)
        if suspect.fault is Fault.SLIPPED_CABLE:
            return self._least(*given, before)
        ways = [self._least(*given, since) for since in {0, before}]
        if 0 < before < len(frames):
            i, j = suspect.limbs
            last, first = (frame.wound[i] - frame.wound[j] for frame in frames[before - 1 :][:2])
            still = abs(float(first - last)) + PLUGS_STD_M
            ways.append(self._least(*given, before, float(last), still))
        return min(ways)

    def _least(
        self,
        suspect: Suspect,
        frames: list[Frame],
        root: FloatArray,
        residual: FloatArray,
        since: int,
        start: float | None = None,
        still: float = np.inf,
    ) -> float:
        """Sum of squares that a suspect leaves, wrong from one moment on.

        Its unknown, if it has one, is found by Gauss-Newton; that of `start` has the standard
        deviation `still` [m].
        """
        nothing = np.zeros(6 * since)
        free = start is not None or suspect.fault is Fault.SLIPPED_CABLE
        unknown, least = 0.0, np.inf
        for _ in range(1 + STEPS * free):
            parts = [effect(suspect, f, self._stiffness, unknown, start) for f in frames[since:]]
            left = root @ (residual - np.concatenate([nothing, *(seen for seen, _ in parts)]))
            pull = unknown / still
            least = min(least, float(left @ left) + pull**2)
            column = root @ np.concatenate([nothing, *(column for _, column in parts)])
            scale = float(column @ column) + 1.0 / still**2
            if not (free and scale > 0.0):
                break
            unknown += (float(column @ left) - pull / still) / scale
        return least
