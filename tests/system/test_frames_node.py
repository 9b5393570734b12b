# SPDX-License-Identifier: Apache-2.0
"""/tf and /tf_static against pinocchio, with a stand-in for tf2_msgs, which has no wheel."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pinocchio
import pytest
from scipy.spatial.transform import Rotation

from cabols_control.bringup.processes import executable_path
from cabols_control.rig_tools.rig_urdf import rig_urdf, urdf_text
from cabols_hw.abb.configurations import load_configurations
from graph_harness import next_environment

pytestmark = [pytest.mark.ros, pytest.mark.long, pytest.mark.timeout(900)]

VENV = Path(sys.prefix)
TOLERANCE = 1e-12
SCRIPT = """
import json, sys, time
import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage
rclpy.init()
node = rclpy.create_node("viewer", namespace="/cabols")
latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
found, said = {}, []
def hear(message):
    for t in message.transforms:
        p, q = t.transform.translation, t.transform.rotation
        found[t.child_frame_id] = [t.header.frame_id, p.x, p.y, p.z, q.x, q.y, q.z, q.w]
node.create_subscription(TFMessage, "/tf", hear, 10)
node.create_subscription(TFMessage, "/tf_static", hear, latched)
node.create_subscription(String, "robot_description", lambda m: said.append(m.data), latched)
joints = node.create_publisher(JointState, "live/joint_states", 10)
names, angles = json.loads(sys.argv[1]), json.loads(sys.argv[2])
give_up = time.monotonic() + 120.0
wanted = {"cell/link_6", "cell/tracker"}
while time.monotonic() < give_up and not (said and wanted <= set(found)):
    joints.publish(JointState(name=names, position=angles))
    rclpy.spin_once(node, timeout_sec=0.05)
print(json.dumps({"found": found, "urdf": said[0] if said else ""}))
"""


@pytest.fixture(scope="module")
def stand_in(tmp_path_factory):
    """Environment in which a one-line tf2_msgs can be imported."""
    place = tmp_path_factory.mktemp("tf2")
    package = place / "src" / "tf2_msgs"
    (package / "msg").mkdir(parents=True)
    (package / "msg" / "TFMessage.msg").write_text("geometry_msgs/TransformStamped[] transforms\n")
    (package / "package.xml").write_text(
        '<package format="3"><name>tf2_msgs</name><version>0.0.0</version>'
        '<description>stand-in</description><maintainer email="a@example.org">a</maintainer>'
        "<license>Apache-2.0</license><buildtool_depend>ament_cmake</buildtool_depend>"
        "<member_of_group>rosidl_interface_packages</member_of_group>"
        "<export><build_type>ament_cmake</build_type></export></package>"
    )
    (package / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.10)\nproject(tf2_msgs)\n"
        "find_package(ament_cmake REQUIRED)\nfind_package(rosidl_default_generators REQUIRED)\n"
        "find_package(geometry_msgs REQUIRED)\n"
        'rosidl_generate_interfaces(tf2_msgs "msg/TFMessage.msg" DEPENDENCIES geometry_msgs)\n'
        "ament_package()\n"
    )
    prefix = place / "prefix"
    environment = {
        **os.environ,
        "AMENT_PREFIX_PATH": str(VENV),
        "CMAKE_PREFIX_PATH": str(VENV),
        "PATH": f"{VENV / 'bin'}{os.pathsep}{os.environ['PATH']}",
    }
    command = [str(VENV / "bin/colcon"), "--log-base", str(place / "log"), "build"]
    command += ["--base-paths", str(package), "--build-base", str(place / "build")]
    command += ["--merge-install", "--install-base", str(prefix), "--cmake-args", "-G", "Ninja"]
    command += ["-DBUILD_TESTING=OFF", f"-DPython3_EXECUTABLE={VENV / 'bin/python'}"]
    built = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stdout[-3000:] + built.stderr[-3000:]
    (found,) = prefix.rglob("tf2_msgs/__init__.py")
    libraries = os.pathsep.join([str(prefix / "lib"), os.environ.get("LD_LIBRARY_PATH", "")])
    return {
        "PYTHONPATH": os.pathsep.join([str(found.parents[1]), os.environ.get("PYTHONPATH", "")]),
        "LD_LIBRARY_PATH": libraries.strip(os.pathsep),
        "AMENT_PREFIX_PATH": os.pathsep.join([str(prefix), str(VENV)]),
    }


def test_frames_are_where_pinocchio_has_them(stand_in):
    environment = {**os.environ, **next_environment(), **stand_in}
    stored = load_configurations()
    q = stored.joints(2)
    names = [f"joint_{i}" for i in range(1, 7)]
    command = [str(executable_path("cabols_control", "frames")), "--ros-args"]
    node = subprocess.Popen(
        [*command, "-p", "robot:=true", "-p", "frame_prefix:=cell/"], env=environment
    )
    try:
        seen = subprocess.run(
            [sys.executable, "-c", SCRIPT, json.dumps(names), json.dumps(list(q))],
            env=environment,
            capture_output=True,
            text=True,
            timeout=300.0,
            check=False,
        )
        assert seen.returncode == 0, seen.stderr
    finally:
        node.send_signal(signal.SIGINT)
        assert node.wait(60.0) == 0
    answer = json.loads(seen.stdout.splitlines()[-1])
    assert answer["urdf"] == urdf_text(rig_urdf())
    model = pinocchio.buildModelFromXML(answer["urdf"])
    data = model.createData()
    pinocchio.framesForwardKinematics(model, data, np.array(q))
    found = answer["found"]
    wanted = {"platform", "sensor", "tracker", "link_6", "reflector_3", "anchor_8", "attachment_1"}
    assert {f"cell/{name}" for name in wanted} <= set(found)
    for name in wanted:
        position, rotation, frame = np.zeros(3), np.eye(3), f"cell/{name}"
        while frame != "cell/rig_base":
            frame, *numbers = found[frame]
            turn = Rotation.from_quat(numbers[3:]).as_matrix()
            position, rotation = np.array(numbers[:3]) + turn @ position, turn @ rotation
        place = data.oMf[model.getFrameId(name)]
        np.testing.assert_allclose(position, place.translation, atol=TOLERANCE, rtol=0)
        np.testing.assert_allclose(rotation, place.rotation, atol=TOLERANCE, rtol=0)


def test_without_tf2_msgs_the_node_says_what_to_install():
    done = subprocess.run(
        [str(executable_path("cabols_control", "frames"))],
        env={**os.environ, **next_environment()},
        capture_output=True,
        text=True,
        timeout=120.0,
        check=False,
    )
    assert done.returncode == 2
    assert "install ros-jazzy-tf2-msgs" in done.stderr
