# SPDX-License-Identifier: Apache-2.0
"""One trial of the generated campaign, and the rigs in the states that trials begin in."""

from __future__ import annotations

from typing import Any

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.rig import load_rig
from cabols_control.supervision.modes import OperatingMode
from cabols_hw.card.config import load_card
from cabols_hw.safety.config import load_safety
from cabols_sim.fault_campaign.in_process.disturbances import WIRED_S
from cabols_sim.fault_campaign.in_process.kinds import WIRED, GeneratedKind
from cabols_sim.fault_campaign.in_process.rig import PERIOD_S, LockstepRig
from cabols_sim.fault_campaign.judgement import TOLERANCE_N
from cabols_sim.plant.config import load_plant

LOAD_N, TORQUE_NM = 100.0, 2.0
ROBOT_M_S = 0.06
PATH_LOAD_N, PATH_M_S, TURNING_RAD_S = 60.0, (0.02, 0.04), 0.02
"""What a path under load carries, and how fast it goes."""
WATCHED_S, AFTER_S = 2.5, 0.8
"""Longest trial, and how long it goes on after its detection [s]."""
SEARCH_S = 4.0
"""Longest trial in PRETIGHTENING: from slack cables to the search's length and more [s]."""
CREEP_N = 1.0
"""Growth that is left when a rig counts as safe, as of a robot that still brakes [N]."""
REST_N = 7.0
"""Tension at which limbs follow a robot without a load: growth of a slacker cable up to it is not
counted [N]."""
FULL_A, OFF_S, DRIVE_MARGIN = 5.0, 0.003, 1.2
"""An amplifier's own current that counts as full [A]; it must be off by then [s], within 20 %."""
DOUBT_AS, DOUBT_A, DOUBT_SHARE = 0.0035, 0.25, 0.9
"""A smaller one is off later: it takes a charge to tell it from friction and from a model that is
not exact [A s], gathered by what DOUBT_SHARE of its current has beyond DOUBT_A [A]."""
TICK_S = 0.5 * PERIOD_S
"""What rounding may shift a sample's time by [s]."""
LOADING = OperatingMode.LOADING
TURN_SAMPLES = 700
"""Samples for which a rig that is wired wrongly holds a load, before it is asked for another."""
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
        if state == WIRED:
            return self.started(seed)
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
        load_n = PATH_LOAD_N if state == "path under load" else LOAD_N
        rig.desired = np.concatenate([load_n * direction, TORQUE_NM * direction])
        rig.run(0.8 + random.uniform(0.0, 0.05))
        if state == "path under load":
            way = random.normal(size=3)
            speed = random.uniform(*PATH_M_S)
            rig.path = speed, TURNING_RAD_S
            rig.robot.move(speed * way / np.linalg.norm(way))
            rig.run(random.uniform(0.4, 1.0))
        if state == "stopped":
            rig.guard.emergency_stop()
            rig.mode = OperatingMode.FAULT
            rig.run(0.3)
            rig.mode = OperatingMode.STOPPED
            rig.run(random.uniform(0.1, 0.3))
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
    kind.disturbance.strike(rig, random)
    driven, lengths = _driven(rig), rig.plant.cable_length.copy()
    full = bool(driven) and rig.plant.faults.value("amplifier_offset") >= FULL_A
    fault_before = rig.guard.fault
    watched_s = {"pretightening": SEARCH_S, WIRED: WIRED_S}.get(kind.state, WATCHED_S)
    if kind.state == WIRED:
        rig.mode = OperatingMode.PRETIGHTENING
    found_s, end_s = np.inf, struck_s + watched_s
    rows, beyond = [], -np.inf
    while rig.now_s < end_s - TICK_S:
        rig.cycle()
        if kind.state == WIRED:
            _go_on(rig, random)
        plant = rig.plant
        for limb, bound in driven.items():
            stretched = max(float(plant.cable_length[limb] - lengths[limb]), 0.0)
            by_way = float(rig.rig.springs.nominal[limb]) * stretched
            beyond = max(beyond, float(plant.tension[limb]) - bound - by_way)
        rows.append(
            (rig.now_s, plant.tension.copy(), plant.wrench.copy(), plant.cable_length.copy())
        )
        if not np.isfinite(found_s) and rig.guard.fault is not fault_before:
            found_s = rig.now_s
            end_s = min(end_s, found_s + AFTER_S)
    times, tension, wrenches, way = (np.array(column) for column in zip(*rows, strict=True))
    change = wrenches - wrench
    fault = rig.guard.fault
    growth, ways = _grown(times, tension, way, found_s)
    by_ways = rig.rig.springs.nominal * ways
    return {
        "kind": kind.name,
        "seed": seed,
        "healthy": bool(healthy),
        "latent": kind.latent,
        "amplifier": kind.disturbance.amplifier,
        "full": full,
        "beyond_drive_n": beyond if driven else None,
        "within_s": kind.disturbance.within_s,
        "detected": bool(np.isfinite(found_s)),
        "detection_time_s": float(found_s - struck_s) if np.isfinite(found_s) else None,
        "found_by": str(fault.name) if fault is not None and np.isfinite(found_s) else "",
        "safe_time_s": _safe_s(times, tension, found_s),
        "by_robot": kind.by_robot,
        "blind": kind.blind,
        "uncounted": kind.disturbance.uncounted,
        "pair": kind.disturbance.pair,
        "growth_n": float(growth.max()),
        "beyond_robot_n": float((growth - by_ways).max()),
        "peak_tension_n": float(tension.max()),
        "peak_axes": np.abs(wrenches).max(axis=0).tolist(),
        "change_force_n": float(np.linalg.norm(change[:, :3], axis=1).max()),
        "change_torque_nm": float(np.linalg.norm(change[:, 3:], axis=1).max()),
    }


