"""One trial of the generated campaign, and the rigs in the states that trials begin in."""

from __future__ import annotations

from typing import Any

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.rig import load_rig
from cabols_control.supervision.modes import OperatingMode
from cabols_hw.card.config import load_card
from cabols_hw.safety.config import load_safety
from cabols_sim.fault_campaign.in_process.kinds import GeneratedKind
from cabols_sim.fault_campaign.in_process.rig import PERIOD_S, LockstepRig
from cabols_sim.fault_campaign.judgement import TOLERANCE_N
from cabols_sim.plant.config import load_plant

LOAD_N, TORQUE_NM = 100.0, 2.0
ROBOT_M_S = 0.06
WATCHED_S, AFTER_S = 2.5, 0.8
"""Longest trial, and how long it goes on after its detection [s]."""
SEARCH_S = 4.0
"""Longest trial in PRETIGHTENING: from slack cables to the search's length and more [s]."""
HARMLESS_N = 50.0
"""A third of what a spring bears: growth below it leaves a rig safe [N]."""
PLANTS = 4
"""Plants of different slack, bias and noise; a trial's is drawn by its seed."""


class Bench:
    """Makes rigs in the state that a trial begins in."""

    def __init__(self, rig_name: str = "") -> None:
        """Read a rig's files.

        Args:
            rig_name: name or folder; empty: the reference bench.
        """
        self._rig, self._card = load_rig(rig_name), load_card(rig_name)
        self._plant, self._safety = load_plant(rig_name), load_safety(rig_name)
        self._started: dict[int, LockstepRig] = {}
        self._zeroed: dict[int, LockstepRig] = {}

    def started(self, seed: int) -> LockstepRig:
        """Return a tared rig at rest, without zeros.

        Args:
            seed: of the trial.
        """
        number = seed % PLANTS
        if number not in self._started:
            made = LockstepRig(self._rig, self._card, self._plant, self._safety, number)
            made.run(0.3)
            self._started[number] = made
        return self._started[number].fork()

    def zeroed(self, seed: int) -> LockstepRig:
        """Return a pre-tightened rig.

        Args:
            seed: of the trial.

        Raises:
            RuntimeError: if a limb does not reach its switch.
        """
        number = seed % PLANTS
        if number not in self._zeroed:
            made = self.started(seed)
            made.mode = OperatingMode.PRETIGHTENING
            made.run(15.0, lambda: bool(made.bridge.zeroed.all()))
            made.run(0.5)
            if made.guard.fault is not None or not made.bridge.zeroed.all():
                raise RuntimeError(f"pre-tightening failed: {made.guard.fault}")
            self._zeroed[number] = made
        return self._zeroed[number].fork()

    def prepare(self, state: str, seed: int, random: np.random.Generator) -> LockstepRig:
        """Return a rig in one of STATES.

        Args:
            state: its name.
            seed: of the trial.
            random: of the trial.
        """
        if state in ("started", "pretightening"):
            rig = self.started(seed)
            tightens = state == "pretightening"
            rig.mode = OperatingMode.PRETIGHTENING if tightens else OperatingMode.FREE_MOVING
            rig.run(random.uniform(0.02, 0.25))
            return rig
        rig = self.zeroed(seed)
        if state in ("free", "robot moves"):
            rig.mode = OperatingMode.FREE_MOVING
            rig.run(0.3)
            if state == "robot moves":
                direction = random.normal(size=3)
                rig.robot.move(ROBOT_M_S * direction / np.linalg.norm(direction))
                rig.run(random.uniform(0.4, 1.0))
            return rig
        direction = random.normal(size=3)
        direction /= np.linalg.norm(direction)
        rig.mode = OperatingMode.LOADING
        rig.desired = np.concatenate([LOAD_N * direction, TORQUE_NM * direction])
        rig.run(0.8 + random.uniform(0.0, 0.05))
        if state == "second fault":
            rig.change_pose = lambda *_: None
            rig.run(0.5, lambda: rig.guard.fault is not None)
            rig.change_pose = None
            rig.run(random.uniform(0.002, 0.04))
        return rig


def run_trial(bench: Bench, kind: GeneratedKind, seed: int) -> dict[str, Any]:
    """Break a rig, and tell what the plant, not the bridge, says of it.

    Args:
        bench: makes the rig.
        kind: state and disturbance.
        seed: of all that is drawn.
    """
    random = np.random.default_rng([seed, *kind.name.encode()])
    rig = bench.prepare(kind.state, seed, random)
    first = kind.state != "second fault"
    healthy = rig.guard.fault is None or not first
    wrench = rig.plant.wrench.copy()
    struck_s = rig.now_s
    before = float(rig.plant.tension.max())
    kind.disturbance.strike(rig, random)
    fault_before = rig.guard.fault
    watched_s = SEARCH_S if kind.state == "pretightening" else WATCHED_S
    found_s, end_s = np.inf, struck_s + watched_s
    rows = []
    while rig.now_s < end_s - 0.5 * PERIOD_S:
        rig.cycle()
        rows.append((rig.now_s, rig.plant.tension.max(), rig.plant.wrench.copy()))
        if not np.isfinite(found_s) and rig.guard.fault is not fault_before:
            found_s = rig.now_s
            end_s = min(end_s, found_s + AFTER_S)
    times = np.array([row[0] for row in rows])
    tension = np.array([row[1] for row in rows])
    wrenches = np.array([row[2] for row in rows])
    change = wrenches - wrench
    fault = rig.guard.fault
    return {
        "kind": kind.name,
        "seed": seed,
        "healthy": bool(healthy),
        "latent": kind.latent,
        "amplifier": kind.disturbance.amplifier,
        "within_s": kind.disturbance.within_s,
        "detected": bool(np.isfinite(found_s)),
        "detection_time_s": float(found_s - struck_s) if np.isfinite(found_s) else None,
        "found_by": str(fault.name) if fault is not None and np.isfinite(found_s) else "",
        "safe_time_s": _safe_s(times, tension, found_s, before),
        "peak_tension_n": float(tension.max()),
        "peak_axes": np.abs(wrenches).max(axis=0).tolist(),
        "change_force_n": float(np.linalg.norm(change[:, :3], axis=1).max()),
        "change_torque_nm": float(np.linalg.norm(change[:, 3:], axis=1).max()),
    }


def _safe_s(times: FloatArray, tension: FloatArray, found_s: float, before: float) -> float | None:
    """Time from detection until no tension grows any more [s]; None if nothing was detected.

    Growth by TOLERANCE_N, and below HARMLESS_N, does not count: a robot that brakes stretches
    cables whose motors stand.
    """
    if not np.isfinite(found_s):
        return None
    at = tension[times <= found_s]
    reference = max((float(at[-1]) if at.size else before) + TOLERANCE_N, HARMLESS_N)
    after = times > found_s
    if not after.any() or not tension[after].max() > reference:
        return 0.0
    return float(times[after][int(np.argmax(tension[after]))] - found_s)
