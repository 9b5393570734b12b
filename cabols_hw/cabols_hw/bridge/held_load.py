# SPDX-License-Identifier: Apache-2.0
"""What load the gears hold while the motors are off, by the bridge's sample; pure."""

from __future__ import annotations

import numpy as np

from cabols_control.supervision.held_load import held_text
from cabols_hw.bridge.bridge import Bridge


def held_load(bridge: Bridge) -> str:
    """Tell what the gears hold; empty where the cables are known to be unloaded.

    Args:
        bridge: with its newest sample, at rest.
    """
    force = float(np.linalg.norm(bridge.wrench[:3])) if bridge.tared else np.nan
    return held_text(bridge.tension, bridge.zeroed, bridge.switch_closed, force)
