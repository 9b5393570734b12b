# SPDX-License-Identifier: Apache-2.0
"""Executables of this package that join the ROS graph; see setup.cfg."""

from __future__ import annotations

from cabols_control.commissioning.command import commission_parser, power_on_parser
from cabols_control.node_command import node, tool

NODES = "cabols_control.nodes"
limb_controller = node("limb_controller", f"{NODES}.limb_controller")
wrench_controller = node("wrench_controller", f"{NODES}.wrench_controller")
supervisor = node("supervisor", f"{NODES}.supervisor")
load_program = node("load_program", f"{NODES}.load_program")
recorder = node("recorder", f"{NODES}.recorder")
console = node("console", f"{NODES}.console")
markers = node("markers", f"{NODES}.markers")
frames = node("frames", f"{NODES}.frames")
ros2_control_bridge = node("ros2_control_bridge", f"{NODES}.ros2_control_bridge")
pose_estimator = node("pose_estimator", f"{NODES}.pose_estimator")
commission = tool(f"{NODES}.commission", commission_parser)
first_power_on = tool(f"{NODES}.first_power_on", power_on_parser)
