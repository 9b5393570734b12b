# SPDX-License-Identifier: Apache-2.0
"""Executables of this package that join the ROS graph; see setup.cfg."""

from __future__ import annotations

from cabols_control.node_command import node, tool
from cabols_stiffness.campaign.command import run_campaign_parser

NODES = "cabols_stiffness.nodes"
stiffness_campaign = node("stiffness_campaign", f"{NODES}.stiffness_campaign")
stiffness_identifier = node("stiffness_identifier", f"{NODES}.stiffness_identifier")
compensation = node("compensation", f"{NODES}.compensation")
run_campaign = tool(f"{NODES}.run_campaign", run_campaign_parser)
