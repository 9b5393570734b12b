# SPDX-License-Identifier: Apache-2.0
"""What the bridge's node takes from a mode: its number, its cause, its pre-tightening; no text."""

from types import SimpleNamespace

import pytest

from cabols_control.ros.messages.topics import mode_layout
from cabols_control.supervision.modes import MOVING, Cause, OperatingMode
from cabols_hw.ros.bridge_node import BridgeNode


def follow(mode, cause, reason, zeroing=0, active=True):
    """Let the node's method take one mode; return the node and how often it cut."""
    message = mode_layout(reason).record()
    message["mode"][0], message["cause"][0], message["zeroing"][0] = mode, cause, zeroing
    cuts = []
    node = SimpleNamespace(
        _mode_input=SimpleNamespace(take=lambda: True, record=mode_layout().read(message.raw())),
        _guard=SimpleNamespace(emergency_stop=lambda: cuts.append("cut")),
        _write=lambda: cuts.append("written"),
        _mode=OperatingMode.STOPPED,
        _zeroing=0,
        active=active,
    )
    BridgeNode._take_mode(node)
    return node, cuts


@pytest.mark.parametrize("reason", ["emergency stop", "plant: cable", "notaus", ""])
def test_an_emergency_stop_cuts_whatever_its_words(reason):
    node, cuts = follow(OperatingMode.FAULT, Cause.EMERGENCY_STOP, reason)
    assert cuts == ["cut", "written"]
    assert node._mode == OperatingMode.FAULT


@pytest.mark.parametrize("cause", [cause for cause in Cause if cause != Cause.EMERGENCY_STOP])
def test_no_word_of_an_emergency_cuts_what_an_ordinary_fault_may_unload(cause):
    node, cuts = follow(OperatingMode.FAULT, cause, "emergency stop")
    assert cuts == []
    assert node._mode == OperatingMode.FAULT


def test_the_number_of_a_pretightening_is_followed():
    node, cuts = follow(OperatingMode.PRETIGHTENING, Cause.REQUEST, "requested", zeroing=42)
    assert (node._mode, node._zeroing, cuts) == (OperatingMode.PRETIGHTENING, 42, [])


def test_an_inactive_bridge_follows_no_mode_that_moves():
    for mode in OperatingMode:
        node, cuts = follow(mode, Cause.REQUEST, "requested", active=False)
        assert node._mode == (OperatingMode.STOPPED if mode in MOVING else mode)
        assert cuts == []
