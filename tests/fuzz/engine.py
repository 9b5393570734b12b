# SPDX-License-Identifier: Apache-2.0
"""Feeds a target with inputs, and judges: other exceptions, changed values, hangs, memory."""

from __future__ import annotations

import ctypes
import gc
import json
import linecache
import signal
import time
import traceback
import warnings
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from mutator import Mutator

MEMORY_BYTES = 5 * 1024 * 1024
"""Most that a target may grow after it is warm."""
WARM = 5000
"""Inputs after which a target counts as warm, at most half of a run."""
FINDINGS = 20
"""Of one kind, kept on disk."""
PAGE = 4096


class SilentChangeError(AssertionError):
    """A value came out differently, and nothing was said."""


class HangError(BaseException):
    """An input took longer than its deadline; no parser's `except Exception` holds it."""


@dataclass(frozen=True)
class Target:
    """What is fuzzed.

    Attributes:
        name: of it.
        corpus: makes the good inputs.
        open: makes the function that takes an input and returns whether it was accepted; raises
            SilentChangeError where a value is wrong, an undocumented exception where the target
            does; called in the process that runs it.
        text: whether inputs are text.
        socket: whether inputs go through a socket or DDS.
        deadline_s: of one input.
    """

    name: str
    corpus: Callable[[], list[bytes]]
    open: Callable[[], Callable[[bytes], bool]]
    text: bool = False
    socket: bool = False
    deadline_s: float = 2.0


@dataclass
class Outcome:
    """What a target has shown so far.

    Attributes:
        seed: of the inputs.
        done: inputs so far.
        accepted: of them.
        seconds: that they took.
        slowest_s: longest input.
        grown_bytes: of memory, the most of any run after its warm-up.
        findings: number by kind.
    """

    seed: int
    done: int = 0
    accepted: int = 0
    seconds: float = 0.0
    slowest_s: float = 0.0
    grown_bytes: int = 0
    findings: dict[str, int] = field(default_factory=dict)


def resident_bytes() -> int:
    """Memory of this process, after what is free went back."""
    gc.collect()
    linecache.clearcache()  # of the tracebacks of findings
    ctypes.CDLL(None).malloc_trim(0)
    return PAGE * int(Path("/proc/self/statm").read_text().split()[1])


def load_outcome(folder: Path, seed: int) -> Outcome:
    """What an earlier run of the same seed has left; else a new one.

    Args:
        folder: of the target.
        seed: of the inputs.
    """
    try:
        found = Outcome(**json.loads((folder / "state.json").read_text("utf-8")))
    except (OSError, ValueError, TypeError):
        return Outcome(seed)
    return found if found.seed == seed else Outcome(seed)


def save_outcome(folder: Path, outcome: Outcome) -> None:
    """Keep it, complete or as before."""
    folder.mkdir(parents=True, exist_ok=True)
    draft = folder / "state.json.new"
    draft.write_text(json.dumps(asdict(outcome)), encoding="utf-8")
    draft.replace(folder / "state.json")


def note(folder: Path, outcome: Outcome, kind: str, number: int, data: bytes, text: str) -> None:
    """Count a finding, and keep its input.

    Args:
        folder: of the target.
        outcome: to add it to.
        kind: of the finding: one place in the code, as a rule.
        number: of the input.
        data: of the input.
        text: what happened.
    """
    count = outcome.findings[kind] = outcome.findings.get(kind, 0) + 1
    if count <= FINDINGS:
        place = folder / "findings"
        place.mkdir(parents=True, exist_ok=True)
        (place / f"{number}.input").write_bytes(data)
        (place / f"{number}.txt").write_text(f"{kind}\n\n{text}\n", encoding="utf-8")


def _alarm(*_: Any) -> None:
    raise HangError


def kind_of(error: BaseException) -> str:
    """A finding's kind: the exception and where it was raised."""
    frames = traceback.extract_tb(error.__traceback__)
    ours = [f for f in frames if "cabols" in f.filename] or frames[-1:]
    where = f" in {Path(ours[-1].filename).name}:{ours[-1].lineno}" if ours else ""
    said = f" ({str(error)[:60]})" if isinstance(error, SilentChangeError) else ""
    return f"{type(error).__name__}{where}{said}"


def run(
    target: Target,
    folder: Path,
    seed: int,
    until: int,
    seconds: float,
    progress: Callable[[int], None] = lambda _: None,
) -> Outcome:
    """Feed a target from where it was.

    Args:
        target: to feed.
        folder: its own; state and findings go there.
        seed: of the inputs.
        until: number of inputs after which it is done.
        seconds: it ends earlier then.
        progress: called with the number of each input before it.
    """
    outcome = load_outcome(folder, seed)
    mutator = Mutator(target.name, seed, target.corpus(), target.text)
    feed = target.open()
    begin = time.monotonic()
    signal.signal(signal.SIGALRM, _alarm)
    signal.signal(signal.SIGPROF, _alarm)
    first, ran = outcome.done, 0
    warm = min(WARM, max((until - first) // 2, 50))
    warm_bytes = 0
    while outcome.done < until and (ran == 0 or time.monotonic() - begin < seconds):
        number = outcome.done
        progress(number)
        data = mutator.make(number)
        _one(target, feed, folder, outcome, number, data)
        outcome.done += 1
        ran += 1
        if ran == warm:
            warm_bytes = resident_bytes()
        if ran % 5000 == 0:
            outcome.seconds += time.monotonic() - begin
            seconds -= time.monotonic() - begin
            begin = time.monotonic()
            save_outcome(folder, outcome)
            # Else what is free between pieces that are held counts as grown: 13 MiB after 100 000
            # bags, 3 with it given back.
            resident_bytes()
    outcome.seconds += time.monotonic() - begin
    grown = resident_bytes() - warm_bytes if warm_bytes else 0
    outcome.grown_bytes = max(outcome.grown_bytes, grown)
    if grown > MEMORY_BYTES:
        note(folder, outcome, "memory", outcome.done, b"", f"grew by {grown} bytes in {ran} inputs")
    save_outcome(folder, outcome)
    return outcome


def _one(
    target: Target,
    feed: Callable[[bytes], bool],
    folder: Path,
    outcome: Outcome,
    number: int,
    data: bytes,
) -> None:
    before = time.perf_counter()
    # A parser's deadline is of its own processor time: a busy machine is no hang.
    clock = signal.ITIMER_REAL if target.socket else signal.ITIMER_PROF
    try:
        signal.setitimer(clock, target.deadline_s)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            accepted = feed(data)
        signal.setitimer(clock, 0.0)
        outcome.accepted += accepted
    except HangError as error:
        text = "".join(traceback.format_exception(error))
        note(folder, outcome, f"hang beyond {target.deadline_s:g} s", number, data, text)
    except BaseException as error:
        signal.setitimer(clock, 0.0)
        if isinstance(error, KeyboardInterrupt):
            raise
        text = "".join(traceback.format_exception(error))
        note(folder, outcome, kind_of(error), number, data, text)
    outcome.slowest_s = max(outcome.slowest_s, time.perf_counter() - before)
