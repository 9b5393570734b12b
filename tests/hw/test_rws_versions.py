# SPDX-License-Identifier: Apache-2.0
"""The rig's RWS client against simulated controllers of both versions, also over a bad network."""

from __future__ import annotations

import random
import threading
import time
from pathlib import Path

import pytest

from abb_harness import PATIENCE_S, quiet_port, running_controller, wait_until
from cabols_hw.abb.errors import MoveAbortedError, RobotError, RwsError
from cabols_hw.abb.rws.answers import content_of, value_of
from cabols_hw.abb.rws.client import RwsLane, RwsSession
from cabols_hw.abb.rws.dialects import RWS_1, RWS_2
from cabols_hw.abb.rws.http_exchange import HttpAddress, HttpAnswer
from cabols_hw.abb.rws.http_login import Login, Scheme
from cabols_hw.abb.rws.motions import RobotMover
from cabols_sim.devices.abb.rws_server import Trouble

USER, PASSWORD = "Default User", "robotics"
CERTIFICATE = Path(__file__).resolve().parents[1] / "data" / "simulated_controller.pem"
KINDS = {
    "1.0, http": {},
    "2.0, http": {"rws_version": 2},
    "2.0, https": {"rws_version": 2, "certificate": str(CERTIFICATE)},
}


@pytest.fixture(params=KINDS.values(), ids=KINDS.keys())
def controller(request):
    with running_controller(quiet_port(), **request.param) as (clock, found):
        yield clock, found


@pytest.fixture
def mover(controller):
    found = RobotMover(controller[1].rws.url, USER, PASSWORD)
    yield found
    found.close()


def test_version_is_found_by_asking(request, mover):
    assert mover.version == request.node.callspec.id[:3]


def test_robot_moves_and_comes_back(controller, mover):
    clock, _ = controller
    mover.move(4, PATIENCE_S, lambda: "", poll_s=0.02)
    assert clock.robot.target_index == 4
    mover.move(0, PATIENCE_S, lambda: "", poll_s=0.02)
    assert clock.robot.target_index == 0


def test_interrupted_motion_stops_and_is_forgotten(controller, mover):
    clock, found = controller
    with pytest.raises(MoveAbortedError, match="cancelled"):
        mover.move(5, PATIENCE_S, lambda: "cancelled" if clock.robot.moving else "", poll_s=0.02)
    wait_until(lambda: not clock.robot.moving, "stop")
    assert not found.program.running
    assert found.program.get("cabols_go") == "FALSE"


def test_wrong_password_is_told(controller):
    mover = RobotMover(controller[1].rws.url, USER, "wrong")
    with pytest.raises(RobotError, match="user and password"):
        mover.check_ready()


def test_few_requests_while_moving(controller, mover):
    clock, found = controller
    seen = []

    def count(method, path):
        seen.append((time.monotonic(), path))
        return Trouble.NONE

    def hold():
        if clock.robot.moving:
            clock.held.set()
        return ""

    found.rws.troubles = count
    with pytest.raises(MoveAbortedError, match="not done"):
        mover.move(3, 3.0, hold, poll_s=0.02)
    end = max(at for at, path in seen if "cabols_done" in path)
    waiting = [at for at, _ in seen if end - 2.0 <= at <= end]
    assert len(waiting) <= 2.0 * 10


def test_another_program_is_left_alone(controller, mover):
    """RAPID runs, but nobody takes the demand."""
    clock, found = controller
    clock.held.set()
    with pytest.raises(RobotError, match="nobody took the demand"):
        mover.move(3, PATIENCE_S, lambda: "", poll_s=0.02)
    assert found.program.running
    assert found.program.get("cabols_go") == "FALSE"


def test_mastership_is_given_back_and_its_holder_is_told():
    with running_controller(quiet_port(), rws_version=2) as (_, found):
        first = RobotMover(found.rws.url, USER, PASSWORD)
        first.move(1, PATIENCE_S, lambda: "", poll_s=0.02)
        other = RwsLane(RwsSession(found.rws.url, USER, PASSWORD), 2.0)
        other.dialect()
        other.ask(RWS_2.take_mastership())
        with pytest.raises(RobotError, match="mastership"):
            first.move(2, PATIENCE_S, lambda: "", poll_s=0.02)
        other.ask(RWS_2.release_mastership())
        first.move(2, PATIENCE_S, lambda: "", poll_s=0.02)


def test_certificate_that_is_not_the_expected_one_is_refused(tmp_path):
    with running_controller(quiet_port(), **KINDS["2.0, https"]) as (_, found):
        RobotMover(found.rws.url, USER, PASSWORD, certificate=str(CERTIFICATE)).check_ready()
        with pytest.raises(RobotError, match="rws_certificate"):
            RobotMover(found.rws.url, USER, PASSWORD, certificate=str(tmp_path / "none.pem"))


# A bad network -----------------------------------------------------------------------------


def test_motion_over_a_bad_network(controller, mover):
    clock, found = controller
    draw = random.Random(3)
    kinds = (Trouble.LOST, Trouble.ANSWER_LOST, Trouble.BUSY)
    found.rws.troubles = lambda *_: draw.choice(kinds) if draw.random() < 0.3 else Trouble.NONE
    mover.move(2, PATIENCE_S, lambda: "", poll_s=0.02)
    assert clock.robot.target_index == 2


