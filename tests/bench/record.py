# SPDX-License-Identifier: Apache-2.0
"""Write a benchmark's figures with when, where and of which commit they were measured."""

from __future__ import annotations

import json
import os
import platform
import subprocess
from collections.abc import Mapping
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]


def write_figures(path: Path, figures: Mapping[str, Any]) -> None:
    """Write figures as JSON, with the circumstances of the run under `run`.

    Args:
        path: file to write; its folder is made.
        figures: what was measured, with units in the keys.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps({**figures, "run": circumstances()}, indent=2)
    path.write_text(text + "\n", encoding="utf-8")


def circumstances() -> dict[str, Any]:
    """Return date, machine, load and commit of this run."""
    return {
        "date": datetime.now(timezone.utc).strftime("%Y-%m-%d"),
        "processor": _processor(),
        "cores": os.cpu_count(),
        "load_average": os.getloadavg()[0],
        "python": platform.python_version(),
        "commit": _commit(),
    }


def _processor() -> str:
    for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
        if line.startswith("model name"):
            return line.partition(":")[2].strip()
    return platform.machine()


def _commit() -> str:
    command = ["git", "-C", str(ROOT), "rev-parse", "--short", "HEAD"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return done.stdout.strip() or "unknown"
