# SPDX-License-Identifier: Apache-2.0
"""The flowchart of figure 4.5, as a generator that yields requests and receives the replies.

It has no clock, topic or file. Its driver carries out each request; an abort is the generator's
close(), after which the driver unloads. Started with the loads that an earlier run
has finished, it continues after them: with a motion, new zeros and a new unloaded reference, as
everything else may have changed, and through the stops of a way that lead to a pending one, as a
hysteretic robot remembers them.
"""

from __future__ import annotations

from collections.abc import Collection, Generator
from itertools import groupby
from typing import TypeAlias

from cabols_stiffness.campaign.plan import CampaignPlan, Point
from cabols_stiffness.campaign.requests import (
    Apply,
    BeginLoading,
    Finish,
    LoadKey,
    Measure,
    Move,
    Pretighten,
    Reply,
    Request,
    Rest,
    Tell,
)
from cabols_stiffness.measurements.samples import REFERENCE

Steps: TypeAlias = Generator[Request, Reply, None]
Answer: TypeAlias = Generator[Request, Reply, Reply]


class Flow:
    """One campaign, from its present state to its end.

    Attributes:
        finished: loads that were measured, in this run or before.
        skipped: loads given up in this run.
        enough: whether the requested accuracy was reached.
    """

    def __init__(
        self, plan: CampaignPlan, rest_tension: float, finished: Collection[LoadKey] = ()
    ) -> None:
        """Plan.

        Args:
            plan: what to do.
            rest_tension: of an unloaded limb [N].
            finished: loads of earlier runs.
        """
        self._plan = plan
        self._stops = plan.stops(rest_tension)
        self.finished = set(finished)
        self.skipped: set[LoadKey] = set()
        self.enough = False

    def steps(self) -> Steps:
        """Yield every request in turn; send() the reply to each."""
        for configuration, trajectory in self._stops:
            if self.enough and not self._plan.is_validation(configuration):
                continue
            yield from self._configuration(configuration, trajectory)
        yield Finish()

    def _pending(self, configuration: int, reflector: int, trajectory: list[Point]) -> list[Point]:
        """Return the stops neither measured nor given up; none if only references are left."""
        found = [
            point
            for point in trajectory
            if LoadKey(configuration, reflector, point.load) not in self.finished | self.skipped
        ]
        return found if any(point.branch != REFERENCE for point in found) else []

    def _configuration(self, configuration: int, trajectory: list[Point]) -> Steps:
        reflectors = [
            number
            for number in self._plan.reflectors
            if self._pending(configuration, number, trajectory)
        ]
        if not reflectors:
            return
        keys = tuple(
            LoadKey(configuration, number, point.load)
            for number in reflectors
            for point in self._pending(configuration, number, trajectory)
        )
        for attempt in range(self._plan.retries + 1):
            reply = yield from self._prepare(configuration)
            if reply.ok:
                break
            last = attempt == self._plan.retries
            yield Tell("skipped" if last else "retried", keys, reply.reason)
        else:
            self.skipped.update(keys)
            return
        for number in reflectors:
            yield from _Pass(self, self._plan, configuration, number, trajectory).steps()
            if self.enough and not self._plan.is_validation(configuration):
                return

    def _prepare(self, configuration: int) -> Answer:
        reply = Reply()
        for request in (
            Move(configuration),
            Pretighten(configuration),
            BeginLoading(configuration),
        ):
            reply = yield request
            if reply.pause and reply.ok:
                reply = yield Rest()
            if not reply.ok:
                return reply
        return reply


class _Pass:
    """One reflector at one configuration: the trajectory once."""

    def __init__(
        self,
        flow: Flow,
        plan: CampaignPlan,
        configuration: int,
        reflector: int,
        trajectory: list[Point],
    ) -> None:
        self._flow = flow
        self._plan = plan
        self._where = (configuration, reflector)
        self._legs = [list(leg) for _, leg in groupby(trajectory, key=lambda point: point.leg)]
        self._referenced = False
        self._loads_since = False

    def _key(self, point: Point) -> LoadKey:
        return LoadKey(*self._where, point.load)

    def _open(self, leg: list[Point]) -> list[Point]:
        closed = self._flow.finished | self._flow.skipped
        return [point for point in leg if self._key(point) not in closed]

    def steps(self) -> Steps:
        """Every way with something left to measure, between references."""
        reference = self._legs[0][0]
        for leg in self._legs:
            if self._done:
                return
            if leg[0].branch == REFERENCE:
                # An interrupted run measured a reference, but the loads of this run need their own.
                if self._open(leg) or self._loads_since:
                    yield from self._measure_reference(leg[0])
                continue
            while self._open(leg) and not self._done:
                if not self._referenced:
                    yield from self._measure_reference(reference)
                yield from self._way(leg)

    @property
    def _done(self) -> bool:
        return self._flow.enough and not self._plan.is_validation(self._where[0])

    def _measure_reference(self, point: Point) -> Steps:
        reply = yield Apply(self._key(point), point)
        if reply.ok:
            reply = yield from self._measure(point)
        if not reply.ok:
            # Loads are useful without it: their offset is estimated with the stiffness.
            yield from self._skip([point], reply.reason)
        self._referenced, self._loads_since = True, False
        if reply.pause:
            yield from self._pause()

    def _way(self, leg: list[Point]) -> Steps:
        """Go up and down as far as loads are left; ends early for a pause."""
        last = max(leg.index(point) for point in self._open(leg))
        for number, point in enumerate(leg[: last + 1]):
            reply = yield from self._stand(point)
            if not reply.ok:
                lost = [p for p in self._open(leg) if leg.index(p) >= number]
                yield from self._skip(lost, reply.reason)
                return
            if point in self._open(leg):
                reply = yield from self._measure(point)
                self._loads_since = self._loads_since or reply.ok
                if not reply.ok:
                    yield from self._skip([point], reply.reason)
            if reply.pause:
                yield from self._pause()
                return
            if self._done:
                return

    def _stand(self, point: Point) -> Answer:
        """Apply a load; repeat if it does not settle."""
        for attempt in range(self._plan.retries + 1):
            reply = yield Apply(self._key(point), point)
            if reply.ok or reply.hopeless or attempt == self._plan.retries:
                return reply
            yield Tell("retried", (self._key(point),), reply.reason)
        raise AssertionError("unreachable: the last attempt returns")

    def _measure(self, point: Point) -> Answer:
        key = self._key(point)
        for attempt in range(self._plan.retries + 1):
            reply = yield Measure(key, point, attempt)
            self._flow.enough = self._flow.enough or reply.enough
            if reply.ok:
                self._flow.finished.add(key)
                return reply
            if attempt == self._plan.retries:
                return reply
            yield Tell("retried", (key,), reply.reason)
        raise AssertionError("unreachable: the last attempt returns")

    def _skip(self, points: list[Point], reason: str) -> Steps:
        keys = tuple(self._key(point) for point in points)
        self._flow.skipped.update(keys)
        yield Tell("skipped", keys, reason)

    def _pause(self) -> Steps:
        yield Rest()
        # A pause is long enough for drift.
        self._referenced = False
