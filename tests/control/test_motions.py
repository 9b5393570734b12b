# SPDX-License-Identifier: Apache-2.0
"""Platforms that move in a plane or as a point: capacity beside HiGHS, pose, maps, design."""

from __future__ import annotations

import json

import numpy as np
import pytest
import yaml
from scipy.optimize import linprog
from scipy.spatial.transform import Rotation

from cabols_control.errors import ConfigError, DegenerateGeometryError, ShapeError
from cabols_control.forward_kinematics import PoseFinder, PoseRegion, PoseState
from cabols_control.geometry import RigGeometry, load_geometry
from cabols_control.kinematics import cable_lengths, structure_matrix
from cabols_control.motion import Motion
from cabols_control.rig import load_rig
from cabols_control.workspace.capacity import PlatformWeight, capacity_along
from cabols_control.workspace.robot import load_robot
from cabols_control.workspace.tool.command import main as workspace
from cabols_control.workspace.wrench_set import wrench_box
from case_robots import FOLDER, lp_margin

PLANARS = ("planar_ex_planar", "planar_kntu", "planar_cross")
FRAME = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 2.0], [0.0, 2.0]])
PLATE = np.array([[-0.2, 0.1], [0.2, 0.1], [0.2, -0.1], [-0.2, -0.1]])
AXES = {Motion.PLANAR_XY: (0, 1), Motion.PLANAR_XZ: (0, 2), Motion.PLANAR_YZ: (1, 2)}


def placed(points, motion):
    found = np.zeros((len(points), 3))
    found[:, AXES[motion]] = points
    return found


def planar(motion):
    """Crossed cables in a plane of the base."""
    middle = placed(FRAME, motion).mean(axis=0)
    return RigGeometry(
        placed(FRAME, motion), placed(PLATE, motion), middle, np.eye(3), motion=motion
    )


def point(cables=4):
    """A camera on cables: all meet, below their pulleys."""
    angles = 2.0 * np.pi * np.arange(cables) / cables
    base = np.c_[4.0 * np.cos(angles), 3.0 * np.sin(angles), np.full(cables, 5.0)]
    return RigGeometry(
        base, np.zeros((cables, 3)), np.array([0.0, 0.0, 2.0]), np.eye(3), motion=Motion.POINT
    )


@pytest.mark.parametrize("name", PLANARS)
def test_flat_files_move_in_their_plane(name):
    rig = load_geometry(FOLDER / f"{name}.yaml")
    assert rig.motion is Motion.PLANAR_XY
    assert rig.cables == 4


@pytest.mark.parametrize("motion", list(AXES))
def test_plane_is_found_from_the_points(tmp_path, motion):
    rig = planar(motion)
    content = {
        "reference_pose": {"position": rig.reference_position.tolist()},
        "base_points": rig.base_points.tolist(),
        "platform_points": rig.platform_points.tolist(),
    }
    path = tmp_path / "robot.yaml"
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    assert load_geometry(path).motion is motion
    path.write_text(yaml.safe_dump({**content, "motion": "spatial"}), encoding="utf-8")
    with pytest.raises(ConfigError, match="at least 6 cables, got 4"):
        load_geometry(path)
    path.write_text(yaml.safe_dump({**content, "motion": "sideways"}), encoding="utf-8")
    with pytest.raises(ConfigError, match="motion"):
        load_geometry(path)


def test_cables_that_meet_move_a_point(tmp_path):
    rig = point()
    content = {
        "reference_pose": {"position": [0.0, 0.0, 2.0]},
        "base_points": rig.base_points.tolist(),
        "platform_points": rig.platform_points.tolist(),
    }
    path = tmp_path / "robot.yaml"
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    assert load_geometry(path).motion is Motion.POINT


def test_too_few_and_degenerate_are_refused():
    with pytest.raises(ShapeError, match="at least 3 cables, got 2"):
        RigGeometry(np.eye(3)[:2], np.zeros((2, 3)), -np.ones(3), np.eye(3), motion=Motion.POINT)
    rig = planar(Motion.PLANAR_XY)
    with pytest.raises(DegenerateGeometryError, match="rank 3"):
        RigGeometry(
            rig.base_points,
            np.zeros((4, 3)),
            rig.reference_position,
            np.eye(3),
            motion=Motion.PLANAR_XY,
        )


