# SPDX-License-Identifier: Apache-2.0
"""Grids, workers, meshes, files, design: what the command `workspace` is made of."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from cabols_control.errors import CabolsError, ConfigError, ShapeError
from cabols_control.geometry import load_geometry
from cabols_control.rig_folder import rig_file
from cabols_control.workspace.bodies import interference_task, load_bodies
from cabols_control.workspace.capacity import capacity_along, capacity_task
from cabols_control.workspace.design import (
    LOWER,
    PATTERNS,
    REFERENCE,
    UPPER,
    DesignProblem,
    design_bounds,
    rig_of,
)
from cabols_control.workspace.grid import PoseGrid, box_grid, pieces_of, tilts
from cabols_control.workspace.interference import clearance_along
from cabols_control.workspace.surface import level_surface
from cabols_control.workspace.tool import files
from cabols_control.workspace.tool.command import main
from cabols_control.workspace.tool.workers import QUIET, workers
from cabols_control.workspace.wrench_set import wrench_box
from cabols_sim.plant.closed_loop import simulate
from wrench_lps import box_vertices, feasible_poses

LOW, HIGH = 1.0, 150.0
BOX = [50.0, 50.0, 50.0, 5.0, 5.0, 5.0]


@pytest.fixture(scope="module")
def grid(rig):
    return box_grid(rig.geometry.reference_position, [0.4, 0.3, 0.3], (7, 5, 6), tilts(10.0))


def parts(rig):
    return capacity_task(rig.geometry, LOW, HIGH, wrench_box(BOX)), interference_task(
        rig.geometry, load_bodies()
    )


@pytest.fixture(scope="module")
def found(rig, grid):
    with workers("inline") as pool:
        return pool.evaluate(grid, *parts(rig), free_above=0.005)


def test_map_holds_what_single_poses_give(rig, grid, found):
    positions = np.repeat(grid.positions, 7, axis=0)
    rotations = np.tile(grid.rotations, (len(grid.positions), 1, 1))
    alone = capacity_along(rig.geometry, positions, rotations, LOW, HIGH, wrench_box(BOX))
    np.testing.assert_array_equal(found.capacity.margin.ravel(), alone.margin)
    np.testing.assert_array_equal(found.capacity.factor.ravel(), alone.factor)
    clear = clearance_along(rig.geometry, load_bodies(), positions, rotations)
    np.testing.assert_array_equal(found.clearance.least.ravel(), clear.least)
    usable = (alone.margin >= 0.0) & (clear.least >= 0.005)
    assert 0 < usable.sum() < usable.size
    share = usable.reshape(-1, 7).all(axis=1).mean()
    cell = 0.8 / 6 * 0.6 / 4 * 0.6 / 5
    assert found.volume(found.usable) == pytest.approx(share * 7 * 5 * 6 * cell)


def test_several_machines_find_the_same(rig, grid, found, monkeypatch):
    """A scheduler at a tcp address, as on a network, here with two workers behind it."""
    from distributed import LocalCluster

    monkeypatch.setattr("cabols_control.workspace.grid.CHUNK_POSES", 400)
    assert len(pieces_of(grid)) == 4
    seen = []
    # In this process, which starts faster, but over the same sockets as on other machines.
    where = {"processes": False, "protocol": "tcp://", "host": "127.0.0.1"}
    quiet = {"scheduler_kwargs": QUIET, "silence_logs": "ERROR"}
    with LocalCluster(n_workers=2, threads_per_worker=1, **where, **quiet) as cluster:
        address = cluster.scheduler_address
        assert address.startswith("tcp://")
        with workers(address) as pool:
            assert pool.count == 2
            other = pool.evaluate(
                grid, *parts(rig), 0.005, lambda done, total: seen.append((done, total))
            )
            assert pool.map(abs, [-1, 2, -3]) == [1, 2, 3]
    np.testing.assert_array_equal(other.capacity.margin, found.capacity.margin)
    np.testing.assert_array_equal(other.clearance.least, found.clearance.least)
    assert seen == [(1, 4), (2, 4), (3, 4), (4, 4)]


def test_scheduler_that_does_not_answer_is_an_error(monkeypatch):
    monkeypatch.setattr("cabols_control.workspace.tool.workers.CONNECT_TIMEOUT_S", 0.3)
    refused = pytest.raises(CabolsError, match="expected a Dask scheduler with workers at")
    with refused, workers("tcp://127.0.0.1:9"):
        pass
    with pytest.raises(CabolsError, match="workers: expected at least 1"), workers("local", 0):
        pass


def ball(count=24, radius=0.8):
    axis = np.linspace(-1.0, 1.0, count)
    x, y, z = np.meshgrid(axis, axis, axis, indexing="ij")
    return axis, radius - np.sqrt(x**2 + y**2 + z**2)


def test_surface_of_a_ball(tmp_path):
    """Watertight, outwards, and of the right volume, as trimesh reads the files back."""
    axis, values = ball()
    mesh = level_surface(axis, axis, axis, values)
    exact = 4.0 / 3.0 * np.pi * 0.8**3
    assert mesh.volume == pytest.approx(exact, rel=0.01)
    for suffix, write in ((".stl", files.write_stl), (".ply", files.write_ply)):
        path = tmp_path / f"ball{suffix}"
        write(mesh, path)
        read = trimesh.load(path)
        assert read.is_watertight
        assert read.is_winding_consistent
        assert len(read.faces) == len(mesh.faces)
        assert read.volume == pytest.approx(mesh.volume, rel=1e-5)
        distance = np.linalg.norm(read.vertices, axis=1)
        assert np.abs(distance - 0.8).max() < 0.01


def test_surface_closes_at_the_grids_boundary_and_round_infinities():
    axis, values = ball(10, radius=1.3)
    values[values < -0.05] = -np.inf
    mesh = level_surface(axis, axis, axis, values)
    read = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    assert read.is_watertight
    assert read.volume > 0.0
    whole = level_surface(axis, axis, axis, np.ones_like(values))
    assert whole.volume == pytest.approx(8.0, rel=0.03)
    empty = level_surface(axis, axis, axis, -np.ones_like(values))
    assert empty.volume == 0.0
    with pytest.raises(ShapeError, match="values"):
        level_surface(axis, axis, axis, np.full_like(values, np.nan))


def test_meshes_of_a_map_are_closed_and_near_its_cells(tmp_path, found):
    grid = found.grid
    mesh = level_surface(grid.x, grid.y, grid.z, found.level())
    files.write_ply(mesh, tmp_path / "map.ply")
    read = trimesh.load(tmp_path / "map.ply")
    assert read.is_watertight
    assert read.volume == pytest.approx(found.volume(found.usable), rel=0.4)


def test_command_maps_and_leaves_its_files(tmp_path, capsys):
    wanted = ["--counts", "5", "5", "5", "--scheduler", "inline", "--output", str(tmp_path)]
    assert main(["map", *wanted, "--tilt", "10"]) == 0
    assert "875 poses" in capsys.readouterr().out
    summary = json.loads((tmp_path / "workspace.json").read_text())
    assert 0 < summary["poses_feasible"] < summary["poses"] == 875
    table = np.genfromtxt(tmp_path / "workspace.csv", delimiter=",", names=True)
    assert table.size == 875
    assert (table["margin_n"] >= 0.0).sum() == summary["poses_feasible"]
    assert table["usable"].sum() == summary["poses_usable"]
    for name in ("wrench-closed.stl", "feasible_and_free.ply"):
        assert trimesh.load(tmp_path / name).is_watertight
    for name in ("workspace.png", "slices.png", "turns.png"):
        assert (tmp_path / name).stat().st_size > 10_000


@pytest.mark.filterwarnings("ignore::cabols_control.rig_folder.RigWarning")
@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("name", ["planar", "ipanema"])
def test_maps_without_a_required_wrench_are_drawn(tmp_path, name):
    """What nothing is required of has infinite factors: the scale's end was no number."""
    robot = Path(__file__).parents[2] / "examples" / "robots" / f"{name}.yaml"
    words = ["--geometry", str(robot), "--no-bodies", "--box", *"000000", "--tilt", "0"]
    small = ["--counts", "3", "3", "3", "--scheduler", "inline", "--output", str(tmp_path)]
    assert main(["map", *words, *small]) == 0
    table = np.genfromtxt(tmp_path / "workspace.csv", delimiter=",", names=True)
    assert np.isinf(table["factor"]).any()


