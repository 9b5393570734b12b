# SPDX-License-Identifier: Apache-2.0
"""Start this project's Python commands as forks of one process that has imported them.

`forked_starts()` lets subprocess.Popen, and all that is built on it (subprocess.run, asyncio, the
project's launcher), start executables of this project and `python -m cabols_...` so; any other
command, and one whose environment has other variables that are read when Python or a library
starts, is started the ordinary way. See fork_server.py for what the processes have in common.
"""

from __future__ import annotations

import atexit
import ctypes
import os
import pickle
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from cabols_control.bringup.specs import ONE_BLAS_THREAD
from fork_server import MOST_BYTES, SET_BY_PYTHON, Request

SERVER = Path(__file__).with_name("fork_server.py")
PACKAGES = ("cabols_control", "cabols_hw", "cabols_sim", "cabols_stiffness")
READ_AT_START = (
    "PYTHON",
    "LD_",
    "LC_",
    "LANG",
    "NUMBA_",
    "OPENBLAS_",
    "OMP_",
    "MKL_",
    "RMW_",
    "_ROS_W",
)
"""Beginnings of the names of variables that a running process does not read again."""
PR_SET_CHILD_SUBREAPER = 36
_ORDINARY = subprocess.Popen
_LIBC = ctypes.CDLL(None)


class ForkServer:
    """The process that forks, once for a process of tests."""

    def __init__(self) -> None:
        self.environment = {**os.environ, **ONE_BLAS_THREAD}
        self._lock = threading.Lock()
        self._channel, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            self.process = _ORDINARY(
                [sys.executable, str(SERVER), str(theirs.fileno())],
                env=self.environment,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                pass_fds=(theirs.fileno(),),
            )
        if self._channel.recv(16) != b"ready":
            raise RuntimeError("the fork server ended while it imported")
        atexit.register(self.close)

    def start(self, request: Request, descriptors: Sequence[int]) -> int:
        """Fork a process and return its id; it is a child of this process."""
        with self._lock:
            _LIBC.prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
            try:
                socket.send_fds(self._channel, [pickle.dumps(request)], list(descriptors))
                answer = self._channel.recv(MOST_BYTES)
            finally:
                _LIBC.prctl(PR_SET_CHILD_SUBREAPER, 0, 0, 0, 0)
        pid, why = pickle.loads(answer) if answer else (0, "the fork server has ended")
        if not pid:
            raise subprocess.SubprocessError(f"{request.words}: {why}")
        return int(pid)

    def close(self) -> None:
        """End the server; what it has forked runs on."""
        self._channel.close()
        self.process.wait()


_SERVERS: list[ForkServer] = []


def server() -> ForkServer:
    """This process's fork server; it is started when it is asked for first."""
    if not _SERVERS:
        _SERVERS.append(ForkServer())
    return _SERVERS[0]


def read_at_start(environment: Mapping[str, str]) -> dict[str, str]:
    """Variables that a process reads when it starts, and not again."""
    return {name: value for name, value in environment.items() if name.startswith(READ_AT_START)}


def differ(environment: Mapping[str, str], other: Mapping[str, str]) -> bool:
    """Whether processes with these variables differ in what they read when they start.

    PYTHONPATH counts only where it leads to modules that this process does not see.
    """
    ours, theirs = read_at_start(environment), read_at_start(other)
    path = ours.pop("PYTHONPATH", "").split(os.pathsep)
    theirs.pop("PYTHONPATH", None)
    return ours != theirs or not {each for each in path if each} <= {*sys.path, str(Path.cwd())}


def is_python_of_ours(words: Sequence[str]) -> bool:
    """Whether a command is one of this project's executables, or `python -m` of a module."""
    if words[0] == sys.executable:
        return len(words) > 2 and words[1] == "-m" and words[2].startswith(PACKAGES)
    folder = Path(words[0]).parent
    return folder.name in PACKAGES and folder.parent == Path(sys.prefix) / "lib"


class ForkedPopen(_ORDINARY):
    """subprocess.Popen whose process is forked, where it can be."""

    def _execute_child(self, *given: Any) -> None:
        names = (
            *("args", "executable", "preexec_fn", "close_fds", "pass_fds", "cwd", "env"),
            *("startupinfo", "creationflags", "shell", "p2cread", "p2cwrite", "c2pread"),
            *("c2pwrite", "errread", "errwrite", "restore_signals", "gid", "gids", "uid"),
            *("umask", "start_new_session", "process_group"),
        )
        # Python 3.10 does not know the last one.
        asked = {"process_group": -1, **dict(zip(names, given, strict=False))}
        if (request := _request(asked)) is None:
            super()._execute_child(*given)
            return
        passed = sorted(map(int, asked["pass_fds"]))
        standard = [asked["p2cread"], asked["c2pwrite"], asked["errwrite"]]
        found = [number if each == -1 else each for number, each in enumerate(standard)]
        self.pid = server().start(request, [*found, *passed])
        self._child_created = True
        self._close_pipe_fds(
            *(asked[name] for name in ("p2cread", "p2cwrite", "c2pread", "c2pwrite")),
            *(asked[name] for name in ("errread", "errwrite")),
        )


def _request(asked: dict[str, Any]) -> Request | None:
    """What to ask the server for; None: the process must be started the ordinary way."""
    args = asked["args"]
    words = [os.fspath(args)] if isinstance(args, str | os.PathLike) else list(map(str, args))
    plain = not asked["shell"] and asked["executable"] is None and asked["close_fds"]
    if not plain or not is_python_of_ours(words):
        return None
    if any(asked[name] is not None for name in ("gid", "gids", "uid")):
        return None
    given = os.environ if asked["env"] is None else asked["env"]
    environment = {os.fsdecode(name): os.fsdecode(value) for name, value in given.items()}
    if differ(environment, server().environment):
        return None
    try:
        prepare = pickle.dumps(asked["preexec_fn"]) if asked["preexec_fn"] else b""
    except (pickle.PicklingError, AttributeError, TypeError):
        return None
    handled = {number: signal.getsignal(number) for number in signal.valid_signals()}
    ignored = {number for number, how in handled.items() if how is signal.SIG_IGN}
    return Request(
        words,
        environment,
        [0, 1, 2, *sorted(map(int, asked["pass_fds"]))],
        os.fspath(asked["cwd"] or Path.cwd()),
        os.getpid(),
        frozenset(os.sched_getaffinity(0)),
        frozenset(signal.pthread_sigmask(signal.SIG_BLOCK, ())),
        frozenset(ignored - set(SET_BY_PYTHON)),
        asked["start_new_session"],
        asked["process_group"],
        asked["umask"],
        prepare,
    )


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Fork what a test of nodes starts, its fixtures too, unless its starts must be ordinary."""
    if item.get_closest_marker("ordinary_start") or not item.get_closest_marker("ros"):
        yield
        return
    with forked_starts():
        yield


@contextmanager
def forked_starts() -> Iterator[None]:
    """Fork this project's commands for as long as this lasts."""
    before = subprocess.Popen
    subprocess.Popen = ForkedPopen
    try:
        yield
    finally:
        subprocess.Popen = before
