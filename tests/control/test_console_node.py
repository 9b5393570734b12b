# SPDX-License-Identifier: Apache-2.0
"""The console's node as a process: tokens, foreign requests, pages that do not answer."""

from __future__ import annotations

import asyncio
import json
import os
import re
import signal
import subprocess
import time

import httpx
import pytest
import rclpy
import websockets
from cabols_msgs.msg import LimbState, Mode, OperatorHeartbeat
from cabols_msgs.srv import SetMode
from rclpy.executors import SingleThreadedExecutor
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from cabols_control.bringup.free_domains import claim_domain
from cabols_control.bringup.processes import executable_path
from cabols_control.console.server import BEHIND, UNKNOWN_PAGE
from cabols_control.ros.live import live_name
from cabols_control.ros.messages import topics
from cabols_control.ros.messages.qos import control_qos, latched_qos, status_qos
from console_harness import free_port

pytestmark = [pytest.mark.ros]

TOKEN = "a-token-of-the-tests-0123456789"
PATIENCE_S = 300.0


@pytest.fixture
def domain():
    return claim_domain()


@pytest.fixture
def start(domain, tmp_path):
    """Start consoles; those that still run at the end are ended."""
    started = []

    def begin(executable="console", **parameters):
        command = [str(executable_path("cabols_control", executable)), "--ros-args"]
        for name, value in parameters.items():
            command += ["-p", f"{name}:={json.dumps(value)}"]
        process = subprocess.Popen(
            command,
            cwd=tmp_path,
            env={**os.environ, "ROS_DOMAIN_ID": str(domain)},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        started.append(process)
        return process

    yield begin
    for process in started:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        try:
            process.wait(10.0)
        except subprocess.TimeoutExpired:
            process.kill()
            raise


def serving(process, port):
    """Wait until a console serves; returns a client's address."""
    address = f"http://127.0.0.1:{port}"
    give_up = time.monotonic() + PATIENCE_S
    with httpx.Client() as client:
        while time.monotonic() < give_up:
            assert process.poll() is None, process.stdout.read()
            try:
                client.get(f"{address}/login")
                return address
            except httpx.TransportError:
                time.sleep(0.1)
    raise AssertionError("no console")


class Rig:
    """The few parts of a rig that a console needs: a mode, samples, services."""

    def __init__(self, domain):
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=domain)
        node = rclpy.create_node("rig", namespace="/cabols", context=self.context)
        self.node = node
        self.asked, self.heard, self.drawn = [], [], []
        node.create_service(SetMode, "set_mode", self._set_mode)
        node.create_service(Trigger, "emergency_stop", self._stop)
        node.create_subscription(
            OperatorHeartbeat, "operator_heartbeat", self.heard.append, status_qos()
        )
        node.create_subscription(MarkerArray, "markers", self.drawn.append, status_qos())
        self._mode = node.create_publisher(Mode, "mode", latched_qos(False))
        self._state = node.create_publisher(LimbState, live_name("limb_state"), control_qos(False))
        self._sample = topics.limb_state_layout(_geometry()).record()
        self._sample["tension"][:] = 12.5
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(node)
        node.create_timer(0.05, self._tick)

    def _tick(self):
        self._mode.publish(Mode(mode=Mode.STOPPED, reason="test"))
        self._state.publish(self._sample.raw())

    def _set_mode(self, request, response):
        self.asked.append(request.mode)
        response.success, response.message = False, "this rig refuses"
        return response

    def _stop(self, _, response):
        self.asked.append("stop")
        response.success = True
        return response

    def spin(self, condition, what):
        give_up = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < give_up, f"waited in vain for {what}"
            self.executor.spin_once(timeout_sec=0.02)

    async def spin_async(self, condition, what):
        give_up = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < give_up, f"waited in vain for {what}"
            self.executor.spin_once(timeout_sec=0.0)
            await asyncio.sleep(0.005)

    def close(self):
        self.node.destroy_node()
        self.context.try_shutdown()


def _geometry():
    from cabols_control.geometry import load_geometry

    return load_geometry()


@pytest.fixture
def rig(domain):
    found = Rig(domain)
    yield found
    found.close()


def test_other_addresses_need_a_token_before_anything_starts(start):
    process = start(host="0.0.0.0", port=free_port())
    assert process.wait(PATIENCE_S) == 2
    assert "expected a token_file, as 0.0.0.0 can be reached" in process.stdout.read()


def test_nothing_is_done_without_the_token(start, rig, tmp_path):
    (tmp_path / "token").write_text(TOKEN + "\n")
    port = free_port()
    address = serving(start(host="0.0.0.0", port=port, token_file=str(tmp_path / "token")), port)
    with httpx.Client(base_url=address) as client:
        assert client.post("/api/emergency_stop").status_code == 401
        assert (
            client.post("/api/emergency_stop", headers={"Authorization": "Bearer no"}).status_code
            == 401
        )
        for path in ("/", "/console/live.js", "/reports/x/report.html", "/_nicegui_ws/socket.io/"):
            assert client.get(path).status_code == 401
        assert client.get("/", headers={"accept": "text/html"}).headers["location"] == "/login"
        assert client.post("/login", data={"token": "wrong"}).status_code == 401
    for path in ("/live?page=x", "/_nicegui_ws/socket.io/?EIO=4&transport=websocket"):
        with pytest.raises(websockets.InvalidStatus, match="403"):
            asyncio.run(_open(f"ws://127.0.0.1:{port}{path}"))
    assert rig.asked == []
    with httpx.Client(base_url=address, follow_redirects=True) as client:
        page = client.post("/login", data={"token": TOKEN}, headers={"accept": "text/html"})
        assert page.status_code == 200
        assert "console-settings" in page.text
        forged = client.post("/api/emergency_stop", headers={"origin": "http://evil.example"})
        assert forged.status_code == 403

        async def stop():
            task = asyncio.to_thread(client.post, "/api/emergency_stop")
            waiting = asyncio.create_task(task)
            await rig.spin_async(waiting.done, "an answer")
            return waiting.result()

        answer = asyncio.run(stop())
        assert answer.json()["success"], "with the cookie, and in nobody's command"
    assert rig.asked == ["stop"]


