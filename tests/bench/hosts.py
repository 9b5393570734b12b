# SPDX-License-Identifier: Apache-2.0
"""Two hosts on one machine: network namespaces whose network cards end in this process.

Each host has a loopback device and one Ethernet card. Frames between the cards pass through this
process, which delays and loses them as asked; without delay and loss, a pair of virtual cards that
the kernel joins is used instead. Needs the right to make network namespaces, and `ip` of iproute2.
"""

from __future__ import annotations

import ctypes
import fcntl
import heapq
import os
import random
import select
import shutil
import struct
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from cabols_control.realtime.scheduling import may_use_fifo

CARD = "wire"
ADDRESSES = ("192.0.2.1/24", "192.0.2.2/24")
"""Of the hosts' cards, from the range for documentation (RFC 5737), which is routed nowhere."""
TUNSETIFF, IFF_TAP, IFF_NO_PI = 0x400454CA, 0x0002, 0x1000
CLONE_NEWNET = 0x40000000
FRAME_BYTES = 65536
RELAY = 60
"""SCHED_FIFO priority of what carries frames: above the nodes'."""
_LIBC = ctypes.CDLL(None, use_errno=True)


@dataclass
class Wire:
    """What joins the hosts.

    Attributes:
        delay_s: of each frame, one way [s].
        jitter_s: added to it, uniform from 0 to this; frames may overtake each other [s].
        loss: share of frames that are lost.
        seed: of jitter and loss.
        frames: that came, both ways; 0 where the kernel joins the cards.
        lost: of them.
    """

    delay_s: float = 0.0
    jitter_s: float = 0.0
    loss: float = 0.0
    seed: int = 0
    frames: int = field(default=0, init=False)
    lost: int = field(default=0, init=False)

    @property
    def plain(self) -> bool:
        """Whether nothing is to happen to the frames."""
        return not (self.delay_s or self.jitter_s or self.loss)


class NoHostsError(Exception):
    """This process may not make hosts, or lacks the program for it."""


@contextmanager
def two_hosts(wire: Wire) -> Iterator[tuple[list[str], list[str]]]:
    """Make two hosts; both and all that was sent between them end with the context.

    Args:
        wire: that joins them; counts what it carries.

    Yields:
        For each host the words before a command that is to run there.

    Raises:
        NoHostsError: if the system does not let this process make them.
    """
    if shutil.which("ip") is None:
        raise NoHostsError("expected the program `ip`, found none: install iproute2")
    names = [f"cabols_{os.getpid()}_{number}" for number in (1, 2)]
    try:
        for name in names:
            _ip("netns", "add", name)
        cards = _join(names) if wire.plain else [_card(name) for name in names]
        for name, address in zip(names, ADDRESSES, strict=True):
            _ip("-n", name, "address", "add", address, "dev", CARD)
            _ip("-n", name, "link", "set", CARD, "up", "multicast", "on")
            _ip("-n", name, "link", "set", "lo", "up")
            _ip("-n", name, "route", "add", "224.0.0.0/4", "dev", CARD)
        ended = threading.Event()
        carrier = threading.Thread(target=_carry, args=(wire, cards, ended), daemon=True)
        if cards:
            carrier.start()
        try:
            first, second = (["ip", "netns", "exec", name] for name in names)
            yield first, second
        finally:
            ended.set()
            if cards:
                carrier.join()
            for card in cards:
                os.close(card)
    finally:
        for name in names:
            if Path("/run/netns", name).exists():
                _ip("netns", "delete", name)


def carried(host: list[str]) -> int:
    """Return the number of frames that a host's card has sent so far."""
    words = [*host, "cat", f"/sys/class/net/{CARD}/statistics/tx_packets"]
    return int(subprocess.run(words, check=True, capture_output=True, text=True).stdout)


def _ip(*words: str) -> None:
    done = subprocess.run(["ip", *words], check=False, capture_output=True, text=True)
    if done.returncode:
        raise NoHostsError(f"ip {' '.join(words)}: {done.stderr.strip()}; run this as root")


def _join(names: list[str]) -> list[int]:
    """Give both hosts cards that the kernel joins."""
    first, second = names
    peer = ("peer", "name", CARD, "netns", second)
    _ip("link", "add", CARD, "netns", first, "type", "veth", *peer)
    return []


def _card(name: str) -> int:
    """Give a host a card whose other end is the descriptor that is returned."""
    opened: list[int | OSError] = []

    def enter() -> None:
        """In a thread of its own: it stays in the host's namespace until its end."""
        try:
            with Path("/run/netns", name).open("rb") as namespace:
                if _LIBC.setns(namespace.fileno(), CLONE_NEWNET):
                    number = ctypes.get_errno()
                    raise OSError(number, os.strerror(number))
            card = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
            fcntl.ioctl(card, TUNSETIFF, struct.pack("16sH22x", CARD.encode(), IFF_TAP | IFF_NO_PI))
            opened.append(card)
        except OSError as error:
            opened.append(error)

    thread = threading.Thread(target=enter)
    thread.start()
    thread.join()
    if isinstance(opened[0], OSError):
        raise NoHostsError(f"a network card of its own: {opened[0]}; run this as root")
    return opened[0]


def _carry(wire: Wire, cards: list[int], ended: threading.Event) -> None:
    """Carry frames from card to card until the end, before other work where that is allowed."""
    if may_use_fifo():
        # Of this thread alone: its delays must not be those of a busy computer.
        os.sched_setscheduler(threading.get_native_id(), os.SCHED_FIFO, os.sched_param(RELAY))
    chance = random.Random(wire.seed)
    other = dict(zip(cards, reversed(cards), strict=True))
    travelling: list[tuple[float, int, int, bytes]] = []
    while not ended.is_set():
        left = travelling[0][0] - time.monotonic() if travelling else 0.05
        came, _, _ = select.select(cards, [], [], min(max(left, 0.0), 0.05))
        now = time.monotonic()
        for card in came:
            frame = os.read(card, FRAME_BYTES)
            wire.frames += 1
            if chance.random() < wire.loss:
                wire.lost += 1
                continue
            due = now + wire.delay_s + chance.random() * wire.jitter_s
            heapq.heappush(travelling, (due, wire.frames, other[card], frame))
        while travelling and travelling[0][0] <= time.monotonic():
            _, _, card, frame = heapq.heappop(travelling)
            os.write(card, frame)
