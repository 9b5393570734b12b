# SPDX-License-Identifier: Apache-2.0
"""Faults of the pose's sources, through the pose estimator's node; and an hour without any.

Bridge, guard, controllers and plant run in lockstep in this process, with the node's own code
beside them (tests/harness/agreement_rig.py). Each fault is injected into the plant, the robot or
the tracker. Its time counts from the first data that can tell: for a cable that slips by 5 mm, from
when the pull that it lost shows beyond noise (tests/harness/fault_strength.py); from 5 mm of motion
for two encoders whose plugs are exchanged, or from the robot's stop where the bridge is faster and
nothing moves any more; the next measurement for a tracker bumped by 1 mm; from 5 deg of turn for a
wrong tool, once it shows beyond noise. Where a slip or a tool never does, it cannot be told: the
cable pulled next to nothing, or the platform turned about the tool's wrong offset. Until it is
named, the fault must be among the candidates, and nothing else may be named.

The bridge judges the same limbs a thousand times a second, and often ends the motion first. Where
it unloads all cables, they are slack, and no data can tell any more: such a trial counts where the
bridge's message names the limb.

The hour is made of pieces of five minutes: pre-tightening, motion behind the robot, measurements,
loads, motion under load, unloading. Resumes: what stands in the output's .rows.jsonl is not run
again.
"""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path

import numpy as np
import rclpy
from cabols_msgs.msg import PoseAgreement
from record import write_figures

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "harness"))

from agreement_rig import AgreementRig
from cabols_control.pose_agreement.monitor import ODD_WRENCH
from cabols_control.supervision.modes import OperatingMode
from fault_strength import FaultStrength
from line_journal import LineJournal

TRIALS, SHORT_TRIALS = 20, 1
PIECES, PIECE_S, SHORT_S = 12, 300.0, 60.0
SLIP_M, BUMP_M, TOOL_M, TURNED_RAD, WAY_M = 5e-3, 1e-3, 0.02, np.deg2rad(5.0), 5e-3
WATCHED_S, WITHIN_S, TICK_S = 4.0, 1.0, 0.05
KINDS = ("slip, free", "slip, loaded", "encoders, free", "encoders, loaded", "tracker", "tool")
ALARMS = (PoseAgreement.CANDIDATES, PoseAgreement.NAMED)


def suspects(answer):
    """What an answer names, as triples: kind, limb, other limb."""
    return list(zip(answer.suspect, answer.limb, answer.other_limb, strict=True))


def direction(rng):
    """A random unit vector."""
    vector = rng.normal(size=3)
    return vector / np.linalg.norm(vector)


def loaded(rig):
    """Load a rig and let its robot move on a path."""
    rig.load(np.r_[rng_load(rig.rng), 0.0, 0.0, 0.0])
    rig.arm.go()
    rig.run(rig.rng.uniform(1.0, 4.0))


def rng_load(rng):
    """A force in a random direction [N]."""
    return rng.uniform(20.0, 50.0) * direction(rng)


def strike(kind, rig):
    """Break a rig; the triple that is right, when data can tell it, and how it shows, if asked."""
    rng, n = rig.rng, rig.rig.plant.tension.size
    if kind.startswith(("slip", "encoders")):
        if kind.endswith("loaded"):
            loaded(rig)
        else:
            rig.follow()
            rig.run(rng.uniform(3.0, 8.0))
    if kind.startswith("slip"):
        limb = int(rng.integers(n))
        strength = FaultStrength(rig, limb=limb)
        rig.rig.plant.inject("cable_slip", limb, SLIP_M)
        return (PoseAgreement.SLIPPED_CABLE, limb, -1), lambda: strength.tells, strength
    if kind.startswith("encoders"):
        i, j = sorted(int(k) for k in rng.choice(n, 2, replace=False))
        rig.exchange_encoders(i, j)
        start = rig.wound
        moved = lambda: np.abs(rig.wound - start).max() >= WAY_M  # noqa: E731
        stopped = lambda: rig.rig.guard.fault is not None and rig.arm.standing  # noqa: E731
        return (PoseAgreement.SWAPPED_ENCODERS, i, j), lambda: moved() or stopped(), None
    if kind == "tracker":
        for reflector in range(3):
            rig.measure(reflector)
        rig.bump[:] = BUMP_M * direction(rng)
        rig.measure(int(rng.integers(3)))
        return (PoseAgreement.TRACKER, -1, -1), lambda: True, None
    rig.follow()
    strength = FaultStrength(rig, tool=rig.arm.tool)
    turned = lambda: rig.arm.moved()[1] >= TURNED_RAD  # noqa: E731
    return (PoseAgreement.ROBOT_TOOL, -1, -1), lambda: turned() and strength.tells, strength