async def _open(address):
    async with websockets.connect(address):
        pass


def test_pages_and_viewers_of_one_console(start, rig):
    """One console, as its start takes long: pages, Foxglove, markers, a second one, its end."""
    port, viewers = free_port(), free_port()
    start("markers")
    console = start(port=port, foxglove_port=viewers)
    address = serving(console, port)
    mute_pages_get_little_and_command_nothing(rig, address, port)
    markers_draw_the_rig(rig)
    live = asyncio.run(foxglove_values(rig, viewers))
    assert live["tension_n"] == [12.5] * 8
    second = start(port=port)
    assert second.wait(PATIENCE_S) == 2
    assert "choose another port" in second.stdout.read()
    console.send_signal(signal.SIGTERM)
    assert console.wait(5.0) == 0


def mute_pages_get_little_and_command_nothing(rig, address, port):
    wire = f"ws://127.0.0.1:{port}/live?page="

    async def play():
        with httpx.Client(base_url=address) as client:
            page = json.loads(
                re.search(r'console-settings">(.*?)</script>', client.get("/").text)[1]
            )
        async with websockets.connect(wire + "unknown") as stranger:
            with pytest.raises(websockets.ConnectionClosed) as ended:
                await stranger.recv()
            assert ended.value.rcvd.code == UNKNOWN_PAGE
        with pytest.raises(websockets.InvalidStatus, match="403"):
            await _open_from("http://evil.example", wire + page["page"])
        await first_sample(rig, wire + page["page"])
        async with websockets.connect(wire + page["page"]) as mute:
            await mute.send('{"a": 0}')  # as a page does that is asked before its first frame
            frames, others = await collect(rig, mute, BEHIND + 60)
            assert 5 < len(frames) <= BEHIND + 2, "frames stop when nothing is acknowledged"
            assert frames[-1]["T"] == [12.5] * 8
            assert others["s"][-1]["mode"]["name"] == "STOPPED"
            await mute.send(json.dumps({"a": frames[-1]["n"]}))
            newest = await next_frame(rig, mute)
            assert newest["n"] > frames[-1]["n"] + 5, "the newest one, not the ones it missed"
            for junk in ("{}", "x", '{"a": 1e99}', '{"a": "y"}'):
                await mute.send(junk)
        assert rig.heard[-1].attended is False

    asyncio.run(play())
    assert rig.asked == []


async def first_sample(rig, address):
    """Wait until a page that answers is shown a sample, and frames have been made for a while."""
    give_up = time.monotonic() + PATIENCE_S
    async with websockets.connect(address) as page:
        while "T" not in (frame := await next_frame(rig, page)) or frame["n"] <= 2 * BEHIND:
            assert time.monotonic() < give_up, "no frame shows the rig's sample"
            await page.send(json.dumps({"a": frame["n"]}))


async def next_frame(rig, wire):
    """The next frame, whenever it comes."""
    give_up = time.monotonic() + PATIENCE_S
    while time.monotonic() < give_up:
        frames, _ = await collect(rig, wire, 1)
        if frames:
            return frames[0]
    raise AssertionError("no frame")


async def _open_from(origin, address):
    async with websockets.connect(address, origin=origin):
        pass


async def collect(rig, wire, ticks):
    """Frames and other messages that come within so many 50 ms."""
    frames, others = [], {"s": [], "l": [], "p": []}
    until = time.monotonic() + 0.05 * ticks
    while time.monotonic() < until:
        rig.executor.spin_once(timeout_sec=0.0)
        try:
            message = json.loads(await asyncio.wait_for(wire.recv(), 0.01))
        except asyncio.TimeoutError:
            continue
        frames.append(message) if message["k"] == "f" else others[message["k"]].append(message)
    return frames, others


def markers_draw_the_rig(rig):
    rig.spin(lambda: len(rig.drawn) > 3, "markers")
    kinds = {marker.ns for marker in rig.drawn[-1].markers}
    assert {"cables", "platform", "reflectors", "frame"} <= kinds
    assert sum(marker.ns == "cables" for marker in rig.drawn[-1].markers) == 8


async def foxglove_values(rig, port):
    """Values of one live message, as a viewer gets them."""
    give_up = time.monotonic() + PATIENCE_S
    link = await websockets.connect(f"ws://127.0.0.1:{port}", subprotocols=["foxglove.sdk.v1"])
    async with link:
        found = {}
        while len(found) < 2:
            message = await asyncio.wait_for(link.recv(), PATIENCE_S)
            if isinstance(message, str) and '"advertise"' in message:
                found.update({c["topic"]: c["id"] for c in json.loads(message)["channels"]})
        assert set(found) == {"/cabols/scene", "/cabols/live"}
        wanted = [{"id": 1, "channelId": found["/cabols/live"]}]
        await link.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
        while True:
            rig.executor.spin_once(timeout_sec=0.0)
            try:
                message = await asyncio.wait_for(link.recv(), 0.02)
            except asyncio.TimeoutError:
                assert time.monotonic() < give_up, "no live message"
                continue
            if isinstance(message, bytes) and b"tension_n" in message:
                return json.loads(message[message.index(b"{") :])
