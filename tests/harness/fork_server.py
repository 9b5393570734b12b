# SPDX-License-Identifier: Apache-2.0
"""A process that has imported what every node imports, and forks one for each start.

python fork_server.py FILE_DESCRIPTOR_OF_A_SOCKET

The other side is forked_start.py. A node that is started the ordinary way spends one to two
seconds of processor time on imports, a graph of ten nodes as much as on its run. Here only imports
are shared, nothing that runs: no kernel is compiled or loaded, no thread of ours is started, rclpy
is not initialised. Each process is a child of who asked for it (PR_SET_CHILD_SUBREAPER), not of the
server, so that waiting, exit codes, signals and the kernel's word of a dead parent are as ever.
"""

from __future__ import annotations

import ctypes
import fcntl
import gc
import importlib
import importlib.util
import os
import pickle
import re
import runpy
import signal
import socket
import sys
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

BESIDE_NODES = (
    "cabols_control.bringup.processes",
    "cabols_control.nodes.commission",
    "cabols_control.nodes.markers",
    "cabols_sim.devices.simulator",
    "cabols_stiffness.nodes.compensation",
)
"""What is imported besides the nodes of launch files."""
SET_BY_PYTHON = (signal.SIGPIPE, signal.SIGXFSZ)
"""Signals that every Python process ignores."""
MOST_BYTES = 1 << 20
MOST_DESCRIPTORS = 64
ABOVE_TARGETS = 200
ADOPTION_S = 60.0


@dataclass(frozen=True)
class Request:
    """What subprocess.Popen would have given to a new process.

    Attributes:
        words: command line; words[0] is a Python script, or the interpreter before -m MODULE.
        environment: all variables.
        targets: number that each descriptor which comes with the request gets.
        cwd: working directory.
        parent: process id of who asks.
        cores: those that the process may use.
        blocked: signals that are held back.
        ignored: signals that are ignored.
        new_session: whether to call setsid().
        group: for setpgid(); -1: leave it.
        umask: -1: leave it.
        prepare: pickled function that is called last, as preexec_fn.
    """

    words: list[str]
    environment: dict[str, str]
    targets: list[int]
    cwd: str
    parent: int
    cores: frozenset[int]
    blocked: frozenset[int]
    ignored: frozenset[int]
    new_session: bool
    group: int
    umask: int
    prepare: bytes


class Tracer:
    """LTTng, which rcl brings: a fork lacks its threads until it is told of the fork.

    What ends such a process cancels them, on stacks that may be unmapped (lttng-ust-fork(3)).
    """

    def __init__(self) -> None:
        maps = Path("/proc/self/maps").read_text("utf-8").splitlines()
        paths = {line.split()[-1] for line in maps if "/liblttng-ust" in line}
        found = [path for path in paths if re.search(r"/liblttng-ust(-[0-9a-f]+)?\.so", path)]
        self._library = ctypes.CDLL(found[0]) if found else None
        self._signals = ctypes.create_string_buffer(128)

    def tell(self, what: str) -> None:
        """Call a function of its, under the name of either version; nothing if rcl has no LTTng."""
        if self._library is None:
            return
        name = f"ust_{what}"
        name = name if hasattr(self._library, name) else f"lttng_{name}"
        getattr(self._library, name)(self._signals)


def receive(channel: socket.socket) -> tuple[Request, list[int]] | None:
    """Wait for the next request and its descriptors; None: nobody is left who could ask."""
    data, descriptors, _, _ = socket.recv_fds(channel, MOST_BYTES, MOST_DESCRIPTORS)
    return (pickle.loads(data), descriptors) if data else None


def serve(channel: socket.socket) -> Request | None:
    """Fork a process for each request; it returns its request, the server None at the end."""
    tracer = Tracer()
    while (found := receive(channel)) is not None:
        request, descriptors = found
        tracer.tell("before_fork")
        between = os.fork()
        if between == 0:
            if os.fork() != 0:
                os._exit(0)
            tracer.tell("after_fork_child")
            become(request, descriptors, channel)
            return request
        tracer.tell("after_fork_parent")
        for descriptor in descriptors:
            os.close(descriptor)
        os.waitpid(between, 0)
    return None


