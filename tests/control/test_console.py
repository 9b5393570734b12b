# SPDX-License-Identifier: Apache-2.0
"""The console's pure parts: access, command, uploads, what is shown, feasibility, watchdog."""

from __future__ import annotations

import asyncio
import importlib
import json
import re
import threading
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from cabols_control.console.access import COOKIE, AccessPolicy, Lease, Request, is_loopback
from cabols_control.console.dispatcher import ALIVE_S, Answer, Dispatcher, Settings
from cabols_control.console.latest import EVENTS, FAULT, INFO, LatestValues
from cabols_control.console.middleware import AccessMiddleware
from cabols_control.console.panels.live_view import health_html
from cabols_control.console.preview import preview_svg
from cabols_control.console.reports import finished, report_file
from cabols_control.console.uploads import (
    ROWS,
    UPLOAD_BYTES,
    UploadError,
    keep_upload,
    program_choices,
    safe_stem,
)
from cabols_control.console.view3d.foxglove_link import (
    LIVE_SCHEMA,
    LIVE_TOPIC,
    SCENE_TOPIC,
    live_message,
    scene_update,
)
from cabols_control.console.view3d.scene import joint_points, load_scene, scene_numbers
from cabols_control.console.view3d.shapes import rig_shapes, rod
from cabols_control.console.view_models import (
    Measured,
    device_rows,
    estimate_rows,
    first_report,
    loop_rows,
    mode_view,
)
from cabols_control.errors import CabolsError, ConfigError
from cabols_control.geometry import load_geometry
from cabols_control.kinematics import structure_matrix
from cabols_control.load_programs.feasibility import check_program
from cabols_control.load_programs.programs import BUILT_IN, load_program
from cabols_control.ros.messages import topics
from cabols_control.supervision.faults import FaultName
from cabols_control.supervision.held_load import held_text
from cabols_control.supervision.modes import MOVING, NEXT, NEXT_HANGING, ModeMachine, OperatingMode
from cabols_control.supervision.operator_watchdog import OperatorWatchdog
from cabols_control.supervision.supervision_config import SupervisionConfig
from cabols_control.supervision.supervisor import Supervision
from cabols_control.tension import distribute
from cabols_hw.abb.configurations import load_configurations
from cabols_hw.tracker.config import load_tracker_config
from cabols_sim.devices.robot.kinematics import Arm

TOKEN = "a-token-of-the-tests-0123456789"
HEADER = "time_s,fx_n,fy_n,fz_n,mx_nm,my_nm,mz_nm\n"


def request(method="GET", websocket=False, cookies=None, query_token="", **headers):
    names = {name.replace("_", "-"): value for name, value in headers.items()}
    return Request(
        method, websocket, {"host": "127.0.0.1:8080", **names}, cookies or {}, query_token
    )


# --- access ---


@pytest.mark.parametrize("host", ["0.0.0.0", "192.168.1.5", "::", "rig.example.org"])
def test_another_address_than_loopback_demands_a_token(host):
    assert not is_loopback(host)
    with pytest.raises(ConfigError, match="token_file"):
        AccessPolicy(host)
    with pytest.raises(ConfigError, match="at least 16"):
        AccessPolicy(host, "short")
    assert AccessPolicy(host, TOKEN).needs_token


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "::1", "127.3.2.1"])
def test_loopback_needs_none(host):
    assert is_loopback(host)
    assert AccessPolicy(host).admitted(request())


def test_foreign_pages_and_names_are_refused():
    policy = AccessPolicy("127.0.0.1")
    assert not policy.foreign(request("POST", origin="http://127.0.0.1:8080"))
    assert policy.foreign(request("POST", origin="http://evil.example"))
    assert policy.foreign(request(websocket=True, origin="http://evil.example"))
    assert policy.foreign(request(host="evil.example:8080")), "a foreign DNS points here"
    assert policy.foreign(request("POST", sec_fetch_site="cross-site"))
    assert not policy.foreign(request(host="localhost:8080"))
    assert not policy.foreign(request(host="[::1]:8080"))


