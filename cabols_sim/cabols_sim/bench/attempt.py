# SPDX-License-Identifier: Apache-2.0
"""One run of the demo's session: what failed, and whether a stall of the computer may be why."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from cabols_control.run_report.judgement.computer import missed, together
from cabols_sim.bench.bare_timer import Timers

BAG, LOG = "bag", "log"
STALL_NS = 30_000_000
"""A stall of this computer that may end a session [ns]: the robot moves by 2 mm meanwhile, which is
10 N in a cable, and watchdogs of devices' own are shorter than the demo's."""


@dataclass(frozen=True)
class Attempt:
    """How one run of the session ended.

    Attributes:
        failure: what failed; empty if nothing.
        interrupted: ended by Ctrl-C.
        timers: that ran beside it.
    """

    failure: str
    interrupted: bool
    timers: Timers

    @property
    def stalled(self) -> bool:
        """Whether this computer stood still for long enough to be the reason."""
        return self._stall_ns >= STALL_NS

    @property
    def why(self) -> str:
        """What failed, and for how long this computer stood still, if that matters."""
        if not self.stalled:
            return self.failure
        return (
            f"{self.failure}; this computer stood still for up to {1e-6 * self._stall_ns:.0f} ms, "
            "which may be why: close what else runs, or try --speed 0.3"
            f"{together(self._together_s)}"
        )

    @property
    def _stall_ns(self) -> int:
        """For how long this computer stood still at most [ns]."""
        misses = (behind for record in self.timers.records for _, behind in record.misses)
        return max(misses, default=0)

    @property
    def _together_s(self) -> float:
        """For how long all of its cores stood still at once, at most [s]."""
        records = self.timers.records
        begin = max((record.begin_ns for record in records), default=0)
        end = min((record.end_ns for record in records), default=0)
        return missed(records, begin, end).together_s if begin < end else 0.0


def put_aside(output: Path, number: int) -> None:
    """Keep bag and logs of a run that failed, under other names.

    Args:
        output: the demo's folder.
        number: of the run, from 1.
    """
    for name in (BAG, LOG):
        if (output / name).exists():
            (output / name).rename(output / f"{name}_failed_{number}")
            print(f"  kept: {output / f'{name}_failed_{number}'}")
