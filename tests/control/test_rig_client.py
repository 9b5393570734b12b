# SPDX-License-Identifier: Apache-2.0
"""RigClient against servers that come late, refuse, stay silent; and on the real graph."""

from __future__ import annotations

import os
import threading
import time
from contextlib import contextmanager, suppress

import pytest
import rclpy
from cabols_msgs.action import RunProgram
from cabols_msgs.msg import LimbState, LoopStatus, Mode, ResultCode
from cabols_msgs.srv import SetMode
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
from std_srvs.srv import Trigger

from cabols_control.ros.live import live_name
from cabols_control.ros.messages.qos import topic_qos
from cabols_control.ros.rig_client import (
    AbandonedError,
    ActionFailedError,
    RefusedError,
    RigClient,
    RigFaultError,
    RigTimeoutError,
)
from cabols_control.supervision.modes import OperatingMode
from cabols_control.topics import NAMESPACE
from cabols_sim.bench.run import forgiving
from graph_harness import next_environment, run_scenario

pytestmark = pytest.mark.ros


class FakeRig:
    """A supervisor and a load programme that do as a test says."""

    def __init__(self, domain):
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = rclpy.create_node("fake", namespace=NAMESPACE, context=self.context)
        self._mode = self.node.create_publisher(Mode, "mode", topic_qos("mode"))
        self._status = self.node.create_publisher(
            LoopStatus, "loop_status", topic_qos("loop_status")
        )
        name = live_name("limb_state")
        self.states = self.node.create_publisher(LimbState, name, topic_qos(name))
        self.verdicts = []
        """Of the next requests of a mode; the mode is entered when there are none."""
        self.asked = []
        self.silent = 0
        """So many requests of a mode get no answer in time."""
        self.refusals = []
        self.accept = True
        self.result = RunProgram.Result(success=True)
        self.end = threading.Event()
        self.cancelled = 0
        self.group = ReentrantCallbackGroup()
        self._executor = MultiThreadedExecutor(4, context=self.context)
        self._executor.add_node(self.node)
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()

    def serve(self):
        """Offer services and actions."""
        serve, group = self.node.create_service, self.group
        serve(SetMode, "set_mode", self._set_mode, callback_group=group)
        serve(Trigger, "emergency_stop", self._stop, callback_group=group)
        self.programs = ActionServer(
            self.node,
            RunProgram,
            "run_program",
            self._run,
            goal_callback=lambda _: GoalResponse.ACCEPT if self.accept else GoalResponse.REJECT,
            cancel_callback=self._cancel,
            callback_group=group,
        )

    def tell(self, mode, **fields):
        self._mode.publish(Mode(mode=int(mode), **fields))

    def report(self, node, state=LoopStatus.RUNNING, reason=""):
        self._status.publish(LoopStatus(node=node, state=state, reason=reason))

    def _spin(self):
        with suppress(ExternalShutdownException):
            self._executor.spin()

    def _set_mode(self, request, response):
        self.asked.append(request.mode)
        if self.silent:
            self.silent -= 1
            time.sleep(2.5)
            response.message = "too late"
            return response
        code = self.verdicts.pop(0) if self.verdicts else ResultCode.DONE
        response.success, response.code = code == ResultCode.DONE, code
        if response.success:
            self.tell(request.mode)
        return response

    def _stop(self, _, response):
        self.tell(OperatingMode.FAULT, reason="emergency stop", cause=Mode.CAUSE_EMERGENCY_STOP)
        response.success = True
        return response

    def _cancel(self, _):
        self.cancelled += 1
        return CancelResponse.ACCEPT

    def _run(self, handle):
        if self.refusals:
            handle.abort()
            code = self.refusals.pop(0)
            return RunProgram.Result(message="refused: as told", code=int(code))
        handle.publish_feedback(RunProgram.Feedback(elapsed=1.0, duration=2.0))
        while not self.end.wait(0.01) and not handle.is_cancel_requested:
            pass
        if handle.is_cancel_requested:
            handle.canceled()
        elif self.result.success:
            handle.succeed()
        else:
            handle.abort()
        return self.result

    def close(self):
        self.end.set()
        self.context.try_shutdown()
        self._thread.join(5.0)
        # Its latched mode would reach a later test in the same domain.
        self.node.destroy_node()


@pytest.fixture
def domain(monkeypatch):
    for name, value in next_environment().items():
        monkeypatch.setenv(name, value)
    return int(os.environ["ROS_DOMAIN_ID"])


@pytest.fixture
def fake(domain):
    rig = FakeRig(domain)
    yield rig
    rig.close()


@pytest.fixture
def client(fake, domain):
    with RigClient(domain=domain) as found:
        yield found


