# SPDX-License-Identifier: Apache-2.0
"""Errors of a run against the command, in the frame of the user's, on a platform that moves."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from bag_builder import T0, BagBuilder
from cabols_control.bags.reader import read_bag
from cabols_control.console.error_meter import ErrorMeter
from cabols_control.frames import load_wrench_frames
from cabols_control.geometry import load_geometry
from cabols_control.rig_folder import find_rig
from cabols_control.run_report.bag_report import report_bag
from cabols_control.run_report.judgement.errors_of_wrench import error_numbers
from cabols_control.run_report.programme import join_program
from cabols_control.run_report.user_frame import (
    frame_of,
    poses_at,
    recorded_frames,
    user_frame,
)

MS = 1_000_000
ASKED = np.array([12.0, 0.0, 0.0, 0.0, 0.0, 1.5])
OFF = np.array([0.3, -0.2, 0.1, 0.01, 0.02, -0.03])
TIP = {"position": [0.1, -0.05, 0.2], "rotation_xyz_deg": [25.0, -40.0, 110.0]}


def pose_at(t):
    turned = Rotation.from_rotvec([0.1 * t, 0.4 * t, -0.3 * t])
    return np.array([0.4 + 0.1 * t, 1.3, 0.9 - 0.05 * t]), turned


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """A programme in a frame of the platform's, felt with an error that is constant there."""
    folder = tmp_path_factory.mktemp("framed")
    rig = find_rig()
    content = yaml.safe_load(rig.file("frames.yaml").read_text())
    content["wrench_frames"] = {"tip": TIP}
    mine = folder / "rig"
    mine.mkdir()
    for file in rig.path.iterdir():
        if file.is_file():
            (mine / file.name).write_bytes(file.read_bytes())
    (mine / "frames.yaml").write_text(yaml.safe_dump(content))
    frames = load_wrench_frames(load_geometry(), str(mine))
    metadata = {f"{n}_yaml": (mine / f"{n}.yaml").read_text() for n in ("frames", "geometry")}
    with BagBuilder(folder / "run", metadata) as builder:

        def vectors(wrench):
            return {
                name: builder.make(
                    "geometry_msgs/msg/Vector3", **dict(zip("xyz", part, strict=True))
                )
                for name, part in (("force", wrench[:3]), ("torque", wrench[3:]))
            }

        def header(i, frame):
            time = builder.make("builtin_interfaces/msg/Time", sec=T0 // 10**9, nanosec=i * MS)
            return builder.make("std_msgs/msg/Header", stamp=time, frame_id=frame)

        wrench_type = "geometry_msgs/msg/Wrench"
        for i in range(400):
            place, turn = pose_at(0.001 * i)
            if i % 4 == 0:
                quaternion = dict(zip("xyzw", turn.as_quat(), strict=True))
                pose = builder.make(
                    "geometry_msgs/msg/Pose",
                    position=builder.make(
                        "geometry_msgs/msg/Point", **dict(zip("xyz", place, strict=True))
                    ),
                    orientation=builder.make("geometry_msgs/msg/Quaternion", **quaternion),
                )
                at = T0 + i * MS
                builder.add("platform_pose", "geometry_msgs/msg/PoseStamped", at, pose=pose)
                asked = builder.make(wrench_type, **vectors(ASKED))
                fields = {"command": asked, "smoothed": asked, "header": header(i, "tip")}
                builder.add("program_wrench", "cabols_msgs/msg/ProgramWrench", at, **fields)
            base = frames.to_base("tip", ASKED + OFF, place, turn.as_matrix())
            local = (base.reshape(2, 3) @ turn.as_matrix()).ravel()
            felt = builder.make(wrench_type, **vectors(local))
            builder.add("wrench", "geometry_msgs/msg/WrenchStamped", T0 + i * MS, wrench=felt)
    return folder / "run"


def test_errors_are_in_the_frame_of_the_command(bag):
    found = read_bag(bag)
    stamps = found["wrench"].stamp_ns
    frames = recorded_frames(found.metadata)
    assert frame_of(found, "program_wrench") == "tip"
    poses = poses_at(found, stamps)
    frame = user_frame(frames, "tip", poses)
    local = np.column_stack(
        [found["wrench"][f"wrench.{k}.{a}"] for k in ("force", "torque") for a in "xyz"]
    )
    measured = np.hstack(
        [np.einsum("kij,kj->ki", poses.rotation, part) for part in np.hsplit(local, 2)]
    )
    program = join_program(found, stamps, np.zeros_like(measured), frame)
    run = SimpleNamespace(
        program=program,
        measured=measured,
        uncertainty=np.full(measured.shape, np.nan),
        loading=np.arange(stamps.size) < stamps.size - 10,
    )
    numbers = error_numbers(run)
    force, torque = np.linalg.norm(OFF[:3]), np.linalg.norm(OFF[3:])
    for part in ("rms", "p95", "max"):
        assert numbers[f"command_error_{part}_force_n"] == pytest.approx(force, rel=1e-5)
        assert numbers[f"command_error_{part}_torque_nm"] == pytest.approx(torque, rel=1e-4)
    assert numbers["asked_error_rms_force_n"] == pytest.approx(abs(OFF[0]), rel=1e-5)
    assert numbers["idle_error_rms_force_n"] == pytest.approx(np.hypot(OFF[1], OFF[2]), rel=1e-5)
    assert numbers["idle_error_rms_torque_nm"] == pytest.approx(np.hypot(OFF[3], OFF[4]), rel=1e-4)
    # The command itself moves with the platform, in base axes.
    assert np.ptp(program.command[:, 0]) > 0.5


def test_the_report_draws_it_in_that_frame(bag, tmp_path):
    written = report_bag(bag, tmp_path / "report.html")
    assert "Wrench on the platform" in written.shown


def test_without_the_rigs_files_base_axes_are_taken(bag):
    found = read_bag(bag)
    assert recorded_frames({}) is None
    stamps = found["wrench"].stamp_ns
    assert user_frame(None, "tip", poses_at(found, stamps)) is None


def test_the_page_compares_at_the_moment_of_the_command():
    """Live copies of command and wrench are of different moments: a ramp must not seem late."""
    meter = ErrorMeter()
    assert meter.text() == ""
    for k in range(200):
        t = 0.05 * k
        meter.command(t, np.array([40.0 * t, 0.0, 0.0, 0.0, 0.0, 1.0]))
        meter.measure(t + 0.03, np.array([40.0 * (t + 0.03) + 0.2, 0.1, 0.0, 0.0, 0.0, 1.01]))
    numbers = meter.numbers()
    assert numbers[:3] == pytest.approx([np.hypot(0.2, 0.1)] * 3, abs=1e-6)
    assert numbers[3:6] == pytest.approx([0.01] * 3, abs=1e-9)
    assert numbers[6:] == pytest.approx([0.1, 0.0], abs=1e-9)
    assert "rms / 95 % / largest: force 0.22 / 0.22 / 0.22 N" in meter.text()
    meter.command(30.0, np.zeros(6))  # another programme
    assert meter.text() == ""


def test_the_page_says_nothing_of_idle_axes_where_none_is():
    meter = ErrorMeter()
    for k in range(5):
        meter.command(0.05 * k, np.ones(6))
        meter.measure(0.05 * k + 0.01, np.ones(6))
    assert "zero" not in meter.text()
