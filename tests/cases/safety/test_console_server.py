# SPDX-License-Identifier: Apache-2.0
"""The page's server: half requests, other sites, reports with scripts, numbers of other forms.

Sources: Fetch Metadata, Content Security Policy. Who asks is decided before any work is done.
"""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest

from cabols_control.console.uploads import check_upload
from cabols_control.errors import CabolsError
from cases import outcome

CHILD = Path(__file__).parents[2] / "harness" / "console_child.py"
HALF_REQUESTS = 20
PATIENCE_S = 8.0
"""Longest that a half-sent request may stay open."""


@pytest.fixture(scope="module")
def port(tmp_path_factory):
    """TCP port of a server in a process of its own, with one campaign's report."""
    folder = tmp_path_factory.mktemp("console")
    (folder / "campaigns" / "c1").mkdir(parents=True)
    script = "<script>fetch('/api/emergency_stop', {method: 'POST'})</script>"
    (folder / "campaigns" / "c1" / "report.html").write_text(script, encoding="utf-8")
    child = subprocess.Popen(
        [sys.executable, str(CHILD), str(folder)],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)},
    )
    found = int(child.stdout.readline())
    wait_until_served(found, child)
    assert ask(found, "/reports/c1/report.html").startswith(b"HTTP/1.1 200")
    yield found
    child.kill()
    child.wait()


def wait_until_served(port, child):
    """Wait until the server takes connections: its port is known before."""
    while True:
        assert child.poll() is None, "the server has ended"
        with suppress(ConnectionRefusedError), socket.create_connection(("127.0.0.1", port)):
            return
        time.sleep(0.05)


def ask(port, path, *lines):
    """Answer to a GET, whole."""
    head = [f"GET {path} HTTP/1.1", f"Host: 127.0.0.1:{port}", *lines, "Connection: close", "", ""]
    with socket.create_connection(("127.0.0.1", port)) as wire:
        wire.settimeout(60.0)
        wire.sendall("\r\n".join(head).encode())
        data = b""
        while part := wire.recv(65536):
            data += part
    return data


def test_page_is_not_built_for_another_site(port):
    answer = ask(port, "/", "Sec-Fetch-Site: cross-site", "Sec-Fetch-Dest: image")
    assert answer.startswith(b"HTTP/1.1 403")


def test_report_is_served_with_a_content_security_policy(port):
    answer = ask(port, "/reports/c1/report.html")
    assert b"content-security-policy" in answer.split(b"\r\n\r\n")[0].lower()


def test_half_requests_are_closed(port):
    wires = [socket.create_connection(("127.0.0.1", port)) for _ in range(HALF_REQUESTS)]
    for wire in wires:
        wire.sendall(b"GET / HTTP/1.1\r\nHost: x\r\nX: ")
        wire.setblocking(False)
    still, give_up = list(wires), time.monotonic() + PATIENCE_S
    while still and time.monotonic() < give_up:
        time.sleep(0.1)
        still = [wire for wire in still if not closed(wire)]
    for wire in wires:
        wire.close()
    assert not still


def closed(wire):
    """Whether the other side has closed a socket that does not block."""
    try:
        return not wire.recv(1000)
    except BlockingIOError:
        return False
    except OSError:
        return True


def test_number_with_an_underscore_is_no_number():
    head = "time_s,fx_n,fy_n,fz_n,mx_nm,my_nm,mz_nm\n"
    rows = head + "0,1_0,0,0,0,0,0\n1,0,0,0,0,0,0\n"
    assert isinstance(outcome(lambda: check_upload("x.csv", rows.encode())), CabolsError)


@pytest.mark.parametrize(
    "lines",
    [
        ("Sec-Fetch-Site: cross-site",),
        ("Sec-Fetch-Site: same-site", "Sec-Fetch-Mode: cors"),
        ("Sec-Fetch-Site: cross-site", "Sec-Fetch-Mode: navigate", "Sec-Fetch-Dest: iframe"),
    ],
)
def test_no_other_site_gets_anything(port, lines):
    for path in ("/", "/reports/c1/report.html", "/console/live.js"):
        assert ask(port, path, *lines).startswith(b"HTTP/1.1 403")


@pytest.mark.parametrize(
    "path",
    [
        "/reports/%00",
        "/reports/c1/report.html%00",
        "/%00",
        "/console/%00.js",
        "/reports/" + "x" * 900,
        "/" + "y" * 5000,
        "/reports/" + "a/" * 300 + "report.html",
    ],
)
def test_odd_paths_are_answered(port, path):
    assert ask(port, path)[9:12] in (b"400", b"404")


def test_a_body_that_does_not_come_does_not_hold_the_stop(port):
    head = f"POST /login HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nContent-Length: 4000\r\n\r\n"
    wires = [socket.create_connection(("127.0.0.1", port)) for _ in range(1100)]
    try:
        for wire in wires[:550]:
            with suppress(OSError):
                wire.sendall(head.encode())
        stop = socket.create_connection(("127.0.0.1", port))
        stop.settimeout(PATIENCE_S)
        stop.sendall(
            f"POST /api/emergency_stop HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n"
            "Content-Length: 0\r\nConnection: close\r\n\r\n".encode()
        )
        assert stop.recv(65536).startswith(b"HTTP/1.1 200")
        stop.close()
    finally:
        for wire in wires:
            wire.close()