def test_command_follows_a_trajectory(tmp_path, capsys, rig):
    path = tmp_path / "poses.csv"
    x, y, z = rig.geometry.reference_position
    rows = [f"{x + 0.01 * k},{y},{z},0,{k},0" for k in range(20)]
    path.write_text("\n".join([",".join(files.POSE_COLUMNS), *rows]) + "\n")
    output = tmp_path / "out"
    assert main(["trajectory", str(path), "--output", str(output)]) == 0
    assert "20 poses" in capsys.readouterr().out
    table = np.genfromtxt(output / "trajectory.csv", delimiter=",", names=True)
    expected = capacity_along(rig.geometry, *files.read_poses(path), LOW, HIGH, wrench_box(BOX))
    np.testing.assert_allclose(table["margin_n"], expected.margin, rtol=1e-8)
    assert (output / "trajectory.png").stat().st_size > 10_000


def test_command_says_what_is_wrong_with_its_inputs(tmp_path, capsys):
    path = tmp_path / "poses.csv"
    for text, reason in (
        ("x_m,y_m\n0,0\n", "missing rx_deg"),
        (",".join(files.POSE_COLUMNS) + "\n0,0,0,0,0,nan\n", "line 2: expected finite"),
        (",".join(files.POSE_COLUMNS) + "\n0,0,zero,0,0,0\n", "line 2: expected six numbers"),
        (",".join(files.POSE_COLUMNS) + "\n", "at least one pose"),
    ):
        path.write_text(text)
        assert main(["trajectory", str(path)]) == 1
        assert reason in capsys.readouterr().err
    path.write_text("1,2,3\n")
    assert main(["map", "--wrenches", str(path), "--scheduler", "inline"]) == 1
    assert "expected wrenches (q, 6)" in capsys.readouterr().err
    with pytest.raises(ConfigError, match="cannot be read"):
        files.read_poses(tmp_path / "none.csv")


