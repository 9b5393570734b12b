# SPDX-License-Identifier: Apache-2.0
"""Node: runs stiffness campaigns; action run_stiffness_test, services to pause, resume, abort."""

from __future__ import annotations

import sys
import threading
from datetime import datetime, timezone
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from cabols_msgs.action import RunStiffnessTest
from cabols_msgs.msg import CampaignStatus, StiffnessEstimate
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.serialization import serialize_message
from std_srvs.srv import Trigger

from cabols_control.bags.metadata import FILE_NAME as METADATA
from cabols_control.bags.recover import recover
from cabols_control.errors import CabolsError
from cabols_control.kinematics import structure_matrix
from cabols_control.result_code import ResultCode
from cabols_control.ros.messages.qos import topic_qos
from cabols_control.ros.node import RUNNING, WAITING, ControlNode, run_node
from cabols_control.ros.parameters import declare_row
from cabols_control.ros.threads.pause import pause
from cabols_control.rotations import read_pose
from cabols_control.stamps import set_time
from cabols_control.supervision.modes import OperatingMode
from cabols_stiffness.analysis.bag import read_loads
from cabols_stiffness.bringup_nodes import NODES as STIFFNESS_NODES
from cabols_stiffness.campaign.journal import PLAN, Journal
from cabols_stiffness.errors import CampaignError
from cabols_stiffness.ros.campaign_run import CampaignRun
from cabols_stiffness.ros.intake import CampaignBag, Intake
from cabols_stiffness.ros.leader import TensionLeader
from cabols_stiffness.ros.operator import Operator

FEEDBACK_S = 0.2
STATUS_EVERY = 5
END_S = 8.0
"""Longest time for the rig to come to rest when the node ends [s]."""


