# SPDX-License-Identifier: Apache-2.0
"""docs/figures.md: each block belongs to a command, and is written from what that left."""

import json
import re

import pytest

import figures
from figure_rows import BLOCKS
from structure import ROOT

SIMULATION = {
    "times_real_time_median": 348.2,
    "times_real_time_min": 340.0,
    "times_real_time_max": 351.0,
    "target": 50.0,
    "met": True,
}
RUN = {
    "date": "2026-11-26",
    "processor": "Example CPU",
    "cores": 2,
    "load_average": 0.4,
    "python": "3.11.7",
    "commit": "abc1234",
}
TRIAL = {"undetected": 0, "slow_to_safe": 1, "trials": 2, "peak_tension_n": 150.5}
FAULTS = {**TRIAL, "rows": [{"safe_max_s": 0.070}, {"safe_max_s": float("inf")}]}


def block(name):
    return next(item for item in BLOCKS if item.name == name)


def written(tmp_path, name, content):
    path = tmp_path / "figures.json"
    path.write_text(json.dumps(content))
    return figures.render(block(name), path)


def test_every_block_of_a_command_is_on_the_page():
    page = figures.PAGE.read_text()
    marked = set(re.findall(r"<!-- figures: (\w+): begin -->", page))
    assert {item.name for item in BLOCKS} <= marked
    for name in marked:
        assert figures.replaced(page, f"figures: {name}", "text") != page


def test_every_command_exists():
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    page = figures.PAGE.read_text()
    named = re.findall(r"^### `make ([a-z-]+)`", page, re.MULTILINE)
    assert len(named) == len(re.findall(r"^### ", page, re.MULTILINE))
    assert set(named) <= targets
    assert {re.match(r"`make ([a-z-]+)`", item.title)[1] for item in BLOCKS} <= set(named)


def test_date_machine_and_verdict_are_written(tmp_path):
    text = written(tmp_path, "simulation", {**SIMULATION, "run": RUN})
    assert "Measured 2026-11-26 at commit abc1234: Example CPU, 2 cores" in text
    assert "| times real time, median | 348 (340 to 351) | at least 50, **met** |" in text


def test_a_missed_target_is_said(tmp_path):
    text = written(tmp_path, "simulation", {**SIMULATION, "met": False})
    assert "at least 50: **not met** |" in text
    text = written(tmp_path, "faults", FAULTS)
    assert "| not safe within 50 ms of detection | 1 | 0: **not met** |" in text
    assert "| longest from detection to safe | inf ms | at most 50 ms: **not met** |" in text
    assert "| highest tension | 150.5 N | below 150 N: **not met** |" in text


def test_not_a_number_meets_no_target(tmp_path):
    text = written(tmp_path, "faults", {**FAULTS, "peak_tension_n": float("nan")})
    assert "| highest tension | nan N | below 150 N: **not met** |" in text


def test_a_file_without_a_figure_is_refused(tmp_path):
    content = {name: value for name, value in SIMULATION.items() if name != "target"}
    with pytest.raises(ValueError, match="got none for 'target'; run the benchmark again"):
        written(tmp_path, "simulation", content)


def test_a_block_without_a_file_is_left_as_it_is(tmp_path, monkeypatch):
    page = tmp_path / "figures.md"
    page.write_text(figures.PAGE.read_text())
    monkeypatch.setattr(figures, "PAGE", page)
    monkeypatch.setattr("sys.argv", ["figures.py", "--build", str(tmp_path)])
    (tmp_path / "bench").mkdir()
    (tmp_path / "bench" / "simulation.json").write_text(json.dumps({**SIMULATION, "run": RUN}))
    assert figures.main() == 0
    old, new = figures.PAGE.read_text, (ROOT / "docs" / "figures.md").read_text()
    assert "Example CPU" in old()
    assert old().partition("<!-- figures: simulation: begin -->")[0] in new
    assert old().partition("<!-- figures: simulation: end -->")[2] in new
