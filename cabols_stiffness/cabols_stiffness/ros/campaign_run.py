# SPDX-License-Identifier: Apache-2.0
"""One run of a campaign: carries out the flow's requests on the real graph."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from cabols_msgs.msg import StiffnessLoad
from rclpy.serialization import serialize_message

from cabols_control.checks import FloatArray
from cabols_control.kinematics import structure_matrix
from cabols_control.naming import configuration_name, limb_names, place_name, reflector_name
from cabols_control.result_code import ResultCode
from cabols_control.ros.node import ControlNode
from cabols_control.rotations import read_pose
from cabols_control.stamps import set_time, time_ns
from cabols_control.supervision.modes import OperatingMode
from cabols_stiffness.campaign.flow import Flow
from cabols_stiffness.campaign.journal import Journal
from cabols_stiffness.campaign.requests import (
    Apply,
    BeginLoading,
    Finish,
    LoadKey,
    Measure,
    Move,
    Pretighten,
    Reply,
    Request,
    Rest,
    Tell,
)
from cabols_stiffness.errors import CampaignError
from cabols_stiffness.measurements.measured_load import MeasuredLoad
from cabols_stiffness.measurements.samples import REFERENCE
from cabols_stiffness.measurements.window import average, stands
from cabols_stiffness.ros.intake import Intake
from cabols_stiffness.ros.leader import TensionLeader
from cabols_stiffness.ros.operator import InterruptedCampaignError, Operator

CALM_S = 0.5
"""Pause before any motion, for the sensor's tare, in the rig's time [s]."""
MODE_S = 10.0
"""Longest change of mode, in the rig's time [s]."""
BEHIND_S = 2.0
"""Longest wait for the last samples of a window, in the rig's time [s]."""
PAUSE_S = 1e9


NOWHERE = LoadKey(0, 0, 0)


@dataclass
class Standing:
    """Progress of a run, for feedback and status."""

    phase: str = "starting"
    key: LoadKey = NOWHERE
    done: int = 0
    total: int = 0
    skipped: int = 0
    remaining_s: float = float("nan")
    note: str = ""