def test_token_is_admitted_in_three_places_and_nothing_else_is():
    policy = AccessPolicy("0.0.0.0", TOKEN)
    assert policy.admitted(request(authorization=f"Bearer {TOKEN}"))
    assert policy.admitted(request(query_token=TOKEN))
    assert policy.admitted(request(cookies={COOKIE: policy.session}))
    for wrong in (
        request(),
        request(authorization=f"Basic {TOKEN}"),
        request(authorization="Bearer "),
        request(query_token=TOKEN[:-1]),
        request(cookies={COOKIE: TOKEN}),
        request(cookies={COOKIE: AccessPolicy("0.0.0.0", TOKEN).session}),
    ):
        assert not policy.admitted(wrong)


async def reached(scope, receive, send):
    """An application that reads the body and answers."""
    if scope["type"] == "websocket":
        await send({"type": "websocket.accept"})
        return
    size = 0
    while True:
        message = await receive()
        size += len(message.get("body", b""))
        if not message.get("more_body"):
            break
    await send({"type": "http.response.start", "status": 200, "headers": []})
    await send({"type": "http.response.body", "body": str(size).encode()})


def through_gate(policy, kind="http", path="/", method="GET", headers=(), body=(b"",), query=b""):
    sent = []
    chunks = list(body)

    async def receive():
        chunk = chunks.pop(0)
        return {"type": "http.request", "body": chunk, "more_body": bool(chunks)}

    async def send(message):
        sent.append(message)

    scope = {
        "type": kind,
        "path": path,
        "method": method,
        "query_string": query,
        "headers": [(b"host", b"127.0.0.1:8080"), *headers],
    }
    asyncio.run(AccessMiddleware(reached, policy, 1000)(scope, receive, send))
    return sent


def status_of(sent):
    return sent[0].get("status", sent[0]["type"])


def test_gate_holds_everything_behind_the_token(monkeypatch):
    monkeypatch.setattr("cabols_control.console.middleware.WRONG_TOKEN_S", 0.0)
    policy = AccessPolicy("0.0.0.0", TOKEN)
    for path in ("/", "/api/emergency_stop", "/console/live.js", "/_nicegui_ws/socket.io"):
        assert status_of(through_gate(policy, path=path, method="POST")) == 401
    assert status_of(through_gate(policy, "websocket", "/live")) == "websocket.close"
    page = through_gate(policy, headers=[(b"accept", b"text/html")])
    assert (status_of(page), dict(page[0]["headers"])[b"location"]) == (303, b"/login")
    assert status_of(through_gate(policy, path="/login")) == 200
    wrong = through_gate(policy, path="/login", method="POST", body=[b"token=no"])
    assert status_of(wrong) == 401
    right = through_gate(policy, path="/login", method="POST", body=[f"token={TOKEN}".encode()])
    cookie = dict(right[0]["headers"])[b"set-cookie"]
    assert status_of(right) == 303
    assert b"HttpOnly" in cookie
    assert b"SameSite=Strict" in cookie
    assert TOKEN.encode() not in cookie
    shown = [(b"cookie", cookie.partition(b";")[0])]
    assert status_of(through_gate(policy, headers=shown)) == 200
    assert (
        status_of(through_gate(policy, "websocket", "/live", headers=shown)) == "websocket.accept"
    )
    moved = through_gate(policy, path="//evil.example", query=f"token={TOKEN}".encode())
    assert dict(moved[0]["headers"])[b"location"] == b"/evil.example"


def test_gate_counts_bodies_that_declare_their_size_and_those_that_do_not():
    policy = AccessPolicy("127.0.0.1")
    fits = through_gate(policy, method="POST", body=[b"x" * 500, b"x" * 500])
    assert (status_of(fits), fits[1]["body"]) == (200, b"1000")
    assert status_of(through_gate(policy, method="POST", body=[b"x" * 600, b"x" * 600])) == 413
    declared = [(b"content-length", b"1001")]
    assert status_of(through_gate(policy, method="POST", headers=declared, body=[])) == 413


