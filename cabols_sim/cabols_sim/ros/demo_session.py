# SPDX-License-Identifier: Apache-2.0
"""The operator of the demo: leads the running graph through one session, step by step."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from cabols_control.naming import configuration_name, reflector_name
from cabols_control.ros.rig_client import AbandonedError, RigClient
from cabols_control.supervision.modes import OperatingMode

NEEDED = ("supervisor", "plant", "limb_controller", "wrench_controller", "abb_tracker_bridge")
"""Nodes that must report RUNNING before anything moves."""
CALM_S = 2.0
"""Between the nodes' start and the first motion: compiling and discovery stall a small machine."""
STEP_S = 40.0
"""Longest other step, at speed 1 [s]."""
ACCEPT_S = 10.0
"""Longest time of refusals of a goal, at speed 1 [s]: nodes receive a mode at different times."""
LEAVE_S = 5.0
SETTLE_S = 0.7
"""Pause after a change of mode [s]: the nodes receive it at different times."""
END_S = 1.0
ENDING_S = 6.0
"""Longest end of the graph [s]."""
POLL_S = 0.1
"""Every look at what has arrived takes time from the rig's loops on a small machine."""


@dataclass(frozen=True)
class DemoPlan:
    """What the operator does.

    Attributes:
        program: load programme's name or path.
        duration_s: of the programme [s].
        speed: of the rig's clock; programmes keep the wall's time.
        configurations: of the robot, in this order; it starts in 0.
        reflector: that the tracker measures, from 0.
    """

    program: str
    duration_s: float
    speed: float = 1.0
    configurations: tuple[int, ...] = (1, 0)
    reflector: int = 0


class DemoSession:
    """Runs in a thread beside the graph, as a node `operator` in a context of its own.

    Attributes:
        done: whether every step came to its end.
        error: why not; None if nothing went wrong, or the graph had ended by then.
        error_s: when it came, by time.monotonic(): what follows an interruption is none.
    """

    def __init__(
        self,
        plan: DemoPlan,
        domain: int,
        say: Callable[[str], None],
        load: Callable[[bool], None] = lambda _: None,
    ) -> None:
        """Plan; nothing runs yet.

        Args:
            plan: what the operator does.
            domain: DDS domain of the graph.
            say: called with one line for each step.
            load: called with True as a programme begins and with False as it has ended.
        """
        self._load = load
        self._plan = plan
        self._say = say
        self._domain = domain
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="demo_session", daemon=True)
        self._rig: RigClient | None = None
        self.done = False
        self.error: Exception | None = None
        self.error_s = 0.0

    def start(self, pids: dict[str, int]) -> None:
        """Begin; for run_bench's on_start. The graph is ended by SIGTERM to this process."""
        del pids
        self._thread.start()

    def stop(self) -> None:
        """End, wherever it is; call when the graph has ended."""
        self._stop.set()
        if self._rig is not None:
            self._rig.abandon()
        if self._thread.ident is not None:
            self._thread.join(LEAVE_S)

    def _run(self) -> None:
        try:
            with RigClient(
                name="operator", domain=self._domain, speed=self._plan.speed, poll_s=POLL_S
            ) as rig:
                self._rig = rig
                if not self._stop.is_set():
                    self._play(rig)
            self.done = not self._stop.is_set()
        except AbandonedError:
            pass
        except Exception as error:
            # Ctrl-C ends the plant first, of which the others complain: then it is no error.
            self.error_s = time.monotonic()
            if not self._stop.wait(ENDING_S):
                self.error = error
        finally:
            if not self._stop.is_set():
                os.kill(os.getpid(), signal.SIGTERM)

    def _play(self, rig: RigClient) -> None:
        """All steps; see section 4.2.2 for what the modes are for."""
        rig.wait_running(*NEEDED)
        rig.pause(CALM_S)
        self._say("free-moving by the switches: no limb knows its zero yet")
        rig.enter(OperatingMode.FREE_MOVING)
        rig.pause(CALM_S)
        self._say("pre-tightening: each limb winds in until its switch closes")
        rig.pretighten()
        self._say("free-moving with zeros: the cables follow at low tension")
        rig.enter(OperatingMode.FREE_MOVING)
        rig.pause(SETTLE_S)
        for index in self._plan.configurations:
            self._say(f"robot to {configuration_name(index)}")
            self._act(rig, "move_to_configuration", index=index)
        self._measure(rig)
        self._say("pre-tightening again, where the load will be")
        rig.pretighten()
        self._say(f"loading: {self._plan.program}, {self._plan.duration_s:g} s")
        rig.enter(OperatingMode.LOADING)
        rig.pause(SETTLE_S)
        # A programme keeps the wall's time, so that its duration does not stretch in slow motion.
        self._load(True)
        self._act(rig, "run_program", self._plan.duration_s, program=self._plan.program, scale=1.0)
        self._load(False)
        self._say("unloading")
        rig.enter(OperatingMode.STOPPED)
        rig.pause(END_S)

    def _measure(self, rig: RigClient) -> None:
        name = reflector_name(self._plan.reflector)
        self._say(f"laser tracker measures {name}")
        found = self._act(rig, "measure_reflector", reflector=self._plan.reflector, search=True)
        p, rms = found.measurement.position, found.measurement.rms
        self._say(
            f"{name} at ({p.x:.4f}, {p.y:.4f}, {p.z:.4f}) m in the tracker's frame, "
            f"scatter {1e6 * rms:.0f} um"
        )

    def _act(self, rig: RigClient, action: str, longer_s: float = 0.0, **goal: Any) -> Any:
        """Run an action to its result."""
        speed = min(self._plan.speed, 1.0)
        times = {"timeout_s": STEP_S / speed + longer_s, "accept_s": ACCEPT_S / speed}
        return rig.run(action, **times, **goal)