class CampaignRun:
    """Drives a Flow to its end.

    Attributes:
        standing: its progress.
        reason: why it did not come to its end, for people; empty if it did.
        code: how it ended; UNKNOWN while it runs.
        aborted: whether an abort was requested.
    """

    def __init__(
        self,
        node: ControlNode,
        intake: Intake,
        operator: Operator,
        leader: TensionLeader,
        journal: Journal,
        publish: Callable[[StiffnessLoad], None],
        accurate: Callable[[], bool],
    ) -> None:
        """Plan the rest of the journal's campaign."""
        self._node = node
        self._intake = intake
        self._operator = operator
        self._leader = leader
        self._journal = journal
        self._plan = journal.plan
        self._publish = publish
        self._accurate = accurate
        rest = float(leader.rest[0])
        self._flow = Flow(self._plan, rest, journal.finished)
        self._group = journal.next_group - 1
        self._pass: tuple[int, int] | None = None
        self._resume = threading.Event()
        self._resume.set()
        self._began = time.monotonic()
        self._fresh = 0
        total = self._plan.total(rest)
        self.standing = Standing(done=len(journal.finished), total=total)
        self.reason = ""
        self.code = ResultCode.UNKNOWN
        self.aborted = False

    def pause(self) -> None:
        """Rest after the present load."""
        self._resume.clear()

    def resume(self) -> None:
        """Go on."""
        self._resume.set()

    @property
    def paused(self) -> bool:
        """Whether a pause is requested."""
        return not self._resume.is_set()

    def abort(self, reason: str) -> None:
        """Unload and end, now."""
        self.aborted = True
        self._operator.abort(reason)

    def run(self) -> None:
        """Carry out every step; whatever happens, unload in the end."""
        steps = self._flow.steps()
        try:
            self._operator.pause(CALM_S)
            request = next(steps)
            while True:
                request = steps.send(self._carry_out(request))
        except StopIteration:
            self.standing.phase = "done"
            self.code = ResultCode.DONE
        except InterruptedCampaignError as error:
            self.reason = str(error)
            self.code = ResultCode.CANCELLED if self.aborted else ResultCode.INTERRUPTED
        except (CampaignError, OSError) as error:
            self.reason, self.code = str(error), ResultCode.FAILED
        finally:
            steps.close()
            self._leave()

    def _leave(self) -> None:
        """Bring the rig to rest, if it still answers."""
        self._leader.silence()
        self._operator.forget_abort()
        if self._intake.mode in (OperatingMode.FAULT, OperatingMode.STOPPED, None):
            return
        try:
            if self._node.context.ok():
                self._operator.enter(OperatingMode.STOPPED, MODE_S)
        except InterruptedCampaignError as error:
            if self.code == ResultCode.DONE:
                self.reason, self.code = str(error), ResultCode.INTERRUPTED

    def _carry_out(self, request: Request) -> Reply:
        if isinstance(request, Move):
            reply = self._move(request)
        elif isinstance(request, Pretighten):
            reply = self._pretighten()
        elif isinstance(request, BeginLoading):
            reply = self._begin_loading()
        elif isinstance(request, Apply):
            reply = self._apply(request)
        elif isinstance(request, Measure):
            reply = self._measure(request)
        elif isinstance(request, Tell):
            reply = self._tell(request)
        elif isinstance(request, Rest):
            reply = self._rest()
        else:
            assert isinstance(request, Finish)
            self.standing.phase = "unloading"
            reply = Reply(self._operator.enter(OperatingMode.STOPPED, MODE_S))
        return Reply(reply.reason, self.paused, reply.enough, reply.hopeless)

    def _move(self, request: Move) -> Reply:
        standing = self.standing
        standing.phase, standing.key = "moving", LoadKey(request.configuration, 0, 0)
        reason = ""
        if not self._intake.zeroed.all():
            # With zeros the cables follow the robot at a tension, not by their switches alone.
            reason = self._pretighten().reason
        reason = reason or self._operator.enter(OperatingMode.FREE_MOVING, MODE_S)
        reason = reason or self._operator.move(request.configuration, self._plan.move_timeout)
        where = configuration_name(request.configuration)
        return Reply(f"robot to {where}: {reason}" if reason else "")

    def _pretighten(self) -> Reply:
        self.standing.phase = "pre-tightening"
        seconds = self._plan.pretighten_timeout
        reason = self._operator.enter(OperatingMode.PRETIGHTENING, MODE_S)
        if reason:
            return Reply(reason)
        if not self._operator.until(lambda: bool(self._intake.tight.all()), seconds):
            limbs = limb_names(np.flatnonzero(~self._intake.tight))
            return Reply(f"{limbs} did not find their zero within {seconds:g} s")
        return Reply()

    def _begin_loading(self) -> Reply:
        self._pass = None
        self._leader.lead(self._plan.tension_rate)
        return Reply(self._operator.enter(OperatingMode.LOADING, MODE_S))

    def _apply(self, request: Apply) -> Reply:
        standing, point = self.standing, request.point
        standing.key = request.key
        standing.phase = "reference" if point.branch == REFERENCE else "loading"
        refusal = self._beyond(point.tension)
        if refusal:
            return Reply(refusal, hopeless=True)
        self._leader.go(point.tension)
        settling = self._plan.settling
        reach = float(np.abs(point.tension).max()) / self._plan.tension_rate + BEHIND_S
        if not self._operator.until(lambda: self._leader.arrived, reach, loading=True):
            return Reply(f"the tensions were not led to their goal within {reach:.1f} s")
        standing.phase = "settling"
        window_ns = round(1e9 * settling.window)
        earliest_ns = self._intake.now_ns + 2 * window_ns

        def settled() -> bool:
            near = np.abs(self._intake.tension - point.tension) <= settling.tension
            return (
                self._intake.now_ns >= earliest_ns
                and bool(near.all())
                and stands(self._intake.wrenches, window_ns, settling.force, settling.torque)
            )

        if not self._operator.until(settled, settling.timeout, loading=True):
            away = np.abs(self._intake.tension - point.tension).max()
            return Reply(
                f"the load did not stand within {settling.timeout:g} s; the worst limb is "
                f"{away:.2g} N from its tension"
            )
        return Reply()

    def _beyond(self, tension: FloatArray) -> str:
        """Why a load is beyond the limits here; empty if it is not."""
        values = self._intake.pose
        pose = None if values is None else read_pose(values)
        if pose is None:
            return "platform_pose has not arrived: the load cannot be judged"
        position, rotation = pose
        matrix = structure_matrix(self._node.rig.geometry, position, rotation)
        base = matrix @ tension
        wrench = np.concatenate([rotation.T @ base[:3], rotation.T @ base[3:]])
        if (np.abs(wrench) <= self._plan.wrench_limit).all():
            return ""
        return (
            f"tensions {np.round(tension, 1).tolist()} N: expected a wrench within "
            f"{self._plan.wrench_limit}, they make {np.round(wrench, 1).tolist()}"
        )

    def _measure(self, request: Measure) -> Reply:
        self.standing.phase = "measuring"
        if self._pass != request.key[:2]:
            self._pass, self._group = request.key[:2], self._group + 1
        message = self._announcement(request)
        try:
            load = self._measured(request, message)
        except InterruptedCampaignError:
            raise
        except CampaignError as error:
            message.success, message.reason = False, str(error)
            self._announce(message)
            return Reply(str(error))
        message.success = True
        # First the bag, then the table: a load in neither is measured again, and a load that an
        # interruption leaves in the bag alone is found there.
        self._announce(message)
        self._journal.add(load)
        self._publish(message)
        self._count()
        return Reply(enough=self._accurate())

    def _announcement(self, request: Measure) -> StiffnessLoad:
        key, point = request.key, request.point
        return StiffnessLoad(
            configuration=key.configuration,
            reflector=key.reflector,
            load=key.load,
            group=self._group,
            branch=point.branch,
            attempt=min(request.attempt, 255),
            tension=point.tension.tolist(),
        )

    def _measured(self, request: Measure, message: StiffnessLoad) -> MeasuredLoad:
        plan, key, intake = self._plan, request.key, self._intake
        found, reason = self._operator.measure(
            key.reflector, plan.averaging_time, plan.measure_timeout
        )
        if found is not None and intake.bag is not None:
            intake.bag.add("reflector_measurement", serialize_message(found), time.time_ns())
        if reason:
            raise CampaignError(f"{reflector_name(key.reflector)}: {reason}")
        middle_ns = time_ns(found.header.stamp)
        half_ns = round(0.5e9 * plan.averaging_time)
        begin_ns, end_ns = middle_ns - half_ns, middle_ns + half_ns
        set_time(message.begin, begin_ns)
        set_time(message.end, end_ns)
        if not self._operator.until(
            lambda: min(intake.wrenches.newest_ns, intake.joints.newest_ns) > end_ns,
            BEHIND_S + plan.averaging_time,
            loading=True,
        ):
            raise CampaignError("the window's last samples of wrench and joints did not arrive")
        with intake.news:
            mean = average(intake.wrenches, intake.joints, begin_ns, end_ns)
            away = float(np.abs(intake.tension - request.point.tension).max())
        if not away <= plan.settling.tension:
            raise CampaignError(
                f"the load did not stay: a limb is {away:.2g} N from its tension after the "
                f"measurement, {plan.settling.tension:g} N allowed"
            )
        allowed = np.repeat([plan.steady_force, plan.steady_torque], 3)
        if not (mean.deviation <= allowed).all():
            raise CampaignError(
                f"the load was not steady: expected deviations within {plan.steady_force:g} N, "
                f"{plan.steady_torque:g} N m, got {np.round(mean.deviation, 3).tolist()}"
            )
        point = found.position
        return MeasuredLoad(
            *(key.configuration, key.reflector, key.load, self._group, request.point.branch),
            begin_ns,
            end_ns,
            request.point.tension,
            mean,
            np.array([point.x, point.y, point.z]),
            np.array(found.covariance).reshape(3, 3),
        )

    def _announce(self, message: StiffnessLoad) -> None:
        """Write a load to the bag, safe against kill -9; publish a failed one at once."""
        set_time(message.header.stamp, max(self._intake.now_ns, 0))
        bag = self._intake.bag
        if bag is not None:
            bag.add("stiffness_load", serialize_message(message), time.time_ns())
            bag.write(flush=True)
        if not message.success:
            self._publish(message)

    def _count(self) -> None:
        standing = self.standing
        self._fresh += 1
        standing.done = len(self._journal.finished)
        left = max(standing.total - standing.done - standing.skipped, 0)
        standing.remaining_s = left * (time.monotonic() - self._began) / self._fresh

    def _tell(self, request: Tell) -> Reply:
        standing = self.standing
        # A retried configuration concerns all its loads and needs one line.
        told = request.keys if request.what == "skipped" else request.keys[:1]
        self._journal.tell(time.time_ns(), request.what, told, request.reason)
        if request.what == "skipped":
            standing.skipped += len(request.keys)
        first = request.keys[0]
        standing.note = (
            f"{request.what}: {place_name(*first)}"
            + (f" and {len(request.keys) - 1} more" if len(request.keys) > 1 else "")
            + f": {request.reason}"
        )
        self._node.get_logger().warning(standing.note)
        return Reply()

    def _rest(self) -> Reply:
        self._pass = None
        self.standing.phase = "pausing"
        self._leader.go(self._leader.rest)
        self._operator.until(lambda: self._leader.arrived, MODE_S)
        self.standing.phase = "paused"
        self._operator.until(self._resume.is_set, PAUSE_S)
        return Reply()