def become(request: Request, descriptors: list[int], channel: socket.socket) -> None:
    """Make this process what was asked for, and tell its id, or why it cannot be."""
    answer = socket.socket(fileno=fcntl.fcntl(channel, fcntl.F_DUPFD_CLOEXEC, ABOVE_TARGETS))
    try:
        give_up = time.monotonic() + ADOPTION_S
        while os.getppid() != request.parent:
            if time.monotonic() > give_up:
                raise RuntimeError(f"still a child of {os.getppid()}")
            time.sleep(0.0005)
        take_descriptors(request.targets, descriptors, answer.fileno())
        take_signals(request)
        os.sched_setaffinity(0, request.cores)
        os.environ.clear()
        os.environ.update(request.environment)
        os.chdir(request.cwd)
        if request.umask >= 0:
            os.umask(request.umask)
        if request.group >= 0:
            os.setpgid(0, request.group)
        if request.new_session:
            os.setsid()
        if request.prepare:
            pickle.loads(request.prepare)()
    except BaseException as error:
        with suppress(OSError):
            answer.send(pickle.dumps((0, repr(error))))
        os._exit(255)
    answer.send(pickle.dumps((os.getpid(), "")))
    answer.close()


def take_descriptors(targets: list[int], descriptors: list[int], kept: int) -> None:
    """Give the descriptors their numbers; all others but one are closed."""
    above = [fcntl.fcntl(each, fcntl.F_DUPFD, ABOVE_TARGETS) for each in descriptors]
    for source, target in zip(above, targets, strict=True):
        os.dup2(source, target)
    for number in map(int, os.listdir("/proc/self/fd")):  # noqa: PTH208
        if number not in (*targets, kept):
            with suppress(OSError):
                os.close(number)


def take_signals(request: Request) -> None:
    """Handle, ignore and hold back signals as a Python that was just started."""
    for number in signal.valid_signals() - {signal.SIGKILL, signal.SIGSTOP, *SET_BY_PYTHON}:
        if number in request.ignored:
            signal.signal(number, signal.SIG_IGN)
        elif number == signal.SIGINT:
            signal.signal(number, signal.default_int_handler)
        elif signal.getsignal(number) is signal.SIG_IGN:
            signal.signal(number, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_SETMASK, request.blocked)


def run(words: list[str]) -> None:
    """Run the command in this process, as the interpreter would have."""
    # All else about the streams is said by variables that the server was started with.
    if sys.stdout.isatty() and not os.environ.get("PYTHONUNBUFFERED"):
        sys.stdout.reconfigure(line_buffering=True)
    given = [each for each in os.environ.get("PYTHONPATH", "").split(os.pathsep) if each]
    sys.path[1:] = [*given, *(each for each in sys.path[1:] if each not in given)]
    if words[0] != sys.executable:
        sys.argv = words
        sys.path[0] = str(Path(words[0]).resolve().parent)
        runpy.run_path(words[0], run_name="__main__")
        return
    module = words[2]
    sys.argv = words[2:]
    sys.path[0] = str(Path.cwd())
    # It was imported, and is not yet where -m runs it.
    sys.modules.pop(module, None)
    runpy.run_module(module, run_name="__main__", alter_sys=True)


def modules() -> list[str]:
    """Names of what is imported: the modules of all nodes of launch files, and some more."""
    graph = importlib.import_module("cabols_control.bringup.graph")
    nodes = [f"{node.package}.nodes.{node.executable}" for node in graph.all_nodes()]
    return [*filter(importlib.util.find_spec, nodes), *BESIDE_NODES]


def threads() -> int:
    """Threads of this process."""
    return sum(1 for _ in Path("/proc/self/task").iterdir())


def main() -> Any:
    """Import, and serve until the other side is gone; in a forked process: run its command."""
    channel = socket.socket(fileno=int(sys.argv[1]))
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    importlib.import_module("rclpy")
    # The tracer's, which sleep until a daemon comes; a forked process gets its own.
    listeners = threads()
    for name in modules():
        importlib.import_module(name)
    if threads() != listeners:
        raise RuntimeError(f"imports started {threads() - listeners} threads, which no fork keeps")
    gc.collect()
    # The collector of a forked process would copy every page that it looks at.
    gc.freeze()
    channel.send(b"ready")
    request = serve(channel)
    if request is not None:
        run(request.words)


if __name__ == "__main__":
    main()
