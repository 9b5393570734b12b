# SPDX-License-Identifier: Apache-2.0
"""Runs the trials of the fault campaign on the real graph, one after the other."""

from __future__ import annotations

import os
import signal
import time
from contextlib import suppress
from pathlib import Path

import numpy as np

from cabols_control.load_programs.programs import CSV_HEADER
from cabols_control.ros.rig_client import RigError, RunningAction
from cabols_control.supervision.modes import OperatingMode
from cabols_sim.fault_campaign.judgement import Report, TrialData, TrialResult, judge
from cabols_sim.fault_campaign.kinds import LOADING, Kind
from cabols_sim.ros.rig_watch import RigWatch

LOAD_N = 100.0
"""Force of the load under every fault, in a random direction, with 2 N m about it."""
TORQUE_NM = 2.0
LOW_N = 15.0
DETECT_S = 2.0
"""Rig's time after which a fault counts as undetected [s]."""
PRETIGHTEN_S = 10.0
"""The same for faults that show only in pre-tightening [s]."""
AFTER_S = 0.4
"""Rig's time that is recorded after detection [s]."""
RESTART_S = 0.8
"""Rig's time after which a killed process is restarted [s]: longer than any time-out."""
MOVING_S, SETTLE_S = 1.2, 0.4
"""Rig's time until a robot that was sent off moves, and until old reports have come [s]."""
FROZEN_S = 1.0
"""Shortest wall time of a frozen process [s]."""

MODES = {
    LOADING: OperatingMode.LOADING,
    "free": OperatingMode.FREE_MOVING,
    "robot moves": OperatingMode.FREE_MOVING,
    "stopped": OperatingMode.STOPPED,
}
"""Mode of a state that lasts, when the fault comes."""


