# SPDX-License-Identifier: Apache-2.0
"""Node: estimate of the stiffness after every load of a campaign."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from cabols_msgs.msg import CampaignStatus, StiffnessEstimate, StiffnessLoad
from rclpy.serialization import serialize_message

from cabols_control.errors import CabolsError
from cabols_control.ros.messages.qos import topic_qos
from cabols_control.ros.node import RUNNING, ControlNode, run_node
from cabols_control.supervision.faults import Fault, FaultName
from cabols_stiffness.campaign.journal import PLAN, read_samples
from cabols_stiffness.campaign.plan import load_plan
from cabols_stiffness.identification.running import RunningIdentification
from cabols_stiffness.ros.report_service import ReportService

REPORT_S = 0.5


class StiffnessIdentifierNode(ControlNode):
    """Reads each load from the campaign's folder, where it is stored before it is published.

    So no load is lost if this node or the campaign is killed, and every estimate uses exactly the
    numbers that an analysis of the folder uses.
    """

    def __init__(self) -> None:
        """Subscribe to stiffness_load and campaign_status; advertise stiffness_estimate."""
        super().__init__("stiffness_identifier")
        self._output = self.advertise("stiffness_estimate")
        self._folder = ""
        self._accuracy = 0.0
        self._skipped = 0
        self._identification: RunningIdentification | None = None
        self._trouble: Fault | None = None
        self._last_folder = ""
        self._campaign_runs = False
        self._reports = ReportService(self, lambda: self._last_folder, lambda: self._campaign_runs)
        for msg_type, topic, hear in (
            (CampaignStatus, "campaign_status", self._hear_status),
            (StiffnessLoad, "stiffness_load", self._hear_load),
        ):
            self.create_subscription(msg_type, topic, hear, topic_qos(topic))
        self.create_timer(REPORT_S, lambda: self.status.cycle(0, RUNNING, self._trouble))

    def _hear_status(self, message: CampaignStatus) -> None:
        self._accuracy, self._skipped = message.accuracy, message.skipped
        self._campaign_runs = bool(message.active)
        self._last_folder = message.folder
        if not message.active or message.folder == self._folder:
            return
        try:
            plan = load_plan(Path(message.folder, PLAN))
            self._identification = RunningIdentification(plan)
            self._folder, self._trouble = message.folder, None
        except CabolsError as error:
            self._complain(error)

    def end(self) -> None:
        """End a running analysis."""
        self._reports.close()

    def _hear_load(self, message: StiffnessLoad) -> None:
        identification = self._identification
        if identification is None or not message.success:
            return
        try:
            identification.add(read_samples(self._folder, identification.count))
            self._trouble = None
        except (CabolsError, OSError) as error:
            self._complain(error)
            return
        self._output.publish(serialize_message(self._estimate(message)))

    def _complain(self, error: Exception) -> None:
        self._trouble = Fault(FaultName.IDENTIFICATION, str(error))
        self.get_logger().error(str(error))

    def _estimate(self, load: StiffnessLoad) -> StiffnessEstimate:
        identification, nan = self._identification, np.full(6, np.nan)
        message = StiffnessEstimate(
            header=load.header,
            model=identification.model,
            loads=identification.count,
            skipped=self._skipped,
            stiffness=nan,
            standard_deviation=nan,
            cubic=nan,
            cubic_deviation=nan,
            relative_deviation_max=float("inf"),
            residual_rms=float("nan"),
        )
        result = identification.result
        if result is None:
            return message
        message.stiffness, message.standard_deviation = result.stiffness, result.standard_deviation
        if result.cubic is not None:
            message.cubic, message.cubic_deviation = result.cubic, result.cubic_deviation
        message.identifiable = [bool(known) for known in result.identifiable]
        message.residual_rms = result.residual_rms
        message.relative_deviation_max = result.relative_deviation_max
        message.accurate = (
            self._accuracy > 0.0
            and bool(result.identifiable.all())
            and result.relative_deviation_max <= self._accuracy
        )
        return message


def main() -> int:
    """Entry point."""
    return run_node(StiffnessIdentifierNode)


if __name__ == "__main__":
    sys.exit(main())
