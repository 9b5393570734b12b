# SPDX-License-Identifier: Apache-2.0
"""Every order in which presses, modes, reports, resets and a supervisor's restart can meet.

Stops, modes and reports travel apart, so that any may come first; modes keep the newest only, so
that any but the last may never be seen. All states that two nodes, a supervisor that is killed once
and a person can reach are visited. Two things hold: nothing lets a node go but a reset that came
after its press was latched, and after one reset with all known nothing is latched again.
"""

from __future__ import annotations

from collections import deque
from copy import copy

import pytest

from cabols_control.supervision.modes import Cause, ModeMachine, OperatingMode
from cabols_control.supervision.stops import SLOTS, HeldStops, LatchedStops

KILLS, RESETS = 1, 2
WAITING_REPORTS = 1


def clone(stops):
    """Copy of a keeper of numbers."""
    made = copy(stops)
    for name, value in vars(stops).items():
        if isinstance(value, dict):
            setattr(made, name, dict(value))
    return made


class Node:
    """One that drives something: two inputs, one output."""

    def __init__(self):
        self.stops = HeldStops()
        self.session = 1
        self.mode = None  # the newest one that waits
        self.reports = []  # sent, not arrived

    def clone(self):
        made = copy(self)
        made.stops, made.reports = clone(self.stops), list(self.reports)
        return made

    def key(self):
        held, heard = tuple(self.stops._held), tuple(sorted(self.stops._heard))
        return held, heard, self.session, self.mode, tuple(self.reports)


class World:
    """The rig as far as stops go."""

    def __init__(self, latched_class, nodes=2, presses=1):
        self.make, self.presses = latched_class, presses
        self.nodes = [Node() for _ in range(nodes)]
        self.session, self.alive = 1, True
        self.register, self.machine = latched_class(), ModeMachine()
        self.pressed = self.kills = self.resets = 0
        self.travel = set()  # (number, receiver); a repetition is this pair once more
        self.arrived = set()
        self.lifted = set()  # by a person's reset

    def clone(self):
        made = copy(self)
        made.nodes = [node.clone() for node in self.nodes]
        made.register, made.machine = clone(self.register), copy(self.machine)
        for name in ("travel", "arrived", "lifted"):
            setattr(made, name, set(getattr(self, name)))
        return made

    def key(self):
        register = self.register
        return (
            tuple(node.key() for node in self.nodes),
            (self.session, self.alive, self.machine.mode, self.machine.entry.cause),
            (tuple(register._latched), tuple(register._lifted)),
            (self.pressed, self.kills, self.resets),
            frozenset(self.travel),
            frozenset(self.arrived),
            frozenset(self.lifted),
        )

    def moves(self):
        """Names of what can happen next."""
        if self.pressed < self.presses:
            yield ("press",)
        for number, receiver in sorted(self.travel):
            if receiver < len(self.nodes) or self.alive:
                yield ("stop", number, receiver)
        for k, node in enumerate(self.nodes):
            if node.mode is not None:
                yield ("mode", k)
            if node.reports and self.alive:
                yield ("report", k)
            if len(node.reports) < WAITING_REPORTS:
                yield ("tell", k)
        if self.alive:
            yield ("repeat",)
            if self.resets < RESETS and self.machine.mode == OperatingMode.FAULT:
                yield ("reset",)
            if self.kills < KILLS:
                yield ("kill",)
        else:
            yield ("start",)

    def do(self, move):
        kind, *rest = move
        getattr(self, f"_{kind}")(*rest)

    def _press(self):
        self.pressed += 1
        self.travel |= {(self.pressed, receiver) for receiver in range(len(self.nodes) + 1)}

    def _stop(self, number, receiver):
        self.travel.discard((number, receiver))
        self.arrived.add((number, receiver))
        if receiver < len(self.nodes):
            self.nodes[receiver].stops.press(number)
        else:
            self._latch(number)

    def _latch(self, number):
        if self.register.latch(number):
            self.machine.emergency("stop")
            self._repeat()

    def _repeat(self):
        for node in self.nodes:
            node.mode = (self.session, self.machine.mode, self.register.lifted)

    def _mode(self, k):
        node = self.nodes[k]
        (session, _, lifted), node.mode = node.mode, None
        # Whether the old session is silent long enough is not asked: it may be, at any time.
        if session >= node.session:
            node.session = session
            node.stops.lift(lifted)

    def _tell(self, k):
        node = self.nodes[k]
        node.reports.append(node.stops.number)

    def _report(self, k):
        number = self.nodes[k].reports.pop(0)
        if number:
            self._latch(number)

    def _reset(self):
        self.resets += 1
        self.lifted |= set(self.register._latched)
        self.machine.reset()
        self.register.reset()
        self._repeat()

    def _kill(self):
        self.kills, self.alive = self.kills + 1, False

    def _start(self):
        self.alive, self.session = True, self.session + 1
        self.register, self.machine = self.make(), ModeMachine()
        self._repeat()

    def wrong(self):
        """What must never be, in any order."""
        for k, node in enumerate(self.nodes):
            came = {number for number, receiver in self.arrived if receiver == k}
            if not came - self.lifted <= set(node.stops._held):
                return f"node {k + 1} lost a press"
        latched = set(self.register._latched)
        if self.alive and latched and self.machine.entry.cause != Cause.EMERGENCY_STOP:
            return "latched, but not in FAULT"
        return ""

    def settle(self):
        """Let all that is under way arrive, and all be told and repeated again and again."""
        if not self.alive:
            self._start()
        for _ in range(4):
            for move in [("stop", *pair) for pair in sorted(self.travel)]:
                self.do(move)
            self._repeat()
            for k, node in enumerate(self.nodes):
                if node.mode is not None:
                    self._mode(k)
                self._tell(k)
                while node.reports:
                    self._report(k)

    def known(self):
        """Whether the supervisor knows each press that holds a node, or is under way."""
        register = self.register
        mine = {*register._latched, *register._lifted}
        under_way = {number for number, _ in self.travel}
        held = {number for node in self.nodes for number in node.stops._held}
        told = {number for node in self.nodes for number in node.reports if number}
        return (under_way | held | told) <= mine


