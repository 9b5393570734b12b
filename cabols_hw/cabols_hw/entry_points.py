# SPDX-License-Identifier: Apache-2.0
"""Executables of this package; see setup.cfg."""

from __future__ import annotations

from cabols_control.node_command import node

q8_ati_bridge = node("q8_ati_bridge", "cabols_hw.nodes.q8_ati_bridge")
abb_tracker_bridge = node("abb_tracker_bridge", "cabols_hw.nodes.abb_tracker_bridge")
