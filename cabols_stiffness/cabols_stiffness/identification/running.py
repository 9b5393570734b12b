# SPDX-License-Identifier: Apache-2.0
"""The estimate from all loads so far, as a campaign grows."""

from __future__ import annotations

from collections.abc import Sequence

from cabols_stiffness.campaign.plan import CampaignPlan
from cabols_stiffness.identification.gauss_newton import IdentificationError
from cabols_stiffness.identification.iterate import identify_loads
from cabols_stiffness.measurements.measured_load import MeasuredLoad
from cabols_stiffness.measurements.reflector_points import robot_of
from cabols_stiffness.model.result import StiffnessResult


class RunningIdentification:
    """Identifies again from all loads after every load, starting from the estimate before.

    The tracker's frame, too, becomes better known with every configuration, so that even old
    samples change a little: the newest estimate is that of an analysis of all loads at once.

    Attributes:
        model: linear, cubic or as_published.
        count: loads so far, references and those of validation included.
        result: newest; None before there is enough.
        reason: why there is none yet.
    """

    def __init__(self, plan: CampaignPlan) -> None:
        """Begin without loads.

        Raises:
            ConfigError: if the robot's URDF cannot be used.
        """
        self._plan = plan
        self._robot = robot_of(plan.rig)
        self._loads: list[MeasuredLoad] = []
        self.model = plan.model
        self.count = 0
        self.result: StiffnessResult | None = None
        self.reason = "no loads yet"

    def add(self, loads: Sequence[MeasuredLoad]) -> StiffnessResult | None:
        """Take more loads; return the newest result, None while there are too few."""
        self.count += len(loads)
        mine = [load for load in loads if not self._plan.is_validation(load.configuration)]
        self._loads += mine
        if mine:
            rig = self._plan.rig
            try:
                found = identify_loads(self._loads, rig, self._robot, self.model, self.result)
                self.result, self.reason = found.result, ""
            except IdentificationError as error:
                self.reason = str(error)
        return self.result
