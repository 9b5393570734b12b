# SPDX-License-Identifier: Apache-2.0
"""What a rig's computer remembers between starts."""

from __future__ import annotations

import os
from pathlib import Path


def state_folder() -> Path:
    """Folder for what a rig remembers: $XDG_STATE_HOME/cabols, or ~/.local/state/cabols."""
    base = os.environ.get("XDG_STATE_HOME", "")
    return (Path(base) if base else Path.home() / ".local" / "state") / "cabols"
