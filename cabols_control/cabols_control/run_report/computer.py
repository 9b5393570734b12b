# SPDX-License-Identifier: Apache-2.0
"""What of a run's late and lost cycles was this computer's doing; pure.

Bare timers beside the run sleep to the same instants and do nothing else. What they miss, nothing
that runs on this computer could have kept; what the control loop misses beyond that is its own.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from cabols_control.errors import CabolsError

NAN = float("nan")


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
    """What a timer missed in a window of time.

    Attributes:
        instants: of the window.
        late: woken for more than half a period late, or skipped.
        lost: skipped altogether.
        worst_s: how far behind it was at most [s].
    """

    instants: int
    late: int
    lost: int
    worst_s: float


def missed(record: TimerRecord, begin_ns: int, end_ns: int) -> Missed:
    """Count a timer's misses as the simulated card counts its own.

    Args:
        record: of the timer.
        begin_ns: of the window, system clock [ns].
        end_ns: likewise.

    Raises:
        TimerError: if the timer did not run during the whole window.
    """
    if not record.begin_ns <= begin_ns < end_ns <= record.end_ns:
        raise TimerError(
            f"timer: expected a record from {begin_ns} to {end_ns} ns, got one from "
            f"{record.begin_ns} to {record.end_ns} ns; was it ended early?"
        )
    behind = [late_ns for at, late_ns in record.misses if begin_ns <= at < end_ns]
    lost = sum(late_ns // record.period_ns for late_ns in behind)
    return Missed(
        instants=(end_ns - begin_ns) // record.period_ns,
        late=len(behind) + lost,
        lost=lost,
        worst_s=1e-9 * max(behind, default=0),
    )


def timer_numbers(timers: Iterable[Missed]) -> dict[str, Any]:
    """Return what timers missed as numbers for a run's summary, units in the keys.

    Args:
        timers: the bridge's core first. A cycle is late by a stall of the bridge's core alone, and
            lost by one of any core of the control path.
    """
    found = list(timers)
    if not found:
        return {
            "timer_late_percent": NAN,
            "timer_lost_percent": NAN,
            "timer_lost_cycles": NAN,
            "timer_behind_max_s": NAN,
        }
    first = found[0]
    lost = sum(timer.lost for timer in found)
    return {
        "timer_late_percent": 100.0 * first.late / first.instants,
        "timer_lost_percent": 100.0 * lost / first.instants,
        "timer_lost_cycles": lost,
        "timer_behind_max_s": max(timer.worst_s for timer in found),
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
repeat; or let the rig move in slow motion: make demo ARGS="--speed 0.3"{plain}"""
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
    )