@pytest.mark.parametrize("name", PLANARS)
def test_controllers_refuse_what_does_not_move_in_space(name):
    with pytest.raises(ConfigError, match="moves in space"):
        load_rig(geometry=FOLDER / f"{name}.yaml")


def poses_of(rig, rng, count):
    positions = np.tile(rig.reference_position, (count, 1))
    rotations = np.tile(np.eye(3), (count, 1, 1))
    for k in range(count):
        for row in rig.motion.directions:
            if row < 3:
                positions[k, row] += rng.uniform(-1.0, 1.0) * 0.4 * np.ptp(rig.base_points[:, row])
            else:
                turn = rng.uniform(-0.8, 0.8) * np.eye(3)[row - 3]
                rotations[k] = Rotation.from_rotvec(turn).as_matrix()
    return positions, rotations


@pytest.mark.parametrize("rig", [*(planar(motion) for motion in AXES), point(), point(7)])
def test_capacity_is_that_of_linear_programmes(rig):
    """Weight and a box, every vertex, as HiGHS has it: flag, and largest multiple."""
    rng = np.random.default_rng(8)
    rows = rig.motion.directions
    box = np.array([3.0, 4.0, 5.0, 0.2, 0.3, 0.4])
    low, high = rng.uniform(0.0, 2.0, rig.cables), rng.uniform(60.0, 90.0, rig.cables)
    weight, centre = 20.0, np.array([0.02, 0.01, 0.03])
    if rig.motion is Motion.POINT:
        centre[:] = 0.0
    positions, rotations = poses_of(rig, rng, 150)
    found = capacity_along(
        rig,
        positions,
        rotations,
        low,
        high,
        wrench_box(box),
        platform=PlatformWeight(weight, tuple(centre)),
    )
    vertices = wrench_box(box[rows]).vertices()
    answers = []
    for position, rotation in zip(positions, rotations, strict=True):
        A = structure_matrix(rig, position, rotation)[rows]
        force = np.array([0.0, 0.0, weight])
        held = np.r_[force, np.cross(rotation @ centre, force)][rows]
        answers.append(min(lp_margin(A, held + v, low, high) for v in vertices) >= 0.0)
    np.testing.assert_array_equal(found.feasible, answers)
    assert 5 < sum(answers) < 145
    for k in np.flatnonzero(answers)[:10]:
        A = structure_matrix(rig, positions[k], rotations[k])[rows]
        force = np.array([0.0, 0.0, weight])
        held = np.r_[force, np.cross(rotations[k] @ centre, force)][rows]
        factors = [
            -linprog(
                np.r_[np.zeros(rig.cables), -1.0],
                A_eq=np.c_[A, -v],
                b_eq=held,
                bounds=[*zip(low, high, strict=True), (0.0, None)],
            ).fun
            for v in vertices
        ]
        assert found.factor[k] == pytest.approx(min(factors), rel=1e-7)


@pytest.mark.parametrize("rig", [*(planar(motion) for motion in AXES), point(), point(3)])
def test_pose_of_a_platform_that_moves_less(rig):
    rng = np.random.default_rng(9)
    half = np.where(np.isin(np.arange(3), rig.motion.directions), 0.3, 0.0)
    region = PoseRegion(rig.reference_position, np.eye(3), half, 0.4)
    finder = PoseFinder(rig, 1e-4, region)
    for _ in range(30):
        position = rig.reference_position + half * rng.uniform(-1.0, 1.0, 3)
        rotation = np.eye(3)
        for row in rig.motion.directions:
            if row >= 3:
                turn = rng.uniform(-0.4, 0.4) * np.eye(3)[row - 3]
                rotation = Rotation.from_rotvec(turn).as_matrix()
        found = finder.find(cable_lengths(rig, position, rotation))
        assert found.state is PoseState.KNOWN
        assert np.abs(found.position - position).max() < 1e-8
        assert np.abs(found.rotation - rotation).max() < 1e-8
        free = np.isin(np.arange(6), rig.motion.directions)
        assert not found.covariance[~free].any()
        assert (np.diag(found.covariance)[free] > 0.0).all()


def write_robot(tmp_path, rig, **words):
    content = {
        "reference_pose": {"position": rig.reference_position.tolist()},
        "motion": rig.motion.value,
        "base_points": rig.base_points.tolist(),
        "platform_points": rig.platform_points.tolist(),
        "tension_min": 1.0,
        "tension_max": 80.0,
        "characteristic_length": 0.2,
        "required_wrench": [3.0, 4.0, 5.0, 0.2, 0.3, 0.4],
        **words,
    }
    path = tmp_path / "robot.yaml"
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    return path