class Trials:
    """One rig, many trials."""

    def __init__(self, watch: RigWatch, pids: dict[str, int], speed: float, folder: Path) -> None:
        """Use a running graph.

        Args:
            watch: sees and commands it.
            pids: process ids by executable, kept up to date by the process supervisor.
            speed: of the rig's time in real time's.
            folder: for the load programmes.
        """
        self._watch = watch
        self._pids = pids
        self._speed = speed
        self._folder = folder
        self._moves = 0

    def run(self, kind: Kind, seed: int) -> TrialResult:
        """Load the rig, cause the fault, record.

        Raises:
            RigError: if the rig could not be loaded: the trial says nothing then.
        """
        random = np.random.default_rng([seed, *kind.name.encode()])
        watch = self._watch
        handle = self._prepare(kind.state, random)
        time.sleep(random.uniform(0.0, 0.2))
        if watch.complaints:
            raise RigError(f"disturbed before the fault: {watch.complaints[0].reason}")
        meant = MODES.get(kind.state)
        if meant is not None and watch.mode != meant:
            # A report that came while the rig settled has been forgotten.
            raise RigError(f"disturbed before the fault: expected {meant.name}, got {watch.mode}")
        limbs = kind.pick_limbs(random, watch.tension)
        fault_s = self._strike(kind, limbs, kind.value(random), handle)
        self._watch_out(kind, fault_s)
        data = watch.trial(fault_s)
        self._mend(kind)
        if kind.state == "robot moves" and handle is not None:
            with suppress(RigError):
                handle.cancel()
        result = judge(kind.name, seed, data)
        if not result.safe_in_time:
            self._keep(result, data)
        return result

    def _keep(self, result: TrialResult, data: TrialData) -> None:
        """Save the record of a failed trial, for finding the reason."""
        path = self._folder / f"{result.kind.replace(' ', '_').replace(':', '')}_{result.seed}.npz"
        arrays = {"time": data.time, "tension": data.tension, "current": data.current}
        reports = [f"{r.stamp_s:.6f} {r.node}: {r.reason}" for r in data.reports]
        np.savez_compressed(path, fault_s=data.fault_s, reports=reports, **arrays)
        print(f"  not safe in time; what was recorded is in {path}", flush=True)

    def _prepare(self, state: str, random: np.random.Generator) -> RunningAction | None:
        """Bring the rig to a state; return the action that runs in it, if there is one."""
        watch = self._watch
        if state in (LOADING, "stopped"):
            handle = self._load(random)
            if state == "stopped":
                watch.emergency_stop()
                watch.wait(
                    lambda: watch.mode == OperatingMode.FAULT, "FAULT", 5.0, even_in_fault=True
                )
                watch.bring_to(OperatingMode.STOPPED)
                self._settle()
            return handle
        watch.inject("none")
        watch.bring_to(OperatingMode.STOPPED)
        watch.bring_to(OperatingMode.FREE_MOVING)
        with suppress(RigError):
            watch.wait(lambda: watch.tension.max() < LOW_N, "low tension", 2 / self._speed)
        if state == "pretightening":
            watch.bring_to(OperatingMode.STOPPED)
            self._settle()
            watch.ask("set_mode", mode=int(OperatingMode.PRETIGHTENING))
            return None
        # Through LOADING, so that all limbs have zeros.
        for mode in (OperatingMode.LOADING, OperatingMode.STOPPED, OperatingMode.FREE_MOVING):
            watch.bring_to(mode)
        self._settle()
        if state != "robot moves":
            return None
        self._moves += 1
        moving = watch.start("move_to_configuration", accept_s=10.0, index=1 + self._moves % 2)
        time.sleep(MOVING_S / self._speed)
        return moving

    def _settle(self) -> None:
        """Wait until what was before leaves no report, and forget it."""
        time.sleep(SETTLE_S / self._speed)
        self._watch.forget()

    def _load(self, random: np.random.Generator) -> RunningAction:
        """Bring the rig under load from whatever state it is in."""
        watch = self._watch
        watch.inject("none")
        watch.bring_to(OperatingMode.STOPPED)
        # A cut leaves the load on the gears; free-moving removes it, faster than tightening.
        watch.bring_to(OperatingMode.FREE_MOVING)
        with suppress(RigError):
            watch.wait(lambda: watch.tension.max() < LOW_N, "low tension", 2 / self._speed)
        watch.bring_to(OperatingMode.LOADING)
        direction = random.normal(size=3)
        direction /= np.linalg.norm(direction)
        wrench = np.concatenate([LOAD_N * direction, TORQUE_NM * direction])
        handle = watch.start("run_program", accept_s=5.0, program=str(self._programme(wrench)))
        scale = np.array([5.0] * 3 + [0.5] * 3)
        watch.wait(
            lambda: bool((np.abs(watch.wrench - wrench) < scale).all()),
            f"the load of {wrench.round(1)}",
            20.0 / self._speed,
        )
        watch.forget()
        time.sleep(0.1 / self._speed)
        return handle

    def _programme(self, wrench: np.ndarray) -> Path:
        path = self._folder / "load.csv"
        rows = [[0.0, *np.zeros(6)], [0.4 / self._speed, *wrench], [600.0, *wrench]]
        lines = [",".join(CSV_HEADER), *(",".join(f"{x:.6f}" for x in row) for row in rows)]
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
        return path

    def _strike(
        self, kind: Kind, limbs: list[int], value: float, handle: RunningAction | None
    ) -> float:
        """Cause the fault; return the rig's time of it."""
        watch, limb = self._watch, limbs[0]
        if kind.how == "inject" and kind.fault == "egm_bad":
            watch.inject("egm_loss", value=0.3)
            fault_s = watch.inject("egm_delay", value=0.05)
        elif kind.how == "inject":
            fault_s = watch.inject(kind.fault, limb, value)
            for other in limbs[1:]:
                watch.inject(kind.fault, other, value)
        elif kind.how == "pretighten":
            self._unload()
            watch.inject(kind.fault, limb, value)
            fault_s = watch.now_s
            watch.ask("set_mode", mode=int(OperatingMode.PRETIGHTENING))
        elif kind.how == "beam":
            fault_s = watch.inject("beam")
            reason = watch.measure()
            if reason:
                watch.complain(Report(watch.now_s, "abb_tracker_bridge", reason, False))
        elif kind.how in ("kill", "freeze"):
            fault_s = watch.now_s
            number = signal.SIGKILL if kind.how == "kill" else signal.SIGSTOP
            os.kill(self._pids[kind.fault], number)
        else:
            fault_s = watch.now_s
        if kind.demand is not None and handle is not None:
            with suppress(RigError):
                handle.cancel()
        return fault_s

    def _unload(self) -> None:
        watch = self._watch
        watch.ask("set_mode", mode=int(OperatingMode.STOPPED))
        watch.wait(lambda: watch.mode == OperatingMode.STOPPED, "STOPPED", 10.0 / self._speed)
        watch.forget()

    def _watch_out(self, kind: Kind, fault_s: float) -> None:
        """Wait for detection, then a little more; a frozen process continues in between."""
        watch, began = self._watch, time.monotonic()
        searches = kind.how == "pretighten" or kind.state == "pretightening"
        patience = PRETIGHTEN_S if searches else DETECT_S
        give_up = began + patience / self._speed
        while not watch.complaints and time.monotonic() < give_up:
            if kind.demand is not None:
                watch.demand(np.array(kind.demand))
            time.sleep(0.002)
        if kind.how == "freeze":
            time.sleep(max(0.0, began + FROZEN_S - time.monotonic()))
            with suppress(ProcessLookupError):
                os.kill(self._pids[kind.fault], signal.SIGCONT)
        if kind.how == "kill" and kind.fault == "plant":
            return
        now_s = max(watch.newest_s, fault_s)
        with suppress(RigError):
            watch.wait(
                lambda: watch.newest_s > now_s + AFTER_S, "more samples", 10.0, even_in_fault=True
            )

    def renew(self) -> None:
        """Restart the plant: an overload that a cut left on its gears cannot be unloaded."""
        with suppress(ProcessLookupError):
            os.kill(self._pids["plant"], signal.SIGKILL)
        time.sleep(RESTART_S / self._speed)

    def _mend(self, kind: Kind) -> None:
        """Wait until a killed process runs again."""
        if kind.how == "kill":
            time.sleep(RESTART_S / self._speed)