# --- command ---


class FakeRig:
    """Answers yes; keeps what it was asked."""

    def __init__(self):
        self.asked = []

    async def call(self, service, fields):
        self.asked.append((service, fields))
        return Answer(True, "done")

    async def start(self, action, fields):
        return await self.call(action, fields)

    async def cancel(self, action):
        return await self.call(action, {})


@pytest.fixture
def dispatcher(tmp_path):
    settings = Settings("test", tmp_path, tmp_path, 3, {}, 8)
    found = Dispatcher(FakeRig(), LatestValues(), settings)
    found.now = 100.0
    found._clock = lambda: found.now
    return found


def test_one_operator_others_watch_all_may_stop(dispatcher):
    first = dispatcher.open("one", "browser a", "x")
    second = dispatcher.open("two", "browser b", "y")
    call = lambda page, what, **f: asyncio.run(dispatcher.call(page, what, **f))  # noqa: E731
    assert "take command" in call("one", "set_mode", mode=1).message
    assert dispatcher.take("one").success
    assert first.name in dispatcher.take("two").message
    assert call("one", "set_mode", mode=1).success
    assert not call("two", "set_mode", mode=1).success
    refused = asyncio.run(dispatcher.start("two", "run_program", program="ramps", scale=1.0))
    assert not refused.success
    assert not asyncio.run(dispatcher.cancel("two", "run_program")).success
    assert call("two", "emergency_stop").success
    assert [what for what, _ in dispatcher.rig.asked] == ["set_mode", "emergency_stop"]
    assert not dispatcher.release("two").success
    assert dispatcher.release("one").success
    assert dispatcher.take("two").success
    assert second.name in dispatcher.lease.refusal("one")


def test_a_page_that_does_not_answer_loses_command(dispatcher):
    dispatcher.open("one", "browser a", "x")
    dispatcher.take("one")
    assert dispatcher.lease.attended
    other = dispatcher.open("two", "browser b", "y")
    dispatcher.now += 1.01 * ALIVE_S
    assert not dispatcher.lease.attended
    dispatcher.heard(other)
    assert dispatcher.lease.holder.page == "one", "another browser's page must ask"
    assert dispatcher.take("two").success


def test_a_page_that_is_loaded_again_stays_in_command(dispatcher):
    pages = (dispatcher.open(name, "browser a", "x") for name in ("one", "two", "three"))
    old, beside, again = pages
    old.tab, beside.tab, again.tab = "left", "right", "left"
    dispatcher.take("one")
    dispatcher.heard(again)
    assert dispatcher.lease.holder.page == "one", "the old page still answers"
    dispatcher.lost(old)
    dispatcher.heard(beside)
    assert dispatcher.lease.holder.page == "one", "another tab has another identity"
    dispatcher.heard(again)
    assert dispatcher.lease.holder.page == "three"
    assert dispatcher.lease.attended


def test_lease_is_nobodys_at_first():
    lease = Lease(lambda _: True)
    assert not lease.attended
    assert not lease.release("x")
    assert "nobody" in lease.refusal("x")


# --- operator watchdog ---


def test_operator_watchdog_arms_with_an_operator_and_disarms_at_rest():
    watch = OperatorWatchdog(5.0)
    assert not watch.overdue(1e6, at_rest=False), "a rig that no console attends runs on"
    watch.hear(10.0, False, "")
    assert not watch.armed
    watch.hear(10.0, True, "page 1")
    watch.hear(12.0, False, "")
    assert not watch.overdue(15.0, at_rest=False)
    assert "page 1" in watch.overdue(15.1, at_rest=False)
    assert watch.overdue(16.0, at_rest=False), "until it is at rest"
    assert not watch.overdue(16.1, at_rest=True)
    assert not watch.overdue(17.0, at_rest=False), "then somebody else may lead it"