@contextmanager
def repeated(action):
    """Do something again and again: a single sample may come before its reader is matched."""
    stop = threading.Event()

    def body():
        while not stop.wait(0.02):
            action()

    thread = threading.Thread(target=body)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


def later(action):
    """Do something a moment after the client has begun to wait."""
    thread = threading.Timer(0.5, action)
    thread.start()
    return thread


def test_a_service_that_starts_late_is_called_nevertheless(fake, client):
    serving = later(fake.serve)
    client.enter(OperatingMode.FREE_MOVING)
    serving.join()
    assert client.mode == OperatingMode.FREE_MOVING
    assert fake.asked == [OperatingMode.FREE_MOVING]


def test_a_request_without_an_answer_is_repeated(fake, client):
    fake.silent = 1
    fake.serve()
    client.enter(OperatingMode.FREE_MOVING)
    assert len(fake.asked) >= 2


def test_an_absent_service_is_named(client):
    with pytest.raises(RigTimeoutError, match="service emergency_stop: its node is not running"):
        client.emergency_stop(timeout_s=0.3)


def test_a_temporary_refusal_is_tried_again(fake, client):
    fake.verdicts = [ResultCode.NOT_READY, ResultCode.NOT_ZEROED, ResultCode.PLATFORM_MOVES]
    fake.serve()
    client.enter(OperatingMode.LOADING)
    assert len(fake.asked) == 4


@pytest.mark.parametrize(
    "code", [ResultCode.BAD_REQUEST, ResultCode.FAULT_LATCHED, ResultCode.WRONG_MODE]
)
def test_a_refusal_that_lasts_is_raised_at_once(fake, client, code):
    fake.verdicts = [code]
    fake.serve()
    with pytest.raises(RefusedError, match="mode LOADING was refused") as raised:
        client.enter(OperatingMode.LOADING)
    assert raised.value.code == code
    assert len(fake.asked) == 1


def test_a_refusal_until_the_end_carries_its_code(fake, client):
    fake.verdicts = [ResultCode.NOT_ZEROED] * 1000
    fake.serve()
    with pytest.raises(RefusedError) as raised:
        client.enter(OperatingMode.LOADING, timeout_s=0.5)
    assert raised.value.code == ResultCode.NOT_ZEROED


def test_fault_ends_a_wait_with_its_cause(fake, client):
    later(lambda: fake.tell(OperatingMode.FAULT, reason="cable", cause=Mode.CAUSE_FAULT, fault="f"))
    with pytest.raises(RigFaultError, match="cable") as raised:
        client.wait(lambda: False, "nothing", 30.0)
    assert (raised.value.cause, raised.value.fault) == (Mode.CAUSE_FAULT, "f")


def test_missing_nodes_are_named_with_what_they_report(fake, client):

    def two_reports():
        """Nodes report again and again: a single report may come before the reader is matched."""
        fake.report("limb_controller")
        fake.report("wrench_controller", LoopStatus.FAULT, "no wrench")
        return len(client.reports) == 2

    client.wait(two_reports, "two reports", 30.0)
    text = r"supervisor, wrench_controller \(no wrench\), plant or q8_ati_bridge"
    with pytest.raises(RigTimeoutError, match=text):
        client.wait_running(timeout_s=0.1)
    for node in ("supervisor", "wrench_controller", "plant"):
        fake.report(node)
    client.wait_running()


def test_old_zeros_are_not_taken_for_new_ones(fake, client):
    """The zeros of the pre-tightening before are still on the topic when the mode has changed."""
    fake.serve()
    fake.tell(OperatingMode.STOPPED, zeroing=1)
    zeroing = [1]
    publish = fake.states.publish
    plain = fake.tell
    fake.tell = lambda mode, **_: plain(mode, zeroing=2)
    with repeated(lambda: publish(LimbState(zeroed=[True] * 8, zeroing=zeroing[0]))):
        with pytest.raises(RigTimeoutError, match="the zeros of all limbs"):
            client.pretighten(timeout_s=1.0)
        zeroing[0] = 2
        client.pretighten(timeout_s=30.0)


def test_an_action_runs_with_feedback(fake, client):
    fake.serve()
    fake.end.set()
    heard = []
    result = client.run_program("ramps", on_feedback=heard.append)
    assert result.success
    assert [feedback.duration for feedback in heard] == [2.0]


def test_an_action_that_fails_carries_its_result(fake, client):
    fake.serve()
    fake.end.set()
    fake.result = RunProgram.Result(message="slipped", code=ResultCode.INTERRUPTED)
    with pytest.raises(ActionFailedError, match="run_program: slipped") as raised:
        client.run_program("ramps")
    assert raised.value.code == ResultCode.INTERRUPTED
    assert raised.value.result.message == "slipped"