def test_grids_are_checked(rig):
    with pytest.raises(CabolsError, match="rising"):
        PoseGrid([1.0, 0.0], [0.0], [0.0], [[0, 0, 0]], np.eye(3))
    with pytest.raises(CabolsError, match="expected positive numbers"):
        box_grid([0, 0, 0], [1, 1, 0], (3, 3, 3))


def test_the_reference_bench_is_a_member_of_the_family(rig):
    found = rig_of(REFERENCE, "alternating", rig.geometry)
    np.testing.assert_allclose(found.base_points, rig.geometry.base_points, atol=1e-12)
    np.testing.assert_allclose(found.platform_points, rig.geometry.platform_points, atol=1e-12)
    assert (np.array(LOWER) <= REFERENCE).all()
    assert (np.array(UPPER) >= REFERENCE).all()


def test_geometry_files_come_back_as_they_were(tmp_path, random, rig):
    bounds = np.array(design_bounds())
    for _ in range(3):
        geometry = rig_of(random.uniform(*bounds.T), "aligned", rig.geometry)
        files.write_geometry(geometry, tmp_path / "rig.yaml", "two\nlines")
        back = load_geometry(tmp_path / "rig.yaml")
        np.testing.assert_allclose(back.base_points, geometry.base_points, atol=1e-6)
        np.testing.assert_allclose(back.platform_points, geometry.platform_points, atol=1e-6)
        np.testing.assert_allclose(back.reference_rotation, geometry.reference_rotation)