def _driven(rig: LockstepRig) -> dict[int, float]:
    """Return the tension [N] that each limb may reach whose amplifier drives by itself.

    The amplifier is off within off_s; the motor then coasts by v T, in all k i t_off and what its
    speed was before. Where the limb's encoder stands still only the sensor feels it, later: there
    TENSION_N is the bound, as for all.
    """
    limbs, found = rig.rig.limbs, {}
    offset = rig.plant.faults.value("amplifier_offset")
    for limb in rig.plant.faults.limbs_with("amplifier_offset"):
        if offset > 0.0 and limb not in rig.plant.faults.limbs_with("encoder_frozen"):
            gain = float(np.asarray(limbs.gain)[limb])
            current = offset + max(float(rig.plant.current[limb]), 0.0)
            coasts = max(float(rig.guard.safety.speed[limb]), 0.0)
            way = gain * current * off_s(offset) + coasts * float(limbs.time_constant[limb])
            added = DRIVE_MARGIN * float(rig.rig.springs.nominal[limb]) * way
            found[limb] = float(rig.plant.tension[limb]) + added
    return found


def off_s(offset: float) -> float:
    """Time after which an amplifier that drives by itself must be off [s].

    Args:
        offset: its own current, at least 0.5 [A].
    """
    if offset >= FULL_A:
        return OFF_S
    return OFF_S + DOUBT_AS / (DOUBT_SHARE * offset - DOUBT_A)


def _grown(
    times: FloatArray, tension: FloatArray, way: FloatArray, found_s: float
) -> tuple[FloatArray, FloatArray]:
    """Return by how much each limb's tension grew after detection [N], and its cable's way [m].

    Args:
        times: (k,) [s].
        tension: (k, n) [N].
        way: (k, n) lengths of the cables [m].
        found_s: when the fault was detected [s]; inf: never.
    """
    later = times > (found_s if np.isfinite(found_s) else -np.inf) - TICK_S
    pulls = np.maximum(tension[later], REST_N)
    grown = pulls.max(axis=0) - pulls[0]
    stretched = way[later].max(axis=0) - way[later][0]
    return grown, stretched


def _go_on(rig: LockstepRig, random: np.random.Generator) -> None:
    """Load a rig once all its limbs have zeros, then in other directions.

    Two limbs whose channels are all exchanged cannot be told apart while they pull alike.
    """
    tightens, loads = (rig.mode == mode for mode in (OperatingMode.PRETIGHTENING, LOADING))
    turns = loads and round(rig.now_s / PERIOD_S) % TURN_SAMPLES == 0
    if (tightens and rig.bridge.zeroed.all()) or turns:
        direction = random.normal(size=3)
        rig.mode = LOADING
        rig.desired[:3] = PATH_LOAD_N * direction / np.linalg.norm(direction)


def _safe_s(times: FloatArray, tension: FloatArray, found_s: float) -> float | None:
    """Time from detection until no limb's tension grows any more [s]; None without detection.

    Where none ever grows by TOLERANCE_N that is at once; else it is the first instant from which
    on none of them grows by CREEP_N. A cable below REST_N may be taken up to it.

    Args:
        times: (k,) [s].
        tension: (k, n) [N].
        found_s: when the fault was detected [s].
    """
    if not np.isfinite(found_s):
        return None
    after = times > found_s - TICK_S
    later = np.maximum(tension[after], REST_N)
    growth = np.maximum.accumulate(later[::-1], axis=0)[::-1] - later
    if not growth[0].max() > TOLERANCE_N:
        return 0.0
    settled = int(np.argmax((growth <= CREEP_N).all(axis=1)))
    return float(times[after][settled] - found_s)