@pytest.mark.parametrize("mode", MOVING)
def test_abandoned_rig_comes_to_rest_from_every_mode(mode):
    machine = ModeMachine()
    machine.entry = machine.entry._replace(mode=mode)
    machine.pending = OperatingMode.FREE_MOVING
    machine.abandon("unattended: test")
    if mode in (OperatingMode.LOADING, OperatingMode.UNLOADING):
        assert machine.mode == OperatingMode.UNLOADING
        machine.unloaded()
    assert (machine.mode, machine.reason) == (OperatingMode.STOPPED, "unattended: test")


def test_abandoning_at_rest_or_in_fault_changes_nothing():
    core = Supervision(SupervisionConfig())
    core.abandon("unattended: test")
    assert (core.mode, core.reason) == (OperatingMode.STOPPED, "start")
    core.emergency_stop("emergency stop")
    core.abandon("unattended: test")
    assert core.reason == "emergency stop"


# --- uploads ---


def test_upload_is_kept_and_offered(tmp_path):
    content = ("\ufeff" + HEADER + "0,0,0,0,0,0,0\n1,5,0,0,0,0,0\n").encode()
    kept = keep_upload(tmp_path / "new", "../../My loads (2).CSV", content)
    assert kept.path == (tmp_path / "new" / "My_loads_2.csv").resolve()
    assert kept.program.duration == 1.0
    assert load_program(str(kept.path)).wrench[-1, 0] == 5.0
    offered = program_choices(tmp_path / "new")
    assert set(BUILT_IN) < set(offered)
    assert offered[str(kept.path)] == "My_loads_2 (uploaded)"


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a.txt", b"", "expected a .csv"),
        ("..csv", b"", "letters or digits"),
        ("a.csv", b"x" * (UPLOAD_BYTES + 1), "at most 2000000 bytes"),
        ("a.csv", b"\xff\xfe\x00", "UTF-8"),
        ("a.csv", b"", "expected the header"),
        ("a.csv", HEADER.encode(), "at least two lines"),
        ("a.csv", b"\n" * (ROWS + 1), "at most 50000 lines"),
        ("a.csv", (HEADER + "0,0,0,0,0,0,0\n1,nan,0,0,0,0,0\n").encode(), "line 3"),
        ("a.csv", (HEADER + "0,0,0,0,0,0,0\n1,x,0,0,0,0,0\n").encode(), "line 3"),
        ("a.csv", (HEADER + "0,0,0,0,0,0,0\n-1,0,0,0,0,0,0\n").encode(), "increasing"),
        ("a.csv", (HEADER + "0,0,0,0,0,0,0\n1e9,0,0,0,0,0,0\n").encode(), "at most 3600 s"),
        ("a.csv", (HEADER + '"' + "0" * 200_000).encode(), "cannot be read"),
    ],
)
def test_upload_is_refused_and_nothing_is_kept(tmp_path, name, content, said):
    with pytest.raises(CabolsError, match=said):
        keep_upload(tmp_path, name, content)
    assert not list(tmp_path.iterdir())


def test_file_names_of_browsers_stay_in_the_folder():
    assert safe_stem("C:\\loads\\a b.csv") == "a_b"
    assert safe_stem("/etc/passwd\x00.csv") == "passwd"
    with pytest.raises(UploadError):
        safe_stem("../..")


def test_reports_are_served_from_their_folder_only(tmp_path):
    root = tmp_path / "campaigns"
    for name in ("one", "two"):
        (root / name).mkdir(parents=True)
        (root / name / "report.html").write_text(name)
    (tmp_path / "secret.html").write_text("secret")
    (root / "one" / "link.html").symlink_to(tmp_path / "secret.html")
    assert {report.name for report in finished(root)} == {"one", "two"}
    assert report_file(root, "one/report.html").read_text() == "one"
    for name in ("../secret.html", "one/../../secret.html", "one/link.html", "three/report.html"):
        assert report_file(root, name) is None
    assert report_file(root, str(tmp_path / "secret.html")) is None
    assert finished(tmp_path / "nothing") == []


# --- feasibility ---


