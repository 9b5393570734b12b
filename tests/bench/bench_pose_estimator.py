# SPDX-License-Identifier: Apache-2.0
"""The pose estimator on an hour of a simulated rig's data, and on faults at random moments.

The data are those of tests/harness/pose_sources.py: springs that soften, a robot with an absolute
error that bends under the load, a tracker that is not where it is believed. In the hour the
platform goes and stands in turn, and the tracker measures a reflector at every stop. Printed:
alarms in the hour, where there should be none; and how soon each fault is named.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from record import write_figures

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "harness"))

from cabols_control.pose_agreement import Fault, State, Suspect
from pose_sources import PERIOD_S, Sources

HOUR_S, SHORT_S = 3600.0, 300.0
TRIALS, PATIENCE_S = 20, 3.0


def alarms(seconds, seed=11):
    """Steps, steps with an alarm, readings of the tracker, in so many seconds without a fault."""
    sources, steps, wrong, found = Sources(seed, tension=(40.0, 25.0)), 0, 0, None
    measured, reflector = -1, 0
    while sources.now < seconds:
        stop = int(sources.now // 14.0)
        if sources.standing() and stop != measured:
            measured, reflector = stop, (reflector + 1) % 3
            found = sources.measure(reflector)
        else:
            found = sources.step()
        steps += 1
        wrong += found.state in (State.CANDIDATES, State.NAMED)
    return steps, wrong, found.readings


def delays(kind, trials):
    """How soon a fault of a kind is named, and how often it was, and as another one."""
    times, wrong = [], 0
    for seed in range(trials):
        sources = Sources(100 + seed)
        sources.run(8.0 + seed % 7)
        limb = seed % 8
        if kind is Fault.SLIPPED_CABLE:
            sources.slip[limb], right = 5e-3, Suspect(kind, (limb,))
        else:
            pair = (limb % 7, 7)
            sources.order[list(pair)] = pair[::-1]
            right = Suspect(kind, pair)
        began = sources.now
        while sources.now < began + PATIENCE_S:
            named = sources.step().agreement.named
            if named is not None:
                wrong += named != right
                if named == right:
                    times.append(sources.now - began)
                break
    return times, wrong


def main() -> int:
    """Run and print; 1 where there was a false alarm or a wrong name."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--short", action="store_true", help="five minutes of data, 5 trials")
    parser.add_argument("--output", type=Path, default=Path("build/bench/pose_estimator.json"))
    options = parser.parse_args()
    options.output.parent.mkdir(parents=True, exist_ok=True)
    seconds, trials = (SHORT_S, 5) if options.short else (HOUR_S, TRIALS)
    steps, wrong, readings = alarms(seconds)
    print(
        f"{seconds:.0f} s of data, a sample each {1e3 * PERIOD_S:.0f} ms, {readings} readings: "
        f"{wrong} of {steps} answers with a false alarm"
    )
    figures = {"seconds": seconds, "answers": steps, "readings": readings, "false_alarms": wrong}
    failed = wrong
    for kind in (Fault.SLIPPED_CABLE, Fault.SWAPPED_ENCODERS):
        times, named_wrong = delays(kind, trials)
        median = float(np.median(times)) if times else float("nan")
        longest = max(times, default=float("nan"))
        print(
            f"{kind.value}: {len(times)} of {trials} named within {PATIENCE_S:g} s, "
            f"{named_wrong} as another; median {median:.2f} s, longest {longest:.2f} s"
        )
        figures[kind.value] = {"named": len(times), "wrong": named_wrong, "median_s": median}
        failed += named_wrong
    write_figures(options.output, figures)
    return int(failed > 0)


if __name__ == "__main__":
    raise SystemExit(main())