class StiffnessCampaignNode(ControlNode):
    """Runs one campaign at a time; all lasting data are in its folder."""

    def __init__(self) -> None:
        """Advertise the action, the services and the tension setpoints."""
        super().__init__("stiffness_campaign")
        self._folder = declare_row(self, STIFFNESS_NODES.argument("campaign_folder"))
        self._file = declare_row(self, STIFFNESS_NODES.argument("campaign_file"))
        self._leader = TensionLeader(self)
        self._loads = self.advertise("stiffness_load")
        self._status_output = self.advertise("campaign_status")
        self._estimate: StiffnessEstimate | None = None
        self._intake = Intake(self)
        self._intake.on_look = self._lead
        self.create_subscription(
            StiffnessEstimate, "stiffness_estimate", self._hear, topic_qos("stiffness_estimate")
        )
        self._operator = Operator(self, self._intake)
        self._run: CampaignRun | None = None
        self._thread: threading.Thread | None = None
        self._busy = threading.Lock()
        self._last = CampaignStatus(phase="waiting", remaining=float("nan"))
        self._accuracy = 0.0
        self._shown_folder = ""
        self._turns = 0
        self._refusal = ""
        # Compile or load the kernels that judge a load, for writable arrays as a pose has them.
        geometry = self.rig.geometry
        structure_matrix(geometry, np.array(geometry.reference_position), np.eye(3))
        read_pose(np.array([*geometry.reference_position, 0.0, 0.0, 0.0, 1.0]))
        for name, callback in (
            ("pause_stiffness_test", self._pause),
            ("resume_stiffness_test", self._resume),
            ("abort_stiffness_test", self._abort),
        ):
            self.create_service(Trigger, name, callback)
        self._server = ActionServer(
            self,
            RunStiffnessTest,
            "run_stiffness_test",
            self._execute,
            goal_callback=self._judge,
            cancel_callback=self._cancel,
            callback_group=ReentrantCallbackGroup(),
        )

    def begin(self) -> None:
        """Start the intake."""
        super().begin()
        self._intake.start()
        self._tell_status()

    def end(self) -> None:
        """Abort a campaign, let the rig come to rest, close its files."""
        run, thread = self._run, self._thread
        if run is not None:
            run.abort("the node ends")
        if thread is not None:
            thread.join(END_S)
        self._intake.stop()
        self._server.destroy()
        self._operator.close()

    @property
    def failure(self) -> BaseException | None:
        """Return the error that ended the intake."""
        return self._intake.failure

    def _lead(self) -> None:
        self._leader.step(self._intake.now_ns)
        state = RUNNING if self._intake.mode is not None and self._intake.now_ns >= 0 else WAITING
        self.status.cycle(max(self._intake.now_ns, 0), state)

    def _hear(self, message: StiffnessEstimate) -> None:
        self._estimate = message
        bag = self._intake.bag
        if bag is not None:
            bag.add("stiffness_estimate", serialize_message(message), self._now_ns())

    def _now_ns(self) -> int:
        return int(self.get_clock().now().nanoseconds)

    def _judge(self, request: Any) -> GoalResponse:
        refusal = ""
        if self._busy.locked():
            refusal = "a campaign is running"
        elif self._intake.mode != OperatingMode.STOPPED:
            name = "unknown" if self._intake.mode is None else self._intake.mode.name
            refusal = f"the mode is {name}, expected STOPPED"
        elif self._intake.now_ns < 0:
            refusal = "no wrench has arrived yet: is the bridge running?"
        elif not 0.0 <= request.accuracy < 1.0:
            refusal = f"accuracy: expected 0 to 1, got {request.accuracy}"
        if refusal and refusal != self._refusal:
            self.get_logger().info(f"run_stiffness_test refused: {refusal}")
        self._refusal = refusal
        return GoalResponse.REJECT if refusal else GoalResponse.ACCEPT

    def _cancel(self, _: Any) -> CancelResponse:
        run = self._run
        if run is not None:
            run.abort("cancelled")
        return CancelResponse.ACCEPT

    async def _execute(self, handle: Any) -> Any:
        if not self._busy.acquire(blocking=False):
            handle.abort()
            code = int(ResultCode.BUSY)
            return RunStiffnessTest.Result(message="a campaign is running", code=code)
        try:
            return await self._campaign(handle)
        except (CabolsError, OSError) as error:
            self.get_logger().error(str(error))
            self._last.phase, self._last.code = f"failed: {error}", int(ResultCode.FAILED)
            handle.abort()
            return RunStiffnessTest.Result(
                message=str(error), folder=self._shown_folder, code=self._last.code
            )
        finally:
            self._run = None
            self._tell_status()
            self._busy.release()

    async def _campaign(self, handle: Any) -> Any:
        request = handle.request
        now = datetime.now(timezone.utc).astimezone()
        folder = request.folder or self._folder or f"campaigns/{now:%Y-%m-%d_%H-%M-%S}"
        self._shown_folder = str(Path(folder).resolve())
        given = request.campaign or self._file
        own = Path(folder, PLAN).exists() and not request.campaign
        journal = Journal(folder, "" if own else given, self.rig_folder)
        try:
            self._check_limbs(journal.plan.limbs)
            saved = self._reconcile(journal)
            if saved:
                self.get_logger().info(f"{saved} loads were in the bag of a cut run only")
            self._accuracy = request.accuracy or journal.plan.accuracy
            self._estimate = None
            bag = CampaignBag(journal.new_bag(), self._metadata(journal))
            self._intake.bag = bag
            try:
                run = self._start(journal)
                await self._follow(handle, run)
            finally:
                self._intake.bag = None
                bag.close()
            return self._finish(handle, run)
        finally:
            journal.close()

    def _check_limbs(self, limbs: int) -> None:
        cables = self.rig.geometry.cables
        if limbs != cables:
            raise CampaignError(
                f"peak: expected {cables} tensions as the rig has cables, got {limbs}; write "
                f"{PLAN} for this rig"
            )

    def _reconcile(self, journal: Journal) -> int:
        """Complete the bags of interrupted runs; adopt loads that only their bags hold."""
        saved = 0
        for bag in journal.bags():
            if any(bag.glob("*.mcap")) and not (bag / METADATA).exists() and recover(bag).changed:
                saved += journal.adopt(read_loads(bag, journal.plan).loads)
        return saved

    def _metadata(self, journal: Journal) -> dict[str, str]:
        text = (journal.folder / PLAN).read_text(encoding="utf-8")
        metadata = {"campaign_yaml": text, "cabols_stiffness": version("cabols_stiffness")}
        urdf = journal.plan.rig.urdf
        if urdf:
            metadata["urdf"] = Path(urdf).read_text(encoding="utf-8")
        return metadata

    def _start(self, journal: Journal) -> CampaignRun:
        self._operator.forget_abort()
        run = CampaignRun(
            self,
            self._intake,
            self._operator,
            self._leader,
            journal,
            lambda message: self._loads.publish(serialize_message(message)),
            self._accurate,
        )
        self.get_logger().info(
            f"campaign {journal.folder}: {run.standing.done} of {run.standing.total} loads done"
        )
        # The identifier must know the folder before the first load is published.
        self._run = run
        self._tell_status()
        self._thread = threading.Thread(target=run.run, name="campaign", daemon=True)
        self._thread.start()
        return run

    def _accurate(self) -> bool:
        """Whether the newest estimate has the requested accuracy."""
        estimate = self._estimate
        return (
            self._accuracy > 0.0
            and estimate is not None
            and bool(np.all(estimate.identifiable))
            and estimate.relative_deviation_max <= self._accuracy
        )

    async def _follow(self, handle: Any, run: CampaignRun) -> None:
        thread = self._thread
        while thread.is_alive():
            if handle.is_cancel_requested and not run.aborted:
                run.abort("cancelled")
            standing = run.standing
            handle.publish_feedback(
                RunStiffnessTest.Feedback(
                    phase=standing.phase,
                    configuration=standing.key.configuration,
                    reflector=standing.key.reflector,
                    load=standing.key.load,
                    done=standing.done,
                    total=standing.total,
                    remaining=standing.remaining_s,
                    note=standing.note,
                )
            )
            self._turns += 1
            if self._turns % STATUS_EVERY == 0:
                self._tell_status()
            await pause(self, FEEDBACK_S)

    def _finish(self, handle: Any, run: CampaignRun) -> Any:
        standing = run.standing
        message = run.reason or ("done" if run.code == ResultCode.DONE else "ended by an error")
        if run.code != ResultCode.DONE:
            message += f"; {standing.done} loads are kept, run it again with the same folder"
        self._last.phase, self._last.code = run.reason or "done", int(run.code)
        done = run.code == ResultCode.DONE
        result = RunStiffnessTest.Result(
            success=done,
            code=int(run.code),
            message=message,
            folder=self._shown_folder,
            loads=standing.done,
            skipped=standing.skipped,
        )
        if self._estimate is not None:
            result.estimate = self._estimate
        if done:
            handle.succeed()
        elif handle.is_cancel_requested:
            handle.canceled()
        else:
            handle.abort()
        self.get_logger().info(message)
        return result

    def _tell_status(self) -> None:
        run, message = self._run, self._last
        message.active = run is not None
        message.paused = run is not None and run.paused
        if run is not None:
            message.code = int(ResultCode.UNKNOWN)
        message.folder, message.accuracy = self._shown_folder, self._accuracy
        set_time(message.header.stamp, max(self._intake.now_ns, 0))
        if run is not None:
            standing = run.standing
            message.phase, message.note = standing.phase, standing.note
            message.configuration, message.reflector, message.load = standing.key
            message.done, message.skipped = standing.done, standing.skipped
            message.total, message.remaining = standing.total, standing.remaining_s
        self._status_output.publish(serialize_message(message))

    def _pause(self, request: Any, response: Any) -> Any:
        del request
        return self._order(response, "it rests after the present load", lambda run: run.pause())

    def _resume(self, request: Any, response: Any) -> Any:
        del request
        return self._order(response, "it goes on", lambda run: run.resume())

    def _abort(self, request: Any, response: Any) -> Any:
        del request
        return self._order(response, "it unloads and ends", lambda run: run.abort("aborted"))

    def _order(self, response: Any, said: str, act: Any) -> Any:
        run = self._run
        response.success = run is not None
        response.message = said if run is not None else "no campaign is running"
        if run is not None:
            act(run)
        return response


def main() -> int:
    """Entry point."""
    return run_node(StiffnessCampaignNode)


if __name__ == "__main__":
    sys.exit(main())