@pytest.mark.parametrize("name", BUILT_IN)
def test_built_in_programmes_are_feasible_where_the_rig_stands(rig, name):
    geometry = rig.geometry
    place = (geometry.reference_position, geometry.reference_rotation)
    found = check_program(rig, load_program(name), *place)
    assert found.feasible
    assert found.worst is None
    # Nothing between two points is worse than the points: they are what was checked.
    matrix = structure_matrix(geometry, *place)
    limits = (rig.control.tension_min, rig.control.tension_max)
    for time_s in np.linspace(0.0, found.program.duration, 60):
        solution = distribute(matrix, found.program.at(time_s), *limits)
        assert solution.feasible
        assert found.tension.min() - 1e-9 <= solution.tension.min()


def test_too_large_a_programme_is_found_with_its_worst_time(rig):
    place = (rig.geometry.reference_position, rig.geometry.reference_rotation)
    found = check_program(rig, load_program("ramps").scaled(6.0), *place)
    assert not found.feasible
    matrix = structure_matrix(rig.geometry, *place)
    limits = (rig.control.tension_min, rig.control.tension_max)
    each = [distribute(matrix, w, *limits, method="daqp") for w in found.program.wrench]
    np.testing.assert_array_equal(found.reached, [s.feasible for s in each])
    assert "at" in found.sentence()
    assert found.worst in found.preview()
    svg = preview_svg(
        found.program.time.tolist(),
        found.program.wrench.ravel().tolist(),
        float(found.program.time[found.worst]),
        'x"<y>',
    )
    assert "not feasible" in svg
    assert "<y>" not in svg


def test_sensor_range_counts_in_the_platforms_axes(rig):
    program = load_program("steps")
    wide = type(program)(
        "wide", np.array([0.0, 1.0]), np.array([[0.0] * 6, [0, 0, 200.0, 0, 0, 0]]), False
    )
    turn = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    upright = check_program(rig, wide, rig.geometry.reference_position, np.eye(3))
    lying = check_program(rig, wide, rig.geometry.reference_position, turn)
    assert upright.rated.all(), "495 N along the sensor's axis"
    assert not lying.rated.all(), "165 N across it"


# --- what is shown ---


