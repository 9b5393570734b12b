# SPDX-License-Identifier: Apache-2.0
"""How strongly a fault shows in the pose estimator's data, by its true effect and believed noise.

The sum of squares that the true effect alone leaves, in the deviations that noise allows, is what a
test of that noise sees on average. Where it stays below the test's threshold, no test of this level
on these data tells the fault from noise: a cable that pulled next to nothing lost next to nothing,
and a turn about a wrong tool's own offset hardly shows.
"""

from __future__ import annotations

import numpy as np

from cabols_control.pose_agreement.hypotheses import tool_residual
from cabols_control.pose_agreement.monitor import ODD_WRENCH


class FaultStrength:
    """Follows a fault.

    Attributes:
        squares: the largest sum of squares so far.
        lost: of a slipped cable, the largest pull that is missing so far [N].
        moved: of a wrong tool, how far it has moved the platform since zeroing, at most [m].
    """

    def __init__(self, rig, limb=None, tool=None):
        """Begin at the fault: what the estimator has kept so far is from before it.

        Args:
            rig: an AgreementRig.
            limb: of the cable that slips, from 0; None: it is the tool.
            tool: (6,) error of the tool; None: a cable slips.
        """
        self._rig, self._limb, self._tool = rig, limb, tool
        self._monitor = rig.node._estimator._monitor
        self._before = {id(frame) for frame in self._monitor._baseline.frames}
        self._lost = {}
        self._frame = None
        self._hold = []
        self.squares = self.lost = self.moved = 0.0

    @property
    def tells(self):
        """Whether the fault has shown beyond the threshold."""
        return self.squares > ODD_WRENCH

    def look(self):
        """Take the estimator's newest moment, if there is one."""
        monitor = self._monitor
        frame = monitor._newest
        if frame is None or frame is self._frame:
            return
        self._frame = frame
        self._hold.append(frame)  # so that no other gets its identity
        if self._limb is not None:
            shown = max(float(frame.tension[self._limb]), 0.0)
            self._lost[id(frame)] = shown - float(self._rig.rig.plant.tension[self._limb])
            self.lost = max(self.lost, self._lost[id(frame)])
        else:
            turn = frame.rotation - monitor._zero.rotation
            self.moved = max(self.moved, float(np.linalg.norm(turn @ self._tool[:3])))
        effect = self._effect(frame)
        absolute = effect @ np.linalg.solve(frame.covariance, effect)
        baseline = monitor._baseline
        _, covariance = baseline.change(frame)
        if baseline.frames:
            shared = np.hstack([monitor.noise.shared(frame, one) for one in baseline.frames])
            known = np.concatenate([self._effect(one) for one in baseline.frames])
            effect = effect - shared @ baseline._inverse @ known
        change = effect @ np.linalg.solve(covariance, effect)
        self.squares = max(self.squares, float(absolute), float(change))

    def _effect(self, frame):
        """(6,) residual that the fault leaves at a moment."""
        monitor = self._monitor
        if self._limb is None:
            given = (monitor._zero, monitor.stiffness, monitor._cables)
            return tool_residual([frame], *given, self._tool)
        lost = 0.0 if id(frame) in self._before else self._lost.get(id(frame), 0.0)
        return -frame.matrix[:, self._limb] * lost
