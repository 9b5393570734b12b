# SPDX-License-Identifier: Apache-2.0
"""Tables with one thing wrong, and robots beyond the model whose stiffness only seems to scatter.

The table's wrench is in base axes, and its mistakes are named there.
"""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import independent_arm as arm
from cabols_control.errors import CabolsError
from cabols_stiffness import identify, load_robot
from cabols_stiffness.measurements.samples import select
from cabols_stiffness.table.laboratory import Stated, to_samples
from cabols_stiffness.table.reading import read_table
from cases import outcome
from serial_robots import STIFFNESS, urdf

LAB = Path(__file__).parent.parent / "cases" / "stiffness" / "lab.csv"
STATED = Stated(reflector=(0.0, 0.1, 0.05), position_m=21e-6)
FORCES, TORQUES = ("Fx_N", "Fy_N", "Fz_N"), ("Mx_Nm", "My_Nm", "Mz_Nm")
MOVED, JOINTS = ("dx_mm", "dy_mm", "dz_mm"), tuple(f"q{j}_deg" for j in range(1, 7))


def times(names, factor):
    return lambda row: row | {name: str(factor * float(row[name])) for name in names}


def exchanged(pairs):
    return lambda row: row | {a: row[b] for a, b in pairs} | {b: row[a] for a, b in pairs}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (times(FORCES[:1], -1.0), "the sign of Fx"),
        (times(TORQUES[1:2], -1.0), "the sign of My"),
        (times((FORCES[0], TORQUES[0]), -1.0), r"the wrench's axes seem to be \(-x, y, z\)"),
        (
            exchanged([(FORCES[0], FORCES[1]), (TORQUES[0], TORQUES[1])]),
            r"the wrench's axes seem to be \(y, x, z\)",
        ),
        (times(MOVED, -1.0), "the sign of the wrench"),
        (times(MOVED[:1], -1.0), r"the tracker's axes seem to be \(-x, y, z\)"),
        (times(JOINTS, np.pi / 180.0), "joints seem to be in radians"),
        (times(JOINTS, 180.0 / np.pi), "joints seem to be in degrees"),
        (times(TORQUES, 1e3), "torques seem to be in N mm"),
        (times(FORCES, 1.0 / 4.448), "lbf"),
        (times(MOVED, 1e3), "no robot has"),
        (times(MOVED, 1e-3), "check the unit of the motion"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, change, said):
    rows = [change(row) for row in csv.DictReader(LAB.open(encoding="utf-8"))]
    path = tmp_path / "wrong.csv"
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    robot = load_robot(tool_position=arm.TOOL_POSITION)
    with pytest.raises(CabolsError, match=said):
        identify(to_samples(read_table(path, 6), robot, STATED), robot)


@pytest.fixture(scope="module")
def robots(tmp_path_factory):
    folder = tmp_path_factory.mktemp("robots")
    return {name: urdf(folder, name) for name in ("ur10", "irb6640")}


def measured(path, settle, force_n, torque_nm):
    """Six configurations, four loads, three reflectors of another robot."""
    chain, rng = arm.Chain(path), np.random.default_rng(11)
    n = len(chain.joints)
    Q = 0.2 + 0.8 * rng.uniform(-1.0, 1.0, (6, n))
    W = arm.loads(rng, 4, force_n, torque_nm)
    columns = arm.truth(Q, W, lambda i, q, w: settle(chain, q, w))
    noise = {"force_n": 2e-3 * force_n, "torque_nm": 2e-3 * torque_nm}
    return arm.noisy(columns, np.random.default_rng(5), **noise)


def parallelogram(stiffness):
    motors = np.eye(6)
    motors[2, 1] = 1.0
    return motors.T @ np.diag(stiffness) @ motors


def soft_bearings(chain, stiffness):
    bearings = np.full((7, 6), np.inf)
    for j, one in enumerate(stiffness):
        bearings[j + 1, 3:][np.abs(chain.joints[j][1]) < 0.5] = 40.0 * one
    return bearings


@pytest.mark.parametrize("what", ["parallelogram", "bearings", "tool 20 mm off in x"])
def test_what_only_seems_to_scatter_is_named(robots, what):
    """Each configuration by itself is explained by stiffness of its own; but one follows from the
    others once the cause is known."""
    name, force, torque = (
        ("ur10", 60.0, 15.0) if what == "parallelogram" else ("irb6640", 1500, 300)
    )
    stiffness = STIFFNESS[name]

    def settle(chain, q, w):
        if what == "parallelogram":
            return chain.settle(q, w, parallelogram(stiffness))
        bearings = soft_bearings(chain, stiffness) if what == "bearings" else None
        return chain.settle(q, w, stiffness, bearings=bearings)

    samples = measured(robots[name], settle, force, torque)
    tool = [0.02 if "tool" in what else 0.0, 0.0, 0.15]
    verdict = identify(samples, load_robot(robots[name], tool_position=tool)).verdict
    assert not verdict.adequate
    word = {"parallelogram": "coupled wrist", "bearings": "bearings", "tool": "tool point"}
    assert word[what.split(maxsplit=1)[0]] in verdict.reason


def test_positions_in_another_unit_are_refused_though_they_fit(robots):
    """Motion and noise are scaled alike; only the way between configurations tells."""
    stiffness = STIFFNESS["ur10"]
    samples = measured(robots["ur10"], lambda c, q, w: c.settle(q, w, stiffness), 60.0, 15.0)
    robot = load_robot(robots["ur10"], tool_position=arm.TOOL_POSITION)
    assert identify(samples, robot).adequate
    for factor in (1e-3, 1.0 / 25.4, 1e3):
        wrong = replace(samples, position=factor * samples.position)
        found = outcome(lambda wrong=wrong: identify(wrong, robot))
        text = str(found) if isinstance(found, Exception) else found.verdict.reason
        assert "positions of the unloaded robot span" in text


def test_positions_from_each_configurations_own_origin_are_good(robots):
    stiffness = STIFFNESS["ur10"]
    samples = measured(robots["ur10"], lambda c, q, w: c.settle(q, w, stiffness), 60.0, 15.0)
    robot = load_robot(robots["ur10"], tool_position=arm.TOOL_POSITION)
    first = {group: np.flatnonzero(samples.group == group)[0] for group in np.unique(samples.group)}
    origin = np.array([samples.position[first[group]] for group in samples.group])
    moved = replace(samples, position=samples.position - origin)
    assert identify(moved, robot).adequate
    assert identify(select(moved, moved.branch != 0), robot).adequate
