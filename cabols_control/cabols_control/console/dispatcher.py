# SPDX-License-Identifier: Apache-2.0
"""What all pages of one console share: newest values, the page in command, the rig's services."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from cabols_control.console.access import Lease
from cabols_control.console.latest import FAULT, INFO, NOTICE, WARNING, LatestValues
from cabols_control.naming import configuration_name, limb_name, reflector_name
from cabols_control.supervision.modes import OperatingMode

ALIVE_S = 2.0
"""Longest silence of a page, which answers twice a second, until it counts as lost [s]."""
FORGET_S = 120.0
FREE_FOR_ALL = ("emergency_stop",)
"""What a page that is not in command may do."""


@dataclass(frozen=True)
class Answer:
    """Answer of a service, or to an action's start.

    Attributes:
        success: whether it was granted.
        message: what was done, or why not.
        response: the service's response, where there is more to it.
    """

    success: bool
    message: str
    response: Any = None


class Rig(Protocol):
    """Services and actions of the rig, as any ROS client could call them."""

    async def call(self, service: str, fields: dict[str, Any]) -> Answer:
        """Call a service and wait for its answer, or for the end of the caller's patience.

        Args:
            service: its name, without the rig's namespace.
            fields: of the request, by name; the others keep their defaults.
        """

    async def start(self, action: str, fields: dict[str, Any]) -> Answer:
        """Send an action's goal; the answer says whether it was accepted, not how it ended.

        Args:
            action: its name, without the rig's namespace.
            fields: of the goal, by name; the others keep their defaults.
        """

    async def cancel(self, action: str) -> Answer:
        """Cancel an action that was started here."""


@dataclass
class Viewer:
    """One open page.

    Attributes:
        page: its id.
        session: its browser's id.
        name: shown to others.
        answered_s: time of its last answer, monotonic clock; a new page has ALIVE_S for its first.
        closed: whether its WebSocket has ended.
        tab: sent by the page when it opens its WebSocket; the same when it is loaded again.
        sent: number of the newest frame that was sent.
        acked: number of the newest frame that it has acknowledged.
    """

    page: str
    session: str
    name: str
    answered_s: float
    closed: bool = False
    tab: str = ""

    @property
    def identity(self) -> str:
        """Browser and tab that the page belongs to; the same after it was loaded again."""
        return f"{self.session} {self.tab}"

    sent: int = 0
    acked: int = 0


@dataclass(frozen=True)
class Settings:
    """Of one console.

    Attributes:
        title: shown in the header.
        uploads: folder of uploaded programmes.
        campaigns: folder of stiffness campaigns and their reports.
        configurations: number of the robot's stored configurations.
        scene: what the 3-D view draws, for the page's script.
        cables: number of limbs.
        rig: its name and its configuration's fingerprint, as in /diagnostics.
    """

    title: str
    uploads: Path
    campaigns: Path
    configurations: int
    scene: dict[str, Any]
    cables: int
    rig: str = ""


class Dispatcher:
    """Judges, carries out and logs the commands of all pages."""

    def __init__(self, rig: Rig, latest: LatestValues, settings: Settings) -> None:
        """Start without an operator."""
        self.rig = rig
        self.latest = latest
        self.settings = settings
        self.viewers: dict[str, Viewer] = {}
        self.lease = Lease(self.alive)
        self._clock: Callable[[], float] = time.monotonic
        self._opened = 0

    def alive(self, page: str) -> bool:
        """Whether a page answers."""
        viewer = self.viewers.get(page)
        if viewer is None or viewer.closed:
            return False
        return self._clock() - viewer.answered_s <= ALIVE_S

    def heard(self, viewer: Viewer) -> None:
        """Note a page's sign of life; a page that was loaded again stays in command."""
        viewer.answered_s, viewer.closed = self._clock(), False
        if viewer.tab:
            self.adopt(viewer)

    def lost(self, viewer: Viewer) -> None:
        """Note that a page's WebSocket has ended."""
        viewer.closed = True
        self.publish_operator()

    def open(self, page: str, session: str, address: str) -> Viewer:
        """Register a page; pages gone for longer than FORGET_S are dropped.

        Args:
            page: its id, another one each time it is loaded.
            session: id of its browser, the same in all of its tabs.
            address: of the browser, which others see in the page's name.
        """
        now = self._clock()
        for key in [k for k, v in self.viewers.items() if now - v.answered_s > FORGET_S]:
            del self.viewers[key]
        self._opened += 1
        viewer = Viewer(page, session, f"page {self._opened} ({address})", now)
        self.viewers[page] = viewer
        return viewer

    def take(self, page: str) -> Answer:
        """Give a page command, if it may have it."""
        viewer = self.viewers.get(page)
        if viewer is None:
            return Answer(False, "this page is not known any more: load it again")
        refusal = self.lease.take(page, viewer.identity, viewer.name)
        if refusal:
            return Answer(False, refusal)
        self._tell_operator(f"{viewer.name} has taken command")
        return Answer(True, "you are in command")

    def adopt(self, viewer: Viewer) -> None:
        """Give command to a page that replaces its browser's lost one."""
        if self.lease.adopt(viewer.page, viewer.identity, viewer.name):
            self._tell_operator(f"{viewer.name} goes on in command")

    def release(self, page: str) -> Answer:
        """Take command from a page that gives it up."""
        holder = self.lease.holder
        if holder is None or not self.lease.release(page):
            return Answer(False, "this page is not in command")
        self._tell_operator(f"{holder.name} has released command")
        return Answer(True, "released")

    def publish_operator(self) -> None:
        """Show all pages which one is in command."""
        holder = self.lease.holder
        attended = self.lease.attended
        self.latest.put_state(
            operator={
                "name": "" if holder is None else holder.name,
                "mark": "" if holder is None else mark_of(holder.page),
                "attended": attended,
                "pages": sum(self.alive(page) for page in self.viewers),
            }
        )

    async def call(self, page: str, service: str, **fields: Any) -> Answer:
        """Call a service for a page, and log it.

        Args:
            page: its id.
            service: its name; without command, a page may only call those of FREE_FOR_ALL.
            **fields: of the request.

        Returns:
            The service's answer, or why the page may not call it.
        """
        refusal = self._refusal(page, service)
        answer = Answer(False, refusal) if refusal else await self.rig.call(service, fields)
        return self._log(service, fields, answer)

    async def start(self, page: str, action: str, **fields: Any) -> Answer:
        """Start an action for a page, and log it.

        Args:
            page: its id.
            action: its name.
            **fields: of the goal.

        Returns:
            Whether the goal was accepted, or why the page may not send it.
        """
        refusal = self._refusal(page, action)
        answer = Answer(False, refusal) if refusal else await self.rig.start(action, fields)
        return self._log(action, fields, answer)

    async def cancel(self, page: str, action: str) -> Answer:
        """Cancel an action for a page, and log it.

        Args:
            page: its id.
            action: its name; only what this console has started can be cancelled.
        """
        refusal = self._refusal(page, action)
        answer = Answer(False, refusal) if refusal else await self.rig.cancel(action)
        return self._log(f"cancel {action}", {}, answer)

    async def look(self, service: str, **fields: Any) -> Answer:
        """Call a service that moves nothing, such as a check; every page may."""
        return await self.rig.call(service, fields)

    def _refusal(self, page: str, what: str) -> str:
        return "" if what in FREE_FOR_ALL else self.lease.refusal(page)

    def _log(self, what: str, fields: dict[str, Any], answer: Answer) -> Answer:
        sentence = _SENTENCES.get(what)
        request = what.replace("_", " ") if sentence is None else sentence(fields)
        level = NOTICE if answer.success else WARNING
        if what == "emergency_stop":
            level = FAULT
        self.latest.tell(level, "console", f"{request}: {answer.message}")
        return answer

    def _tell_operator(self, text: str) -> None:
        self.latest.tell(INFO, "console", text)
        self.publish_operator()


_SENTENCES: dict[str, Callable[[dict[str, Any]], str]] = {
    "set_mode": lambda f: f"request {OperatingMode(f['mode']).name}",
    "record": lambda f: "start recording" if f["data"] else "stop recording",
    "run_program": lambda f: f"run {Path(f['program']).name}, scale {f['scale']:g}",
    "move_to_configuration": lambda f: f"move to {configuration_name(f['index'])}",
    "measure_reflector": lambda f: f"measure {reflector_name(f['reflector'])}",
    "commission_limb": lambda f: f"commission {limb_name(f['limb'])}",
    "run_stiffness_test": lambda f: f"stiffness campaign into {Path(f['folder']).name}",
}


def mark_of(page: str) -> str:
    """Return a page's mark, by which it recognises itself; its id stays secret."""
    return hashlib.sha256(page.encode()).hexdigest()[:16]