def trial(kind, seed):
    """One fault; what became of it."""
    rng = np.random.default_rng([seed, *kind.encode()])
    tool = np.r_[TOOL_M * direction(rng), 0.0, 0.0, 0.0] if kind == "tool" else None
    rig = AgreementRig(int(rng.integers(2**31)), (0.04, 0.15 if kind == "tool" else 0.06), tool)
    rig.start()
    right, can_tell, strength = strike(kind, rig)
    before = len(rig.answers) - (1 if kind == "tracker" else 0)
    struck_s, told_s, named_s, wrong, missed, seen = rig.now_s, np.inf, None, 0, 0, before
    end_s = np.inf
    while rig.now_s < min(end_s, struck_s + 20.0):
        if not np.isfinite(told_s) and can_tell():
            told_s, end_s = rig.now_s, rig.now_s + WATCHED_S
        rig.cycle()
        if strength is not None:
            strength.look()
        for answer in rig.answers[seen:]:
            found = suspects(answer)
            missed += answer.state in ALARMS and right not in found
            if answer.state == PoseAgreement.NAMED:
                wrong += found != [right]
                named_s = rig.now_s if named_s is None and found == [right] else named_s
        seen = len(rig.answers)
        if named_s is not None and rig.now_s > named_s + 0.5:
            break
    fault = rig.rig.guard.fault
    numbers = [] if fault is None else re.findall(r"limbs? (\d+)", fault.reason)
    rig.close()
    return {
        "kind": kind,
        "seed": seed,
        "right": [int(k) for k in right],
        "told_s": float(told_s - struck_s) if np.isfinite(told_s) else None,
        "delay_s": None if named_s is None else float(named_s - min(told_s, named_s)),
        "wrong": int(wrong),
        "missed": int(missed),
        "squares": None if strength is None else strength.squares,
        "lost_n": None if strength is None else strength.lost,
        "moved_mm": None if strength is None else 1e3 * strength.moved,
        "bridge": "" if fault is None else str(fault.name),
        "bridge_names": any(int(number) - 1 in right[1:] for number in numbers),
    }


def healthy(seconds, seed):
    """A piece of the hour: answers, those with an alarm, and the fault that ended it, if any."""
    rig = AgreementRig(9000 + seed)
    rig.start()
    rng = rig.rng
    while rig.now_s < seconds and rig.rig.guard.fault is None:
        rig.follow()
        rig.run(rng.uniform(4.0, 10.0))
        rig.stand()
        rig.measure(int(rng.integers(3)))
        rig.load(np.r_[rng_load(rng), rng.uniform(-2.0, 2.0, 3)])
        rig.run(rng.uniform(0.5, 2.0))
        rig.measure(int(rng.integers(3)))
        rig.arm.go()
        rig.run(rng.uniform(4.0, 10.0))
        rig.unload()
        if rng.random() < 0.2:
            rig.rig.mode = OperatingMode.STOPPED
            rig.run(2.0)
            rig.tighten()
    alarms = [answer for answer in rig.answers if answer.state in ALARMS]
    fault = rig.rig.guard.fault
    rig.close()
    return {
        "kind": "healthy",
        "seed": seed,
        "seconds": float(rig.now_s),
        "answers": len(rig.answers),
        "judged": sum(answer.state == PoseAgreement.AGREE for answer in rig.answers),
        "readings": int(rig.newest.reflectors),
        "alarms": len(alarms),
        "first": alarms[0].reason if alarms else "",
        "bridge": "" if fault is None else f"{fault.name}: {fault.reason}",
    }


