# SPDX-License-Identifier: Apache-2.0
"""Moving the robot over Robot Web Services: what a controller answers besides the expected.

Sources: ros-industrial/abb_librws#47, #50, #81; abb_robot_client#11; OmniCore (https).
"""

from __future__ import annotations

import itertools
import socket
import threading
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

from cabols_hw.abb.errors import RobotError
from cabols_hw.abb.rws.motions import RobotMover
from cases import outcome
from rws_fake import DROP, PASSWORD, USER, FakeController, failure_body

MODULE_VARIABLES = ("cabols_target", "cabols_error")
PATIENCE_S = 4.0
"""Longest wait for an answer that has a time-out of 0.5 s."""


@pytest.fixture
def controllers():
    """Makes controllers, and closes them."""
    made = []

    def make(**options):
        made.append(FakeController(**options))
        return made[-1]

    yield make
    for controller in made:
        controller.close()


def move(controller, cancelled=lambda: ""):
    """What moving to configuration 1 gives."""
    mover = RobotMover(controller.url, USER, PASSWORD)
    try:
        return outcome(lambda: mover.move(1, 5.0, cancelled, 0.05))
    finally:
        mover.close()


class TestStop:
    @pytest.fixture
    def stopped(self, controllers):
        """A motion that is cancelled; the connection of its one stop request is dropped."""
        dropped = []

        def fail(_method, _path, action):
            if action == "stop" and not dropped:
                dropped.append(action)
                return DROP
            return None

        controller, polls = controllers(fail=fail, motion_s=60.0), itertools.count()
        error = move(controller, lambda: "cancelled" if next(polls) > 2 else "")
        assert isinstance(error, RobotError)
        assert dropped
        return controller

    def test_stop_is_repeated_after_a_dropped_connection(self, stopped):
        assert stopped.stops() >= 2
        assert not stopped.running

    def test_demand_is_withdrawn(self, stopped):
        """Right today, to be kept."""
        assert stopped.variables["cabols_go"] == "FALSE"


def test_good_controller_moves(controllers):
    controller = controllers()
    assert not isinstance(move(controller), Exception)
    assert controller.stops() == 0


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ({"max_sessions": 0}, "sessions"),
        ({"fail": lambda *_: (500, b"<html>Internal Server Error</html>")}, "white list"),
        ({"fail": lambda *_: (404, b"<html/>")}, "version"),
    ],
    ids=["503, too many sessions", "500, white list", "404, a server of version 2.0"],
)
def test_status_is_reported_with_advice(controllers, options, word):
    error = move(controllers(**options))
    assert isinstance(error, RobotError)
    assert word in str(error)


def mastership(method, _path, _action):
    return (403, failure_body(-1073445865)) if method == "POST" else None


def test_mastership_of_the_pendant_is_reported(controllers):
    error = move(controllers(fail=mastership))
    assert isinstance(error, RobotError)
    assert "mastership" in str(error)


def test_program_that_was_not_started_is_not_stopped(controllers):
    """The module cabols is not loaded: another program runs, which is none of ours."""
    controller = controllers()
    for name in MODULE_VARIABLES:
        del controller.variables[name]
    assert isinstance(move(controller), RobotError)
    assert controller.running
    assert controller.stops() == 0


def ends(url, timeout_s):
    """Whether check_ready() of a controller that does not answer comes back."""
    ended = threading.Event()

    def ask():
        outcome(RobotMover(url, USER, PASSWORD, timeout_s=timeout_s).check_ready)
        ended.set()

    threading.Thread(target=ask, daemon=True).start()
    return ended.wait(PATIENCE_S)


@pytest.mark.parametrize("scheme", ["http", "https"])
def test_mute_controller_is_given_up(scheme):
    with socket.create_server(("127.0.0.1", 0)) as mute:
        assert ends(f"{scheme}://127.0.0.1:{mute.getsockname()[1]}", 0.5)


class Dripping(BaseHTTPRequestHandler):
    """Answers with one byte at a time, each well within the time-out of a read."""

    over = threading.Event()

    def do_GET(self):
        self.send_response(200)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", "100000")
        self.end_headers()
        with suppress(OSError):
            while not self.over.wait(0.1):
                self.wfile.write(b" ")

    def log_message(self, *_):
        """Say nothing."""


def test_controller_that_drips_is_given_up():
    server = ThreadingHTTPServer(("127.0.0.1", 0), Dripping)
    server.daemon_threads = True
    threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()
    try:
        assert ends(f"http://127.0.0.1:{server.server_address[1]}", 0.5)
    finally:
        Dripping.over.set()
        server.shutdown()
        server.server_close()
