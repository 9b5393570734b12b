# SPDX-License-Identifier: Apache-2.0
"""The bridge node: paces the control loop, publishes samples, writes currents, guards them."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from functools import partial

import numpy as np
from std_srvs.srv import Trigger

from cabols_control.rig import Rig
from cabols_control.ros.loop import SLOW_INPUT, Input, make_wait_set, wait, wait_for
from cabols_control.ros.messages import topics
from cabols_control.ros.messages.layout import Record
from cabols_control.ros.node import FAULT, RUNNING, WAITING, ControlNode
from cabols_control.ros.parameters import declare_row
from cabols_control.ros.sessions import ModeInput, same_session
from cabols_control.ros.stops import STOPPED, StopLatch
from cabols_control.supervision.faults import Fault, FaultName
from cabols_control.supervision.modes import MOVING, Cause, OperatingMode
from cabols_hw.bringup_nodes import NODES as HW_NODES
from cabols_hw.card.config import CardConfig, load_card
from cabols_hw.card.daq import CardSample, Daq
from cabols_hw.ros.answer_count import AnswerCount
from cabols_hw.ros.bias_keeper import BiasKeeper
from cabols_hw.ros.bridge_safety import bridge_safety
from cabols_hw.ros.hanging_pose import hanging_pose, make_bridge
from cabols_hw.ros.managed_bridge import INACTIVE, ManagedBridge, why_busy
from cabols_hw.ros.pose_input import PoseInput
from cabols_hw.ros.power_on import PowerOnGate
from cabols_hw.ros.warm_up import warm_up_guard
from cabols_hw.safety.config import SafetyConfig

NOTICE_EVERY = 100
"""Cycles between two looks at what is worth a notice."""
HELP_S = 1.0
"""From the wish to end until the bridge unloads by itself, if the supervisor does not [s]."""
ANSWER_WAIT_NS = 20_000_000
EXTRA_WAITS = 1
"""Room in the wait set for further inputs of a derived bridge."""
LOCKSTEP_PATIENCE_S = 20.0

DaqFactory = Callable[["BridgeNode", Rig, CardConfig], Daq]


class BridgeNode(ManagedBridge, ControlNode):
    """Bridge between a card and the graph.

    In real time one thread reads the card, which paces it, and publishes; another writes each
    motor_current as it comes, so that the loop's delay is not rounded up to a period. In lockstep
    one thread does both and waits for the answer.

    Attributes:
        is_rig: whether the sensor's bias is kept on the disk, and the wiring has to be checked.
    """

    is_rig = True
    role_topic = "live/limb_state"

    def __init__(self, name: str, make_daq: DaqFactory) -> None:
        """Open the card and advertise.

        Args:
            name: node name.
            make_daq: makes the card's back end; may declare parameters of its own.
        """
        ManagedBridge.__init__(self)
        ControlNode.__init__(self, name)
        card_file = declare_row(self, HW_NODES.argument("card_file"))
        self._card = load_card(self.rig_folder, card_file)
        self._card.wiring.require_limbs(self.rig.geometry.cables)
        self.daq = make_daq(self, self.rig, self._card)
        geometry = self.rig.geometry
        n = geometry.cables
        self._watchdog_s = declare_row(self, HW_NODES.argument("watchdog")) or self._card.watchdog
        self._safety_config = self.safety_config()
        limits = self.rig, self._card, self._safety_config, self._watchdog_s
        self._unheld, self.bridge, self._guard = make_bridge(*limits)
        self._bias_keeper = BiasKeeper(self, self.bridge, self._card, self.is_rig)
        self._notice: Fault | None = None
        self._power_on = PowerOnGate(self, self._guard, self.is_rig)
        self.hanging = hanging_pose(self, self.bridge, self._guard)
        currents = topics.motor_current_layout(geometry, n)
        sessions = self.status.sessions
        self._current_input = Input(self, "motor_current", currents, self.lockstep)
        self._current_input.judge = same_session(currents, sessions, self.lockstep)
        self._newest_ns = 0
        self._mode_input = ModeInput(
            self,
            sessions,
            self.lockstep,
            clock_ns=lambda: self._newest_ns,
            on_session=self._follow,
        )
        self._poses = PoseInput(self, self.bridge, self._guard)
        self._answers = [self._current_input, self._mode_input, *self.extra_inputs()]
        self._state = topics.limb_state_layout(geometry).record()
        self._state["limb"][:] = np.arange(n)
        self._wrench = topics.wrench_layout(geometry.platform_frame).record()
        names = ("wound_length", "elongation", "tension", "switch_closed", "zeroed")
        names += ("cable_speed", "cable_acceleration")
        self.bridge.bind({name: self._state[name] for name in names})
        self.bridge.bind({"followed_mode": self._state["mode"], "zeroing": self._state["zeroing"]})
        self.bridge.bind({"wrench": self._wrench["wrench"]})
        warm_up_guard(self.rig, self._safety_config, self._watchdog_s, self.bridge, currents)
        self._state_output = self.advertise_live("limb_state")
        self._wrench_output = self.advertise_live("wrench")
        self.create_service(Trigger, "tare", self._tare)
        self._lock = threading.Lock()
        self._mode = OperatingMode.STOPPED
        self._zeroing = 0
        self._count = AnswerCount()
        self._turns = 0
        self._newest_s = 0.0
        self._refused: Fault | None = None
        self._enabled = True
        self._end_asked_s = 0.0
        self._stop = threading.Event()
        self._stops = StopLatch(self, self._press_stop, self._guard.release_stop)
        self._failure: BaseException | None = None
        activate = declare_row(self, HW_NODES.argument("activate"))
        self.manage(activate, lambda: why_busy(self._mode, self._guard.recovering))
        body = self._lockstep_body if self.lockstep else self._sample_body
        self._threads = [threading.Thread(target=self._run_thread, args=(body,), daemon=True)]
        if not self.lockstep:
            answer = threading.Thread(
                target=self._run_thread, args=(self._answer_body,), daemon=True
            )
            self._threads.append(answer)

    def safety_config(self) -> SafetyConfig:
        """Read the limits of the safety envelope; see bridge_safety."""
        path = declare_row(self, HW_NODES.argument("safety_file"))
        return bridge_safety(self.rig, self.rig_folder, path, self._card, self._watchdog_s)

    def extra_inputs(self) -> list[Input]:
        """Inputs besides motor_current and mode: here, the platform's pose from the robot."""
        return [] if self.hanging is not None else [self._poses]

    def on_inputs(self) -> None:
        """Take the messages of extra_inputs."""
        if self.hanging is None:
            self._poses.follow(self._newest_s)

    def on_sample(self, stamp_ns: int, sequence: int) -> None:
        """Publish further messages with a sample; called just before it is published."""
        if self.hanging is not None:
            self.hanging.sample(stamp_ns, sequence, self._mode)
            self._poses.used = True

    def end_asked(self) -> None:
        """Ask for unloading; the bridge helps itself if nobody unloads."""
        self.announce_end()
        self._end_asked_s = self._newest_s

    def may_end(self) -> bool:
        """Not while the motors move the cables, or unload them."""
        guard, mode = self._guard, self._mode
        if self.lockstep:
            return True
        if mode not in MOVING or guard.fault is not None:
            return not guard.recovering
        if mode != OperatingMode.UNLOADING and self._newest_s - self._end_asked_s > HELP_S:
            guard.ending = True
        return False

    def _follow(self, session: int) -> None:
        """Say in the limb states whose modes are followed."""
        self._state["session"][0] = session

    def begin(self) -> None:
        """Start the card and the threads."""
        for thread in self._threads:
            thread.start()

    def end(self) -> None:
        """Stop the threads; zero the outputs whatever happened."""
        self._stop.set()
        for thread in self._threads:
            if thread.is_alive():
                thread.join(timeout=1.0)
        self.daq.close()
        if self.hanging is None:
            self._bias_keeper.tell_held()

    @property
    def failure(self) -> BaseException | None:
        """Return the error that ended a thread."""
        return self._failure

    def _run_thread(self, body: Callable[[], None]) -> None:
        try:
            body()
        except BaseException as error:
            # Publishing into a context that a signal has just shut down is no failure.
            if self.context.ok():
                self._failure = self._failure or error
        self._stop.set()
        self.context.try_shutdown()

    def _running(self) -> bool:
        return not self._stop.is_set() and self.context.ok()

    def _sample_body(self) -> None:
        self.prepare_thread()
        self.daq.start(self._watchdog_s)
        while self._running():
            sample = self.daq.read()
            started = time.monotonic_ns()
            self._handle(sample)
            self.status.work.add(1e-9 * (time.monotonic_ns() - started))
            self._report(sample.time_ns)

    def _answer_body(self) -> None:
        # Only the currents wake it; mode and pose are read then, or after the wait.
        wait_set = make_wait_set(self, 1)
        while self._running():
            wait(wait_set, self._answers[:1], ANSWER_WAIT_NS)
            self._take_answers()

    def _lockstep_body(self) -> None:
        self.prepare_thread()
        self.daq.start(self._watchdog_s)
        wait_set = make_wait_set(self, len(self._answers) + EXTRA_WAITS)
        while self._running() and not self.finished():
            sample = self.daq.read()
            self._handle(sample)
            self._wait_for_answers(wait_set, sample.time_ns)
            self._report(sample.time_ns)

    def finished(self) -> bool:
        """Whether a lockstep run is complete."""
        return False

    def _wait_for_answers(self, wait_set: object, stamp_ns: int) -> None:
        give_up = time.monotonic() + LOCKSTEP_PATIENCE_S
        while missing := self.missing(stamp_ns):
            if not self._running():
                return
            if time.monotonic() > give_up:
                topic_names = ", ".join(item.topic for item in missing)
                raise TimeoutError(
                    f"lockstep: {topic_names} did not answer the state at {stamp_ns} ns within "
                    f"{LOCKSTEP_PATIENCE_S:g} s; is every node of the graph running?"
                )
            # Mode before currents, in whatever order they arrive: it decides about the currents.
            awaited = [item for item in missing if item is self._mode_input] or missing
            if wait_for(wait_set, awaited, ANSWER_WAIT_NS):
                self._take_answers()

    def missing(self, stamp_ns: int) -> list[Input]:
        """Inputs that a lockstep clock waits for before the sample after the one of stamp_ns."""
        return [item for item in self._answers if item.stamp_ns < stamp_ns]

    def _handle(self, sample: CardSample) -> None:
        """Judge one sample, convert it to messages and send them.

        Safety comes first, and nothing follows the sending, so that this process is free when the
        answer arrives.
        """
        with self._lock:
            self.bridge.take(sample, self._mode, self._zeroing)
            current = 0.0 if self.daq.watchdog_expired else self.bridge.current
        self._supervise(sample)
        self._count.sent += 1
        self._newest_ns, self._newest_s = sample.time_ns, 1e-9 * sample.time_ns
        state, wrench = self._state, self._wrench
        state.stamp(sample.time_ns)
        state["sequence"][0] = self._count.sent
        state["current"][:] = current
        wrench.stamp(sample.time_ns)
        self.on_sample(sample.time_ns, self._count.sent)
        self._count.sending()
        self._send(state, wrench)

    def _send(self, state: Record, wrench: Record) -> None:
        # One wrench per limb state, so that DDS numbers both alike: see TensionCommand.sequence.
        self._state_output.publish(state.raw())
        self._wrench_output.publish(wrench.raw())
        self._state_output.copy()
        self._wrench_output.copy()

    def _take_answers(self) -> None:
        if self.lockstep:
            self._hear_mode()
        came = self._current_input.take()
        if came:
            self._accept_current()
        elif self._current_input.error:
            self._refuse(self._current_input.error)
        self._turns += 1
        # Without currents a turn takes ANSWER_WAIT_NS: each turn then reads the mode.
        if not self.lockstep and (not came or self._turns % SLOW_INPUT == 0):
            self._hear_mode()
        self.on_inputs()

    def _accept_current(self) -> None:
        """Check one motor_current and put it on the amplifiers at once."""
        now_ns = time.monotonic_ns()
        record = self._current_input.record
        sequence = int(record["sequence"])
        limbs, current = record["limb"], record["current"]
        if complaint := self._count.complaint(sequence):
            self._refuse(complaint)
            return
        if not self._guard.command(limbs, current, self._newest_s):
            count = self.rig.geometry.cables
            self._refuse(
                f"motor_current: expected finite numbers for indices below {count} (from 0), got "
                f"{current.tolist()} for {limbs.tolist()}"
            )
            return
        self.status.lost += self._count.take(sequence)
        self._refused = None
        if not self.lockstep:
            self.status.round_trip.add(self._count.round_trip_s(sequence, now_ns))
        self._write()

    def _refuse(self, reason: str) -> None:
        """Keep the previous currents; this is reported, but no fault."""
        self._refused = Fault(FaultName.MESSAGE, reason)

    def _write(self) -> None:
        """Write the guard's currents to the amplifiers."""
        with self._lock:
            self.daq.write(self.bridge.volts(self._guard.output(self._mode)))

    def _supervise(self, sample: CardSample) -> None:
        """Let the guard judge the newest sample."""
        expired = self.daq.watchdog_expired
        if self._guard.sample(1e-9 * sample.time_ns, self.bridge, self._mode, expired):
            self._write()
        enabled = self._guard.enabled and self.active
        if enabled != self._enabled:
            self._enabled = enabled
            self.daq.enable(self._enabled)
        # After a fault the guard alone decides: it may have to brake, or to give way to the robot.
        if expired and (self._mode not in MOVING or self._guard.fault is not None):
            self.daq.clear_watchdog()

    def _hear_mode(self) -> None:
        if self._mode_input.take():
            self._take_mode()
            self._stops.follow(self._mode_input.record["lifted"])

    def _take_mode(self) -> None:
        record = self._mode_input.record
        # The number first: a sample in between must not use the new mode with the old zeros.
        self._zeroing = int(record["zeroing"])
        mode = OperatingMode(int(record["mode"]))
        self._mode = mode if self.active or mode not in MOVING else OperatingMode.STOPPED
        if self._mode != OperatingMode.FAULT:
            return
        if int(record["cause"]) == Cause.EMERGENCY_STOP:
            self._guard.emergency_stop()
            self._write()

    def _press_stop(self) -> None:
        """Cut at once, whatever the mode and whoever owns it."""
        self._guard.press_stop()
        self._write()

    def _report(self, stamp_ns: int) -> None:
        fault = self._guard.fault
        self.status.late = self.daq.late
        # Until then the supervisor allows no motion: a load without a pose is a fault.
        # Nor before the first tare is decided, which needs cables that nothing winds in.
        heard = self._count.answered and self._poses.used
        ready = self.active and heard and self.bridge.sensor_tare.judged
        answered = RUNNING if ready else WAITING
        if self.status.cycles % NOTICE_EVERY == 0:
            resting = self._mode not in MOVING and not self._guard.unloading.active
            # What a sensor would show is not the platform's where nothing holds it.
            own = self.hanging.notice if self.hanging else partial(self._bias_keeper.look, resting)
            self._notice = self._unheld or self._power_on.look(resting) or own()
        self.status.stop = stopped = self._stops.number
        if stopped:
            self.status.cycle(stamp_ns, FAULT, STOPPED)
        elif fault is not None:
            self.status.cycle(stamp_ns, FAULT, fault.told())
        elif not self.active:
            self.status.cycle(stamp_ns, answered, INACTIVE)
        else:
            self.status.cycle(stamp_ns, answered, self._refused or self._notice)
        self.tidy()

    def _tare(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        del request
        if self._mode != OperatingMode.STOPPED:
            response.success = False
            response.message = f"tare only in STOPPED, with slack cables; now {self._mode.name}"
            return response
        with self._lock:
            taut = self.bridge.tare()
        response.success = not taut
        response.message = f"refused: {taut}" if taut else "taring; the status says if refused"
        return response