def explore(latched_class=LatchedStops, **size):
    """Visit every state; return the first thing that is wrong, and how many were visited."""
    first = World(latched_class, **size)
    seen, queue = {first.key()}, deque([first])
    resets = 0
    while queue:
        world = queue.popleft()
        if trouble := world.wrong():
            return trouble, len(seen)
        in_fault = world.alive and world.machine.mode == OperatingMode.FAULT
        if in_fault and world.known():
            resets += 1
            after = world.clone()
            after._reset()
            after.settle()
            held = [node.stops.number for node in after.nodes]
            if after.machine.mode == OperatingMode.FAULT or any(held):
                return f"one reset does not lift it: {world.key()}", len(seen)
        for move in world.moves():
            following = world.clone()
            following.do(move)
            key = following.key()
            if key not in seen:
                seen.add(key)
                queue.append(following)
    assert resets
    return "", len(seen)


class Forgetful(LatchedStops):
    """Planted: latches a report from before its reset again."""

    def latch(self, number):
        self._lifted.pop(number, None)
        return super().latch(number)


class Generous(LatchedStops):
    """Planted: lifts what nobody has reset."""

    @property
    def lifted(self):
        return (0,) * (SLOTS - 2) + (1, 2)


@pytest.mark.parametrize(("nodes", "presses"), [(2, 1), (1, 2)])
def test_no_order_loses_a_stop_or_asks_for_a_second_reset(nodes, presses):
    trouble, visited = explore(nodes=nodes, presses=presses)
    assert trouble == ""
    assert visited > 1000


@pytest.mark.parametrize("planted", [Forgetful, Generous])
def test_planted_mistakes_are_found(planted):
    assert explore(planted)[0]


def test_many_presses_are_lifted_by_one_reset():
    """More than a mode names: those that are still reported come first."""
    world = World(LatchedStops)
    for number in range(1, 5 * SLOTS):
        for receiver in range(3):
            world._stop(number, receiver)
    world._reset()
    for _ in range(5 * SLOTS):
        world.settle()
    assert world.machine.mode == OperatingMode.STOPPED
    assert not any(node.stops.number for node in world.nodes)


def test_flood_of_presses_stays_bounded_and_holds():
    held, latched = HeldStops(), LatchedStops()
    for number in range(1, 5000):
        assert held.press(number)
        assert latched.latch(number)
        latched.reset()
    assert max(len(held._held), len(held._heard), len(latched._lifted)) <= 256
    assert held.number
