# SPDX-License-Identifier: Apache-2.0
"""What of a run's late and lost cycles was this computer's doing; pure.

Bare timers beside the run sleep to the same instants and do nothing else. What they miss, nothing
that runs on this computer could have kept; what the control loop misses beyond that is its own.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from cabols_control.errors import CabolsError

NAN = float("nan")
NEEDED_SHARE = 0.25
"""Share of a period that a loop may need to answer: twice the median round trip of our loop. A
pause that leaves it less loses the cycle, though a timer that does nothing skips no instant yet."""
TOGETHER_S = 0.005
"""All cores that stand still at once for this long [s] were not held up by what runs on them."""


class TimerError(CabolsError):
    """A timer's record cannot be used."""


@dataclass(frozen=True)
class TimerRecord:
    """What one bare timer missed.

    Attributes:
        period_ns: between its instants [ns].
        begin_ns: of its first instant, system clock [ns].
        end_ns: of its last instant [ns].
        misses: (instant [ns, system clock], behind [ns]) wherever it woke more than half a period
            late, in order of time.
    """

    period_ns: int
    begin_ns: int
    end_ns: int
    misses: Sequence[tuple[int, int]]

    @classmethod
    def from_mapping(cls, content: Mapping[str, Any]) -> TimerRecord:
        """Read what the timer's process wrote.

        Raises:
            TimerError: if it is not that.
        """
        try:
            misses = [(int(at), int(behind)) for at, behind in content["misses"]]
            period_ns, begin_ns, end_ns = (
                int(content[name]) for name in ("period_ns", "begin_ns", "end_ns")
            )
        except (KeyError, TypeError, ValueError) as error:
            raise TimerError(f"timer: expected its record, got {error!r}; run it again") from error
        return cls(period_ns=period_ns, begin_ns=begin_ns, end_ns=end_ns, misses=misses)


@dataclass(frozen=True)
class Missed:
    """What timers missed in a window of time.

    Attributes:
        instants: of the window.
        late: of the first timer: woken for more than half a period late, or skipped.
        lost: that a loop beside them cannot have kept: less than NEEDED_SHARE of the period was
            left, or nothing. A time that several timers stood still counts once.
        worst_s: how far behind one of them was at most [s].
        together_s: for how long all of them stood still at once, at most [s]; 0 for one timer.
    """

    instants: int
    late: int
    lost: int
    worst_s: float
    together_s: float = 0.0


def missed(records: Sequence[TimerRecord], begin_ns: int, end_ns: int) -> Missed:
    """Count timers' misses as the simulated card counts its own.

    Args:
        records: of one timer or more, of one period, the bridge's core first. A cycle is late by a
            stall of the bridge's core alone, and lost by one of any core of the control path.
        begin_ns: of the window, system clock [ns].
        end_ns: likewise.

    Raises:
        TimerError: if there is no timer, or one did not run during the whole window.
    """
    if not records:
        raise TimerError("timers: expected at least one record, got none; did they fail to start?")
    for record in records:
        if not record.begin_ns <= begin_ns < end_ns <= record.end_ns:
            raise TimerError(
                f"timer: expected a record from {begin_ns} to {end_ns} ns, got one from "
                f"{record.begin_ns} to {record.end_ns} ns; was it ended early?"
            )
    period_ns = records[0].period_ns
    pauses = [_pauses(record, begin_ns, end_ns) for record in records]
    needed_ns = round(NEEDED_SHARE * period_ns)
    alone = [end - begin for begin, end in pauses[0]]
    spans = list(_overlaps(pauses))
    return Missed(
        instants=(end_ns - begin_ns) // period_ns,
        late=len(alone) + sum(length // period_ns for length in alone),
        lost=sum((length + needed_ns) // period_ns for length in _lengths(spans, 1)),
        worst_s=1e-9 * max((end - begin for each in pauses for begin, end in each), default=0),
        together_s=1e-9 * max(_lengths(spans, len(records)), default=0) if records[1:] else 0.0,
    )


def _pauses(record: TimerRecord, begin_ns: int, end_ns: int) -> list[tuple[int, int]]:
    """Return begin and end of each of a timer's pauses that begin in a window [ns]."""
    return [(at, at + behind) for at, behind in record.misses if begin_ns <= at < end_ns]


def _overlaps(pauses: Sequence[Sequence[tuple[int, int]]]) -> Iterator[tuple[int, int, int]]:
    """Yield (begin [ns], end [ns], timers that stand still) in order of time, without gaps."""
    edges = sorted(
        edge for each in pauses for begin, end in each for edge in ((begin, 1), (end, -1))
    )
    still = 0
    for (begin, change), (end, _) in pairwise(edges):
        still += change
        if end > begin:
            yield begin, end, still


def _lengths(spans: Sequence[tuple[int, int, int]], least: int) -> Iterator[int]:
    """Yield the lengths of the times in which at least some number of timers stood still [ns]."""
    length = 0
    for begin, end, still in spans:
        if still >= least:
            length += end - begin
        elif length:
            yield length
            length = 0
    if length:
        yield length


def timer_numbers(found: Missed | None) -> dict[str, Any]:
    """Return what timers missed as numbers for a run's summary, units in the keys.

    Args:
        found: in the window of the run; None: not known, then nothing is excused.
    """
    if found is None:
        return {
            "timer_late_percent": NAN,
            "timer_lost_percent": NAN,
            "timer_lost_cycles": NAN,
            "timer_behind_max_s": NAN,
            "timers_together_max_s": NAN,
        }
    return {
        "timer_late_percent": 100.0 * found.late / found.instants,
        "timer_lost_percent": 100.0 * found.lost / found.instants,
        "timer_lost_cycles": found.lost,
        "timer_behind_max_s": found.worst_s,
        "timers_together_max_s": found.together_s,
    }


def is_computers(measured: float | None, limit: float, timer: float | None) -> bool:
    """Whether a figure that is not met is so only by what bare timers missed, too.

    Args:
        measured: beyond its limit.
        limit: largest allowed value.
        timer: what the timers missed; None or NaN: not measured, then nothing is excused.
    """
    if measured is None or timer is None:
        return False
    return bool(measured - timer <= limit)


ADVICE = """\
This computer was too busy, not the software too slow: bare timers beside the demo, which do
nothing else, were late at {late:.2f} % of their instants and missed {lost:.3f} %, by up to
{worst:.1f} ms. For better figures close what else runs (browsers, builds, other containers) and
repeat; or let the rig move in slow motion: make demo ARGS="--speed 0.3"{plain}{together}"""
TOGETHER = """
All cores stood still at once, for up to {ms:.1f} ms: no process here does that, but the host of a
virtual machine does, or a container's limit on processor time. More cores, or none of the limit,
help."""
PLAIN = """; or ask the kernel for
nothing: make demo ARGS="--plain\""""


def advice(summary: Mapping[str, Any], asked: bool) -> str:
    """Say what to do about a computer that misses its instants.

    Args:
        summary: with timer_numbers.
        asked: whether the demo requested real-time scheduling from the kernel.
    """
    return ADVICE.format(
        late=summary["timer_late_percent"],
        lost=summary["timer_lost_percent"],
        worst=1e3 * summary["timer_behind_max_s"],
        plain=PLAIN if asked else "",
        together=together(summary["timers_together_max_s"]),
    )


def together(longest_s: float) -> str:
    """Say what it means that all cores stood still at once; empty if they did not.

    Args:
        longest_s: for how long, at most [s].
    """
    return TOGETHER.format(ms=1e3 * longest_s) if longest_s >= TOGETHER_S else ""