@pytest.mark.parametrize("kind", [Trouble.LOST, Trouble.ANSWER_LOST, Trouble.BUSY, Trouble.HANGS])
def test_stop_arrives_within_a_second(controller, mover, kind):
    """Every request but each fourth has the trouble."""
    clock, found = controller
    count = [0]

    def troubled(*_):
        count[0] += 1
        return Trouble.NONE if count[0] % 4 == 0 else kind

    stopped = threading.Event()
    mover.start_move(5)
    wait_until(lambda: clock.robot.moving, "moving")
    found.rws.troubles = troubled
    threading.Thread(target=lambda: (mover.abort(), stopped.set()), daemon=True).start()
    began = time.monotonic()
    wait_until(lambda: not found.program.running, "stop")
    took_s = time.monotonic() - began
    assert count[0] <= 4 * 10, f"{count[0]} requests, {took_s:.2f} s"
    found.rws.troubles = lambda *_: Trouble.NONE
    assert stopped.wait(PATIENCE_S)


# Answers ------------------------------------------------------------------------------------


JSON_1 = b'{"_embedded": {"_state": [{"_type": "pnl-opmode", "opmode": "AUTO"}]}}'
JSON_2 = b'{"state": [{"_type": "pnl-opmode", "opmode": "AUTO"}]}'
XHTML = (
    b'<?xml version="1.0" encoding="utf-8"?><html xmlns="http://www.w3.org/1999/xhtml"><body>'
    b'<div class="state"><ul><li class="pnl-opmode" title="opmode">'
    b'<span class="opmode">AUTO</span></li></ul></div></body></html>'
)


def answer(body, kind="application/json", status=200):
    return HttpAnswer(status, {"content-type": kind}, (), body)


@pytest.mark.parametrize(
    ("body", "kind"),
    [
        (JSON_1, "application/json"),
        (JSON_1, "application/json;charset=utf-8"),
        (b"\xef\xbb\xbf" + JSON_1, "application/json; charset=UTF-8"),
        (JSON_1.decode().encode("utf-16"), "application/json; charset=utf-16"),
        (JSON_2, "application/hal+json;v=2.0"),
        (JSON_2, "text/html"),
        (XHTML, "application/xhtml+xml;v=2.0"),
        (XHTML, "text/xml"),
        (b"\r\n" + JSON_1, ""),
        (JSON_1, "application/json; charset=no-such"),
    ],
)
def test_mode_is_read_in_every_form(body, kind):
    assert value_of(RWS_1.operation_mode(), answer(body, kind), "url")[0]["opmode"] == "AUTO"


@pytest.mark.parametrize(
    "body",
    [
        b"",
        b"null",
        b"[1]",
        b'{"state": 3}',
        b"<html><br></html>",
        b"\xff\xfe",
        b"{" * 5000,
        b'<!DOCTYPE x [<!ENTITY a "b">]><x>&a;</x>',
    ],
)
def test_odd_answer_is_an_error_of_ours(body):
    with pytest.raises(RwsError, match="expected an answer with opmode"):
        value_of(RWS_1.operation_mode(), answer(body), "url")


@pytest.mark.parametrize(
    ("status", "word"),
    [
        (301, "refers to"),
        (401, "user and password"),
        (403, "mastership"),
        (404, "version"),
        (406, "version"),
        (415, "version"),
        (429, "too many requests"),
        (500, "white list"),
        (502, "try again"),
        (503, "sessions"),
    ],
)
def test_status_has_its_advice(status, word):
    with pytest.raises(RwsError, match=word):
        value_of(RWS_1.operation_mode(), answer(b"<html/>", "text/html", status), "url")


@pytest.mark.parametrize(
    "body",
    [
        b'{"_embedded": {"status": {"code": -1073442809, "msg": "not found"}}}',
        b'{"status": {"code": "-1073442809"}}',
        b'<html><body><div class="status"><span class="code">-1073442809</span>'
        b'<span class="msg">not found</span></div></body></html>',
    ],
)
def test_missing_module_is_named_in_every_form(body):
    assert content_of(answer(body)).code == -1073442809
    with pytest.raises(RwsError, match=r"cabols\.mod"):
        value_of(RWS_1.read("cabols_go"), answer(body, status=400), "url")


@pytest.mark.parametrize("url", ["", "192.168.125.1", "ftp://x", "http://", "http://x:99999"])
def test_address_that_is_none_is_refused(url):
    with pytest.raises(RobotError, match="rws_url"):
        RobotMover(url, USER, PASSWORD)


def test_addresses_have_their_ports():
    assert str(HttpAddress.of("http://10.0.0.1")) == "http://10.0.0.1:80"
    assert str(HttpAddress.of("https://[::1]/")) == "https://[::1]:443"


def test_digest_of_the_standard():
    """RFC 7616, 3.9.1, with MD5; the client's nonce is random, so the server's side is computed."""
    login = Login("Mufasa", "Circle of Life")
    assert login.header("GET", "/dir/index.html") == ""
    assert login.challenge(
        'Digest realm="http-auth@example.org", qop="auth, auth-int", algorithm=MD5, '
        'nonce="7ypf/xlj9XXwfDPEoM4URrv/xwf94BcCAzFZH4GiTo0v", opaque="FQhe/qaU925kfnzjCev0ciny"'
    )
    assert login.scheme is Scheme.DIGEST
    header = login.header("GET", "/dir/index.html")
    assert "nc=00000001" in header
    assert 'opaque="FQhe' in header


@pytest.mark.parametrize(
    "header", ["", "Negotiate", "Digest realm=x", "Digest nonce=1, algorithm=Z"]
)
def test_challenge_that_cannot_be_answered_is_none(header):
    assert not Login("a", "b").challenge(header)
