# SPDX-License-Identifier: Apache-2.0
"""installing.md and Dockerfile install what the packages import, not into Ubuntu's Python."""

from __future__ import annotations

import re
import shlex
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = sorted(path.parent for path in ROOT.glob("cabols_*/package.xml"))
PYTHON_PACKAGES = [path for path in PACKAGES if (path / "setup.cfg").exists()]
PAGE = (ROOT / "docs" / "installing.md").read_text(encoding="utf-8")
DOCKER = (ROOT / "Dockerfile").read_text(encoding="utf-8").replace("\\\n", " ")
SOURCES = {"page": PAGE, "Dockerfile": DOCKER}
FROM_PIP = {
    "abb_robot_client": "abb-robot-client",
    "bokeh": "bokeh",
    "daqp": "daqp",
    "foxglove": "foxglove-sdk",
    "google": "protobuf",
    "grpc": "grpcio",
    "mcap": "mcap",
    "nicegui": "nicegui",
    "pydantic": "pydantic",
    "rosbags": "rosbags",
    "zstandard": "zstandard",
}
"""Modules that Ubuntu 24.04 lacks, or has too old, and their names on the package index."""


def declared_keys() -> set[str]:
    return {
        str(element.text)
        for path in PACKAGES
        for element in ET.parse(path / "package.xml").getroot()
        if element.tag.endswith("depend")
    }


def imported() -> set[str]:
    found = set()
    for package in PYTHON_PACKAGES:
        for path in (package / package.name).rglob("*.py"):
            text = path.read_text(encoding="utf-8")
            found |= set(re.findall(r"^\s*(?:from|import) (\w+)", text, re.MULTILINE))
    return found


@pytest.mark.parametrize("where", SOURCES)
def test_rosdep_skips_every_key_that_it_would_install_by_pip(where):
    (words,) = re.findall(r'--skip-keys "([^"]*)"', SOURCES[where])
    assert set(words.split()) == {key for key in declared_keys() if key.endswith("-pip")}


@pytest.mark.parametrize("where", SOURCES)
def test_pip_installs_what_rosdep_does_not(where):
    (line,) = re.findall(r"python -m pip install (?:--no-cache-dir )?([^&\n]*)", SOURCES[where])
    given = {re.split(r"[<>=]", word)[0] for word in shlex.split(line)}
    assert given == {FROM_PIP[module] for module in FROM_PIP if module in imported()}


@pytest.mark.parametrize("where", SOURCES)
def test_the_environments_python_builds(where):
    """The executables start with the Python that built them."""
    assert 'python "$(command -v colcon)" build' in SOURCES[where]
    assert not re.search(r"^\s*(RUN )?colcon build", SOURCES[where], re.MULTILINE)


@pytest.mark.parametrize("path", PACKAGES, ids=lambda path: path.name)
def test_a_package_says_who_made_it_and_what_it_is(path):
    root = ET.parse(path / "package.xml").getroot()
    for tag in ("description", "maintainer", "author", "license"):
        assert root.findtext(tag), tag
    assert root.findtext("license") == "Apache-2.0"
    text = (path / "README.md").read_text(encoding="utf-8")
    assert text.startswith(f"# {path.name}\n")
    for link in re.findall(r"\]\(([^)#]*)", text):
        assert (path / link).exists(), link


def test_the_aggregators_file_names_nodes_that_there_are():
    import yaml

    from cabols_control.bringup.graph import all_nodes

    path = ROOT / "cabols_control" / "layouts" / "diagnostic_aggregator.yaml"
    analyzers = yaml.safe_load(path.read_text("utf-8"))["analyzers"]["ros__parameters"]
    named = [n for a in analyzers.values() if isinstance(a, dict) for n in a["startswith"]]
    assert {name.removeprefix("/cabols/") for name in named} - {""} <= {
        node.executable for node in all_nodes()
    }
