# SPDX-License-Identifier: Apache-2.0
"""The command `workspace`: one number for one quantity, outputs that it can read itself."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest
import yaml

from cabols_control.geometry import load_geometry
from cabols_control.workspace.tool.command import main as workspace

POSE = ("x_m", "y_m", "z_m", "rx_deg", "ry_deg", "rz_deg")
BOX_M3 = 1.2
"""Of the grid of poses."""


def enclosed(stl):
    """Volume that a binary STL encloses [m3]."""
    raw = stl.read_bytes()
    facets = np.frombuffer(raw[84:], dtype=[("facet", "<f4", (4, 3)), ("attribute", "<u2")])
    corners = facets["facet"][:, 1:].astype(float)
    corners -= corners.reshape(-1, 3).mean(axis=0)
    cross = np.cross(corners[:, 1], corners[:, 2])
    return float(np.einsum("ij,ij->i", corners[:, 0], cross).sum() / 6.0)


@pytest.fixture(scope="module", params=[20, 50])
def folder(request, tmp_path_factory):
    """What the command leaves for a box of required wrenches, one orientation."""
    folder = tmp_path_factory.mktemp("volume")
    force, torque = str(request.param), str(request.param / 10)
    words = "map --no-bodies --tilt 0 --scheduler inline --half-widths .6 .5 .5 --counts 9 9 9"
    box = ["--box", force, force, force, torque, torque, torque]
    assert workspace([*words.split(), *box, "--output", str(folder)]) == 0
    return folder


def test_volume_of_the_table_is_that_of_the_mesh(folder):
    said = json.loads((folder / "workspace.json").read_text("utf-8"))
    mesh = enclosed(folder / "wrench-feasible.stl")
    assert said["feasible_volume_m3"] == pytest.approx(mesh, rel=0.05)


def test_no_volume_is_larger_than_the_box(folder):
    said = json.loads((folder / "workspace.json").read_text("utf-8"))
    volumes = {key: value for key, value in said.items() if "volume" in key}
    assert volumes
    assert max(volumes.values()) <= BOX_M3 + 1e-9


def test_rows_of_a_map_are_poses_of_a_trajectory(tmp_path):
    """The bench with its reference turned by 20 deg: the same poses have the same margins."""
    bench = load_geometry()
    turned = tmp_path / "turned.yaml"
    position = bench.reference_position.tolist()
    content = {
        "reference_pose": {"position": position, "rotation_xyz_deg": [0, 0, 20]},
        "base_points": bench.base_points.tolist(),
        "platform_points": bench.platform_points.tolist(),
    }
    turned.write_text(yaml.safe_dump(content), encoding="utf-8")
    common = ["--geometry", str(turned), "--no-bodies"]
    words = "--counts 2 2 2 --half-widths .1 .1 .1 --tilt 10 --scheduler inline --output"
    assert workspace(["map", *common, *words.split(), str(tmp_path / "map")]) == 0
    with (tmp_path / "map" / "workspace.csv").open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))[:8]
    poses = tmp_path / "poses.csv"
    lines = [",".join(POSE), *(",".join(row[name] for name in POSE) for row in rows)]
    poses.write_text("\n".join(lines) + "\n", encoding="utf-8")
    out = tmp_path / "trajectory"
    assert workspace(["trajectory", *common, "--output", str(out), str(poses)]) == 0
    with next(out.glob("*.csv")).open(encoding="utf-8") as stream:
        again = list(csv.DictReader(stream))
    margins = [float(row["margin_n"]) for row in rows]
    np.testing.assert_allclose([float(row["margin_n"]) for row in again], margins, atol=0.01)


def test_negative_tilt_is_refused(tmp_path):
    words = "map --no-bodies --scheduler inline --counts 2 2 2 --tilt=-5 --output"
    try:
        code = workspace([*words.split(), str(tmp_path / "out")])
    except SystemExit as error:
        code = error.code
    assert code != 0