INLINE = ["--scheduler", "inline", "--tilt", "10", "--output"]


def test_map_of_a_planar_robot(tmp_path, capsys):
    path = write_robot(tmp_path, planar(Motion.PLANAR_XZ), mass=1.0)
    out = tmp_path / "out"
    words = ["--counts", "15", "15", "11", *INLINE, str(out)]
    assert workspace(["map", "--geometry", str(path), *words]) == 0
    figures = json.loads((out / "workspace.json").read_text("utf-8"))
    table = np.genfromtxt(out / "workspace.csv", delimiter=",", names=True)
    # No turn, and one each way about y; one y.
    assert figures["orientations"] == 3
    assert figures["poses"] == 15 * 11 * 3
    assert np.ptp(table["y_m"]) == 0.0
    said = capsys.readouterr().out
    assert "wrenches across it do not count" in said
    assert "bench's platform and target are not this robot's" in said
    assert "required wrenches are those of the bench" not in said
    robot = load_robot(geometry=path)
    sides = 2.0 * robot.half_widths()
    assert 0.0 < figures["feasible_area_m2"] <= figures["closed_area_m2"] <= sides[0] * sides[2]
    assert (out / "slices.png").stat().st_size > 0
    rows = out / "poses.csv"
    np.savetxt(
        rows,
        np.column_stack([table[name] for name in table.dtype.names[:6]]),
        delimiter=",",
        header=",".join(table.dtype.names[:6]),
        comments="",
    )
    words = ["--geometry", str(path), "--output", str(out)]
    assert workspace(["trajectory", str(rows), *words]) == 0
    again = np.genfromtxt(out / "trajectory.csv", delimiter=",", names=True)
    np.testing.assert_allclose(again["margin_n"], table["margin_n"], rtol=1e-5, atol=1e-5)


def test_area_is_that_of_a_region_that_is_known(tmp_path):
    """Suspended from two pulleys a point mass can be held below them, between them."""
    base = np.array([[-1.0, 0.0, 1.0], [1.0, 0.0, 1.0], [0.0, 1.0, 1.0], [0.0, -1.0, 1.0]])
    rig = RigGeometry(base, np.zeros((4, 3)), np.zeros(3), np.eye(3), motion=Motion.POINT)
    path = write_robot(
        tmp_path, rig, tension_min=0.0, tension_max=1e6, mass=1.0, required_wrench=[1e-9] * 6
    )
    out = tmp_path / "out"
    words = ["--half-widths", "1.5", "1.5", "0.5", "--counts", "61", "61", "1", *INLINE, str(out)]
    assert workspace(["map", "--geometry", str(path), *words]) == 0
    figures = json.loads((out / "workspace.json").read_text("utf-8"))
    # The square of corners at 1 m: 2 m^2; the grid's cells are 0.05 m.
    assert figures["feasible_area_m2"] == pytest.approx(2.0, abs=0.15)


def test_design_starts_from_the_given_robot(tmp_path):
    path = write_robot(tmp_path, planar(Motion.PLANAR_XY), mass=1.0)
    out = tmp_path / "out"
    words = ["--generations", "2", "--population", "6", *INLINE, str(out)]
    assert workspace(["design", "--geometry", str(path), *words]) == 0
    best = load_robot(geometry=out / "geometry.yaml")
    assert best.notes[-1].startswith("the platform moves in the xy plane")
    given = load_robot(geometry=path)
    assert best.geometry.motion is Motion.PLANAR_XY
    np.testing.assert_allclose(best.tension_max, given.tension_max)
    np.testing.assert_allclose(best.required, given.required)
    rows = json.loads((out / "design.json").read_text("utf-8"))["rows"]
    assert rows[0]["name"] == "given, as it is"
    assert rows[1]["usable_area_m2"] >= rows[0]["usable_area_m2"]
    assert workspace(["design", "--geometry", str(path), "--patterns", "aligned", *words]) != 0


def test_mistakes_in_what_a_robot_must_give_are_named(tmp_path):
    for words, named in (
        ({"required_wrench": [1.0] * 3}, "required_wrench"),
        ({"bodies": {"cable_radius": -1.0}}, "bodies"),
    ):
        with pytest.raises(ConfigError, match=named):
            load_robot(geometry=write_robot(tmp_path, planar(Motion.PLANAR_XY), **words))