def test_latest_values_serve_many_threads_and_forget_the_oldest():
    box = LatestValues()
    news = []
    box.on_news = lambda: news.append(box.frame()[0])
    threads = [
        threading.Thread(target=lambda k=k: [box.put_frame({"T": [k]}) for _ in range(50)])
        for k in range(4)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert box.frame()[0] == 200
    assert len(news) == 200
    assert json.loads(box.frame()[1])["n"] == 200
    for k in range(EVENTS + 10):
        box.tell(INFO, "node", f"event {k}")
    events = box.events_after(0)
    assert len(events) == EVENTS
    assert events[-1].text == f"event {EVENTS + 9}"
    box.tell(FAULT, "node", "twice")
    box.tell(FAULT, "node", "twice")
    assert [e.text for e in box.events_after(events[-1].number)] == ["twice"]
    version = box.state_text()[0]
    box.put_state(mode=1)
    assert box.state_text()[0] == version + 1
    box.put_state(mode=1)
    assert box.state_text()[0] == version + 1, "nothing new"


@pytest.mark.parametrize("mode", OperatingMode)
def test_mode_view_offers_what_the_machine_allows(mode):
    shown = mode_view(int(mode), "why")
    assert set(shown["next"]) <= {int(m) for m in NEXT[mode]}
    assert shown["name"] == mode.name
    assert mode_view(None, "")["next"] == []
    hanging = set(mode_view(int(mode), "why", hangs=True)["next"])
    assert hanging == {int(m) for m in NEXT_HANGING[mode]}, "nothing that would let it go"


@pytest.mark.parametrize("mode", [OperatingMode.STOPPED, OperatingMode.FAULT])
def test_page_says_what_load_remains_where_nothing_moves(mode):
    """After an emergency stop under 60 N, and after its reset, "Stopped" alone is not the truth."""
    zeroed, closed = np.ones(8, dtype=bool), np.ones(8, dtype=bool)
    tension = np.array([60.0, 20.0, 5.0, 3.0, 1.0, 1.0, 8.0, 9.0])
    held = held_text(tension, zeroed, closed, 47.0)
    shown = mode_view(int(mode), "reset", held)
    assert shown["text"].endswith("under load")
    for said in ("limbs 1 and 2 pull", "about 60 N", "the sensor shows about 45 N", "reset"):
        assert said in shown["reason"]
    assert mode_view(int(OperatingMode.LOADING), "", held)["text"] == "Loading"


@pytest.mark.parametrize(
    ("tension", "zeroed", "closed", "said"),
    [
        (4.0, True, False, ""),
        (np.nan, False, False, ""),
        (np.nan, False, True, "how much is not known"),
        (30.0, True, True, "about 30 N"),
    ],
)
def test_held_load_is_what_zeros_and_switches_show(tension, zeroed, closed, said):
    text = held_text(*(np.full(8, value) for value in (tension, zeroed, closed)), np.nan)
    assert said in text
    assert bool(text) == bool(said)
    assert "sensor" not in text, "a wrench that is not known is not told"


def test_page_shows_with_which_configuration_the_rig_was_started():
    assert "bench, fingerprint 0123456789ab" in health_html("bench, fingerprint 0123456789ab")
    assert "<b>" not in health_html("<b>")


def report(node, state, reason, heard_s=100.0, fault=None):
    return first_report(node, state, reason, heard_s, fault)


def test_health_is_a_word_and_a_reason_never_a_colour_alone():
    reports = {
        "plant": report(
            "plant",
            2,
            "sensor_flat: gauge 4 has shown 0.15 V for 0.2 s",
            fault=FaultName.SENSOR_FLAT,
        ),
        "abb_tracker_bridge": report("abb_tracker_bridge", 1, "", 90.0),
        "wrench_controller": report(
            "wrench_controller", 1, "desired_wrench: refused", fault=FaultName.DESIRED
        ),
    }
    rows = {row["node"]: row for row in loop_rows(reports, 100.0)}
    assert [rows[n]["word"] for n in sorted(rows)] == ["silent", "FAULT", "check"]
    devices = {r["device"]: r for r in device_rows(reports, None, 100.0)}
    assert devices["Q8 card"]["level"] == "ok"
    assert devices["Force/torque sensor"]["level"] == "fault"
    assert devices["Robot (EGM)"]["level"] == "off"
    broken = Measured(1, False, "beam broken", 0.0)
    assert "beam broken" in device_rows(reports, broken, 100.0)[3]["text"]
    assert all(row["text"] for row in devices.values())
    json.dumps([list(rows.values()), list(devices.values())], allow_nan=False)


def test_estimate_shows_intervals_of_what_is_identified():
    shown = estimate_rows(
        [1000.0, float("nan"), 5.0, 1.0, 1.0, 1.0],
        [10.0, 1.0, 0.5, 1.0, 1.0, 1.0],
        [True, True, True, False, False, False],
        7,
        0.1,
    )
    first, second = shown["joints"][:2]
    assert (first["low"], first["high"]) == (980.0, 1020.0)
    assert second["stiffness"] is None
    assert shown["joints"][3]["stiffness"] is None
    json.dumps(shown, allow_nan=False)


# --- the scene ---


def test_scene_draws_the_bench_that_is_simulated(rig):
    scene = load_scene()
    tracker = load_tracker_config()
    np.testing.assert_allclose(scene.reflectors, tracker.reflectors)
    np.testing.assert_allclose(scene.tracker, tracker.base_position)
    arm = Arm()
    configurations = load_configurations()
    for index in range(len(configurations)):
        joints = configurations.joints(index)
        position = arm.solve(np.asarray(joints))[0]
        np.testing.assert_allclose(joint_points(scene, joints)[-1], position, atol=1e-12)
    numbers = scene_numbers(rig, scene)
    json.dumps(numbers, allow_nan=False)
    assert len(numbers["base_points"]) == rig.geometry.cables


def test_scene_says_what_is_wrong(tmp_path):
    path = tmp_path / "scene.yaml"
    path.write_text("reflectors: [[0, 0, 0]]\njoint_axes: [0, 1]\n")
    with pytest.raises(ConfigError, match="together"):
        load_scene(path=path)
    path.write_text("reflectors: [[0, 0]]\n")
    with pytest.raises(ConfigError, match="reflectors"):
        load_scene(path=path)


# --- layouts for others' tools ---

LAYOUTS = Path(__file__).resolve().parents[2] / "cabols_control" / "layouts"


def message_field(msg_type, path):
    """Type of a message's field by a path with slashes; None if there is none."""
    kind = None
    for part in path.split("/"):
        fields = msg_type.get_fields_and_field_types()
        kind = fields.get(part.partition("[")[0])
        if kind is None:
            return None
        if "/" in kind and "<" not in kind:
            package, name = kind.split("/")
            msg_type = getattr(importlib.import_module(f"{package}.msg"), name)
    return kind


def test_foxglove_layout_names_what_the_link_sends(rig):
    layout = json.loads((LAYOUTS / "foxglove.json").read_text())
    panels = layout["configById"]
    assert list(panels["3D!rig"]["topics"]) == [SCENE_TOPIC]
    frame = {"T": [1.0] * 8, "A": [1.0] * 8, "C": [0.0] * 8, "w": [1.0] * 6, "d": [2.0] * 6}
    sent = live_message(frame)
    assert set(sent) <= set(LIVE_SCHEMA["properties"])
    paths = [path["value"] for panel in panels.values() for path in panel.get("paths", ())]
    assert len(paths) == 20
    for path in paths:
        found = re.fullmatch(r"(/[\w/]+)\.(\w+)(?:\.(\w+)|\[(\d+)\])", path)
        topic, name, axis, index = found.groups()
        assert topic == LIVE_TOPIC
        assert isinstance(sent[name][axis or int(index)], float)
    assert "P" not in frame
    update = scene_update(rig, rig_shapes(rig, load_scene(), frame)).encode()
    for group in (b"cables", b"platform", b"reflectors", b"frame"):
        assert group in update


def test_rviz_configuration_reads_topics_that_exist():
    layout = yaml.safe_load((LAYOUTS / "cabols.rviz").read_text())
    shown = layout["Visualization Manager"]
    topics_read = [d["Topic"]["Value"] for d in shown["Displays"] if "Topic" in d]
    assert topics_read[0] == "/cabols/markers"
    for topic in topics_read[1:]:
        assert topic.removeprefix("/cabols/live/") in topics.TYPES
    assert shown["Global Options"]["Fixed Frame"] == load_geometry().base_frame


def test_plotjuggler_layout_plots_fields_that_exist():
    root = ElementTree.parse(LAYOUTS / "plotjuggler.xml").getroot()
    curves = [curve.get("name") for curve in root.iter("curve")]
    assert len(curves) == 28
    for curve in curves:
        topic, _, path = curve.removeprefix("/cabols/live/").partition("/")
        assert message_field(topics.TYPES[topic], path), curve
    subscribed = {topic.get("name") for topic in root.iter("topic")}
    assert subscribed == {"/".join(curve.split("/")[:4]) for curve in curves}


def test_shapes_lie_between_their_ends(rig, random):
    for _ in range(50):
        start, end = random.normal(size=(2, 3))
        shape = rod("cables", start, end, 0.01, (0.0, 0.0, 0.0))
        half = 0.5 * shape.size[2] * Rotation.from_quat(shape.quaternion).as_matrix()[:, 2]
        np.testing.assert_allclose(shape.position + half, end, atol=1e-9)
    down = rod("cables", np.zeros(3), np.array([0.0, 0.0, -1.0]), 0.01, (0.0, 0.0, 0.0))
    axis = Rotation.from_quat(down.quaternion).as_matrix()[:, 2]
    np.testing.assert_allclose(np.abs(axis), [0.0, 0.0, 1.0], atol=1e-9)