def table(rows):
    """Lines of the table, and whether anything is wrong."""
    lines = [
        f"{'fault':18}{'named':>10}{'by bridge':>11}{'untold':>8}{'not':>5}{'median':>9}"
        f"{'longest':>9}{'later':>7}{'wrong':>7}{'missed':>8}"
    ]
    failed = False
    for kind in KINDS:
        mine = [row for row in rows if row["kind"] == kind]
        delays = [row["delay_s"] for row in mine if row["delay_s"] is not None]
        nobody = [row for row in mine if row["delay_s"] is None]
        bridge = sum(row["bridge_names"] for row in nobody)
        untold = [row for row in nobody if row["told_s"] is None and not row["bridge_names"]]
        missing = len(nobody) - bridge - len(untold)
        late = sum(delay > WITHIN_S + TICK_S for delay in delays)
        wrong, missed = (sum(row[key] > 0 for row in mine) for key in ("wrong", "missed"))
        median, longest = (np.median(delays), max(delays)) if delays else (np.nan, np.nan)
        lines.append(
            f"{kind:18}{len(delays):>4} of {len(mine):>2}{bridge:>11}{len(untold):>8}{missing:>5}"
            f"{median:>7.2f} s{longest:>7.2f} s{late:>7}{wrong:>7}{missed:>8}"
        )
        failed = failed or bool(late or wrong or missing)
        lines.extend(
            f"  cannot be told, seed {row['seed']}: {row['lost_n']:.1f} N lost, platform off by "
            f"{row['moved_mm']:.2f} mm: squares {row['squares']:.0f} of the {ODD_WRENCH:.0f} that "
            "noise may show"
            for row in untold
        )
    mine = [row for row in rows if row["kind"] == "healthy"]
    seconds, answers, alarms, readings = (
        sum(row[key] for row in mine) for key in ("seconds", "answers", "alarms", "readings")
    )
    ended = sum(bool(row["bridge"]) for row in mine)
    lines.append(
        f"without a fault: {seconds:.0f} s, {answers} answers, {readings} readings of the tracker: "
        f"{alarms} false alarms; ended by the bridge: {ended} of {len(mine)}"
    )
    return lines, failed or alarms > 0 or ended > 0


def main() -> int:
    """Run what is missing, print the table; 1 where something is wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--short", action="store_true", help="a trial of each kind, a minute")
    parser.add_argument("--fresh", action="store_true", help="run all anew")
    parser.add_argument("--output", type=Path, default=Path("build/bench/pose_faults.json"))
    options = parser.parse_args()
    kept = LineJournal(options.output.with_suffix(".jsonl"), options.fresh)
    trials, pieces = (SHORT_TRIALS, 1) if options.short else (TRIALS, PIECES)
    seconds = SHORT_S if options.short else PIECE_S
    wanted = [(kind, seed) for seed in range(trials) for kind in KINDS]
    wanted += [("healthy", seed) for seed in range(pieces)]
    rclpy.init(args=["--ros-args", "-p", "robot:=true", "--log-level", "error"])
    rows = []
    for kind, seed in wanted:
        key = f"{kind} {seed}"
        row = kept.found.get(key)
        if row is None or row.get("seconds", seconds) < seconds:
            kept.add(key, **(healthy(seconds, seed) if kind == "healthy" else trial(kind, seed)))
        rows.append(kept.found[key])
    lines, failed = table(rows)
    print("\n".join(lines))
    write_figures(options.output, {"table": lines, "rows": rows})
    return int(failed)


if __name__ == "__main__":
    raise SystemExit(main())
