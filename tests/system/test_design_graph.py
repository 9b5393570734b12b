# SPDX-License-Identifier: Apache-2.0
"""The real nodes with the designed geometry and another tension method, in lockstep."""

from __future__ import annotations

import numpy as np
import pytest
from cabols_msgs.msg import Mode

from cabols_control.bags.reader import read_bag
from cabols_control.geometry import load_geometry
from cabols_control.kinematics import structure_matrix
from cabols_control.rig_folder import rig_file
from cabols_control.tension import distribute
from cabols_sim.bench.run import run_bench
from graph_harness import next_environment

pytestmark = pytest.mark.ros


def test_the_nodes_run_the_designed_rig_away_from_the_limits(tmp_path):
    """Geometry by file, method by launch argument; commands are the barycentre's after the fade."""
    path = rig_file("geometry_designed.yaml")
    lines = []
    ended = run_bench(
        {
            "lockstep": True,
            "steps": 2200,
            "auto_start": True,
            "program": "multi_axis",
            "geometry_file": str(path),
            "tension_method": "barycentre",
            "output": str(tmp_path / "bag"),
        },
        lambda node, line: lines.append(f"{node}: {line}"),
        environment=next_environment(),
    )
    assert (ended.first, ended.code) == ("plant", 0), "\n".join(lines)
    bag = read_bag(tmp_path / "bag", ["tension_command", "motor_current", "mode"])
    assert Mode.FAULT not in bag["mode"]["mode"]
    command = bag["tension_command"]
    loaded = np.flatnonzero(command["active"].astype(bool))
    assert loaded.size > 700
    assert np.abs(np.diff(command["tension"][loaded], axis=0)).max() < 3.0
    geometry = load_geometry(path)
    matrix = structure_matrix(geometry, geometry.reference_position, geometry.reference_rotation)
    for k in loaded[600::100]:
        expected = distribute(matrix, command["control"][k], 1.0, 150.0, "barycentre")
        assert expected.feasible
        np.testing.assert_allclose(command["tension"][k], expected.tension, atol=1e-6)
    assert command["tension"][loaded[600:]].min() > 20.0
    assert np.abs(bag["motor_current"]["current"]).max() <= 3.0
