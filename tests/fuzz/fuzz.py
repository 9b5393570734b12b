# SPDX-License-Identifier: Apache-2.0
"""Fuzz every parser and socket: `make fuzz` (ten minutes), `make fuzz ARGS="--minutes 1"`.

Inputs follow from seed, target and number; state lies in build/fuzz/<target>, so that the next call
goes on until each parser has had 100 000 inputs and each socket 10 000. What is wrong is kept there
with its input: an exception that is not documented, a value that changed and nothing was said, an
input that takes longer than its deadline, a process that ends, memory that grows.
"""

from __future__ import annotations

import argparse
import atexit
import multiprocessing
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent / "harness")]
os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Memory that is free goes back to the kernel, so that what stays is what somebody holds.
os.environ.update(MALLOC_ARENA_MAX="1", MALLOC_MMAP_THRESHOLD_="65536")

from engine import Outcome, Target, load_outcome, note, run, save_outcome  # noqa: E402

OUTPUT = Path("build") / "fuzz"
PARSER_INPUTS, SOCKET_INPUTS = 100_000, 10_000
STUCK_S = 100.0
"""A process that makes no progress for so long is killed, and the input is a finding."""
START_S = 400.0
SHORT_SHARE = 0.1
"""Share of the full form's inputs that a run of one minute aims at."""


def all_targets() -> dict[str, Target]:
    """Targets by name."""
    import binary_targets
    import socket_targets
    import text_targets

    every = (*text_targets.TARGETS, *binary_targets.TARGETS, *socket_targets.TARGETS)
    return {target.name: target for target in every}


def _child(name: str, folder: str, seed: int, until: int, seconds: float, at: Any) -> None:
    """Run one target; what C libraries print goes into its log."""
    place = Path(folder)
    place.mkdir(parents=True, exist_ok=True)
    log = os.open(place / "log.txt", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(log, 1)
    os.dup2(log, 2)

    def progress(number: int) -> None:
        at.value = number

    run(all_targets()[name], place, seed, until, seconds, progress)
    sys.stdout.flush()
    atexit._run_exitfuncs()
    # Threads of servers and of DDS must not hold the process.
    os._exit(0)


def watch(target: Target, folder: Path, seed: int, until: int, seconds: float) -> Outcome:
    """Run a target in a process of its own, again behind an input that ends or blocks it.

    Args:
        target: to run.
        folder: its own.
        seed: of the inputs.
        until: number of inputs.
        seconds: for all.
    """
    give_up = time.monotonic() + seconds
    context = multiprocessing.get_context("spawn")
    while True:
        at = context.Value("q", -1)
        left = max(give_up - time.monotonic(), 1.0)
        arguments = (target.name, str(folder), seed, until, left, at)
        child = context.Process(target=_child, args=arguments)
        child.start()
        seen, since = -1, time.monotonic()
        while child.is_alive():
            child.join(0.2)
            if at.value != seen:
                seen, since = at.value, time.monotonic()
            if time.monotonic() - since > (START_S if seen < 0 else STUCK_S):
                child.kill()
        if child.exitcode == 0 or seen < 0:
            break
        outcome = load_outcome(folder, seed)
        note(folder, outcome, f"process ended with {child.exitcode}", seen, b"", "see log.txt")
        outcome.done = seen + 1
        save_outcome(folder, outcome)
        if time.monotonic() > give_up:
            break
    outcome = load_outcome(folder, seed)
    if seen < 0:
        note(folder, outcome, "target did not start", 0, b"", "see log.txt")
        save_outcome(folder, outcome)
    return outcome


def row(target: Target, outcome: Outcome, goal: int) -> str:
    """One line of the table.

    Args:
        target: of the line.
        outcome: so far.
        goal: number of inputs that it is to have.
    """
    rate = outcome.done / outcome.seconds if outcome.seconds else 0.0
    wrong = sum(outcome.findings.values())
    verdict = "ok" if not wrong else f"WRONG: {wrong}"
    if outcome.done < goal:
        verdict += ", to be continued"
    return (
        f"{target.name:15s} {'socket' if target.socket else 'parser'} {outcome.done:7d} "
        f"{outcome.accepted:8d} {rate:8.0f} {1e3 * outcome.slowest_s:8.1f} "
        f"{outcome.grown_bytes / 2**20:6.1f}  {verdict}"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; 0 if nothing is wrong, 1 else."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0, help="of this call")
    parser.add_argument("--seed", type=int, default=1, help="of the inputs")
    parser.add_argument("--fresh", action="store_true", help="forget what earlier calls did")
    parser.add_argument("--targets", nargs="*", default=[], help="some of them, by name")
    parser.add_argument("--processes", type=int, default=min(os.cpu_count() or 1, 4))
    options = parser.parse_args(arguments)
    known = all_targets()
    unknown = set(options.targets) - set(known)
    if unknown:
        parser.error(f"expected targets of {', '.join(known)}, got {', '.join(sorted(unknown))}")
    if options.fresh:
        shutil.rmtree(OUTPUT, ignore_errors=True)
    os.environ["XDG_STATE_HOME"] = tempfile.mkdtemp(prefix="cabols_state_")
    chosen = [known[name] for name in (options.targets or known)]
    share = 1.0 if options.minutes > 1.0 else SHORT_SHARE
    goals = {t.name: SOCKET_INPUTS if t.socket else PARSER_INPUTS for t in chosen}
    folder = OUTPUT / f"seed_{options.seed}"
    give_up = time.monotonic() + 60.0 * options.minutes
    # What is behind comes first, so that each call brings all of them forward.
    waiting = sorted(
        chosen, key=lambda t: load_outcome(folder / t.name, options.seed).done / goals[t.name]
    )
    left = len(waiting)

    def one(target: Target) -> Outcome:
        nonlocal left
        budget = (give_up - time.monotonic()) * options.processes / max(left, 1)
        left -= 1
        place = folder / target.name
        goal = max(int(share * goals[target.name]), 1)
        before = load_outcome(place, options.seed)
        if before.done >= goal:
            return before
        # Some are done early: what they leave is for the later ones.
        return watch(target, place, options.seed, goal, max(budget, 2.0))

    print("target          kind    inputs accepted  per second  slowest ms  grown MiB  verdict")
    wrong = behind = 0
    with ThreadPoolExecutor(options.processes) as pool:
        for target, outcome in zip(waiting, pool.map(one, waiting), strict=True):
            print(row(target, outcome, goals[target.name]), flush=True)
            wrong += sum(outcome.findings.values())
            behind += outcome.done < goals[target.name]
            for kind, count in outcome.findings.items():
                print(f"    {count} of: {kind}; inputs in {folder / target.name / 'findings'}")
    print(f"{wrong} wrong; {behind} of {len(chosen)} targets to be continued by the next call")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
