# SPDX-License-Identifier: Apache-2.0
"""Executables of this package that join the ROS graph; see setup.cfg."""

from __future__ import annotations

from cabols_control.node_command import node, tool
from cabols_sim.fault_campaign.command import fault_campaign_parser

plant = node("plant", "cabols_sim.nodes.plant")
slow_limb_controller = node("slow_limb_controller", "cabols_sim.nodes.slow_limb_controller")
fault_campaign = tool("cabols_sim.ros.fault_campaign", fault_campaign_parser)