def test_opposed_swirl_is_singular_in_a_square_frame(rig):
    """Force along z and torque about z then come together, and the bench's frame is nearly square.

    All upper cables push m_z one way while they pull up, all lower ones the other way while they
    pull down.
    """
    square = np.array(REFERENCE)
    square[[0, 3]] = square[1]
    with pytest.raises(CabolsError, match="rank 6"):
        rig_of(square, "opposed", rig.geometry)
    geometry = rig_of(REFERENCE, "opposed", rig.geometry)
    pose = ([rig.geometry.reference_position], [np.eye(3)])
    found = [
        capacity_along(g, *pose, LOW, HIGH, wrench_box(BOX)).factor[0]
        for g in (geometry, rig.geometry)
    ]
    assert found[0] < 0.25 < 1.5 < found[1]


def test_design_command_improves_on_the_bench(tmp_path, rig, monkeypatch):
    """A few generations, judged on their own grid."""
    for name in ("COARSE", "FINE"):
        monkeypatch.setattr(f"cabols_control.workspace.tool.design_command.{name}", (7, 5, 5))
    options = ["--generations", "6", "--population", "16", "--scheduler", "inline"]
    done = main(["design", "--patterns", "alternating", *options, "--output", str(tmp_path)])
    assert done == 0
    rows = json.loads((tmp_path / "design.json").read_text())["rows"]
    before, after = (row["usable_volume_m3"] for row in rows)
    assert after > before > 0.0
    geometry = load_geometry(tmp_path / "geometry.yaml")
    best = rig_of(list(rows[1]["parameters"].values()), "alternating", rig.geometry)
    np.testing.assert_allclose(geometry.platform_points, best.platform_points, atol=1e-6)


@pytest.fixture(scope="module")
def designed():
    return load_geometry(rig_file("geometry_designed.yaml"))


def test_designed_geometry_beats_the_bench_by_linear_programmes(rig, designed):
    """A coarse grid, every vertex of the set at every orientation, by HiGHS alone."""
    grid = box_grid(rig.geometry.reference_position, [0.6, 0.5, 0.5], (7, 5, 5), tilts(15.0))
    positions = np.repeat(grid.positions, 7, axis=0)
    rotations = np.tile(grid.rotations, (len(grid.positions), 1, 1))
    volumes = [
        feasible_poses(g, positions, rotations, box_vertices(BOX), LOW, HIGH)[0]
        .reshape(-1, 7)
        .all(axis=1)
        .sum()
        for g in (rig.geometry, designed)
    ]
    assert volumes[1] > 1.5 * volumes[0] > 0


def test_the_bench_runs_the_designed_geometry(rig, designed, card, plant_config):
    """The whole closed loop, full plant, at a load the reference bench cannot give."""
    new = replace(rig, geometry=designed)
    load = np.zeros((2500, 6))
    load[200:] = [60.0, -40.0, 30.0, 4.0, -3.0, 5.0]
    trace = simulate(new, card, plant_config, load)
    assert (trace.status == 0).all()
    error = np.abs(trace.wrench[-500:] - load[-1]).max(axis=0)
    assert (error < [1.0, 1.0, 1.0, 0.15, 0.15, 0.15]).all()
    assert trace.tension[500:].min() > 0.0
    assert trace.tension.max() < 150.0
    assert np.abs(trace.current).max() <= 3.0


def test_every_pattern_has_a_name_and_eight_swirls():
    assert all(len(signs) == 8 and set(signs) == {1, -1} for signs in PATTERNS.values())


def test_designs_problem_costs_a_degenerate_rig_nothing(rig, grid):
    """A rig that cannot be built is the worst, not an error that ends the search."""
    problem = DesignProblem(
        rig.geometry, "opposed", LOW, HIGH, wrench_box(BOX), load_bodies(), grid
    )
    assert problem(np.array(REFERENCE)) <= 0.0
    assert problem(np.full(12, np.nan)) == 0.0