def test_an_action_that_takes_too_long_is_cancelled(fake, client):
    fake.serve()
    with pytest.raises(RigTimeoutError, match="the end of run_program"):
        client.run("run_program", program="ramps", timeout_s=0.3)
    client.wait(lambda: fake.cancelled == 1, "the cancellation", 30.0)


def test_a_goal_that_is_refused_is_sent_again(fake, client):
    fake.serve()
    fake.accept = False
    fake.end.set()
    later(lambda: setattr(fake, "accept", True))
    assert client.run_program("ramps").success
    fake.accept = False
    with pytest.raises(RefusedError, match="run_program was refused"):
        client.start("run_program", accept_s=0.3, program="ramps")


def test_a_goal_that_is_refused_with_a_reason_says_it(fake, client):
    """Servers accept such a goal and end it at once: a rejected one has no room for a reason."""
    fake.serve()
    fake.end.set()
    fake.refusals = [ResultCode.WRONG_MODE, ResultCode.WRONG_MODE]
    assert client.run_program("ramps").success, "the mode may come late: it is sent again"
    assert not fake.refusals
    fake.refusals = [ResultCode.WRONG_MODE] * 100
    with pytest.raises(RefusedError, match="run_program was refused: refused: as told") as caught:
        client.start("run_program", accept_s=0.3, program="ramps")
    assert caught.value.code == ResultCode.WRONG_MODE
    fake.refusals = [ResultCode.BAD_REQUEST] * 100
    with pytest.raises(RefusedError) as caught:
        client.start("run_program", accept_s=100.0, program="nothing")
    assert caught.value.code == ResultCode.BAD_REQUEST
    assert len(fake.refusals) == 99, "what can never be accepted is not sent again"


def test_a_running_action_can_be_cancelled(fake, client):
    fake.serve()
    action = client.start("run_program", program="ramps")
    assert not action.done
    action.cancel()
    assert fake.cancelled == 1


def test_another_thread_can_abandon_a_client(client):
    later(client.abandon)
    with pytest.raises(AbandonedError):
        client.wait(lambda: False, "nothing", 60.0)


def test_an_old_sample_is_not_the_newest(fake, client):
    with pytest.raises(RigTimeoutError, match="a message of limb_state"):
        client.newest("limb_state", timeout_s=0.2)
    with repeated(lambda: fake.states.publish(LimbState(sequence=7))):
        assert client.newest("limb_state", timeout_s=30.0).sequence == 7
    client.wait(lambda: client.newest_if_any("limb_state") is None, "the sample to age", 30.0)


def test_a_block_that_fails_while_the_rig_moves_stops_it(fake, domain):
    fake.serve()

    def session():
        with RigClient(domain=domain) as client:
            client.enter(OperatingMode.FREE_MOVING)
            raise KeyError

    with pytest.raises(KeyError):
        session()
    assert fake.asked == [OperatingMode.FREE_MOVING, OperatingMode.STOPPED]


def test_it_works_on_a_node_that_is_there_already(fake):
    fake.serve()
    client = RigClient(fake.node)
    client.enter(OperatingMode.FREE_MOVING)
    client.close()
    assert fake.context.ok()


def test_one_session_on_the_real_graph():
    """What docs/rig_client.md shows, on the bench in slow motion."""
    seen = {}

    def scenario(watcher, _):
        with RigClient(domain=watcher.context.get_domain_id(), speed=0.2) as rig:
            rig.wait_running()
            with pytest.raises(RefusedError):
                rig.enter(OperatingMode.LOADING, timeout_s=0.5)
            rig.pretighten()
            rig.enter(OperatingMode.LOADING)
            heard = []
            action = rig.start("run_program", heard.append, program="ramps")
            rig.wait(lambda: len(heard) > 2, "feedback", 300.0)
            rig.wait(lambda: max(rig.newest("limb_state").tension) > 12.0, "tensions", 300.0)
            seen["cancelled"] = action.cancel()
            rig.enter(OperatingMode.STOPPED)
            rig.emergency_stop()
            with pytest.raises(RigFaultError) as raised:
                rig.enter(OperatingMode.FREE_MOVING)
            seen["fault"] = raised.value
            rig.reset()
            seen["mode"] = rig.mode

    ended, _, _ = run_scenario({"speed": 0.2, **forgiving(0.2)}, scenario)
    assert ended.first == ""
    assert not seen["cancelled"].success
    assert seen["mode"] == OperatingMode.STOPPED
    assert seen["fault"].reason
