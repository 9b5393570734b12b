# SPDX-License-Identifier: Apache-2.0
"""package.xml names what a launch file and the processes that a package starts need to run."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("cabols_control", "cabols_hw", "cabols_sim", "cabols_stiffness")


def needs(package: str) -> set[str]:
    """Return the packages that run with this one, as its package.xml declares them."""
    root = ET.parse(ROOT / package / "package.xml").getroot()
    return {str(e.text) for tag in ("exec_depend", "depend") for e in root.findall(tag)}


@pytest.mark.parametrize("package", [p for p in PACKAGES if (ROOT / p / "launch").is_dir()])
def test_a_package_with_launch_files_brings_the_launch_command(package: str) -> None:
    assert "ros2launch" in needs(package)


def test_the_bench_brings_the_campaign_that_it_starts() -> None:
    assert "cabols_stiffness" in needs("cabols_sim")
    assert "cabols_sim" not in needs("cabols_stiffness")
