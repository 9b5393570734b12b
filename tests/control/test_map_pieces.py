# SPDX-License-Identifier: Apache-2.0
"""Maps in pieces: the same bits however they were made, completed after any end, memory flat."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
import tracemalloc

import numpy as np
import pytest

from cabols_control.errors import CabolsError
from cabols_control.workspace.bodies import interference_task, load_bodies
from cabols_control.workspace.capacity import capacity_task
from cabols_control.workspace.facet_result import RESULTS
from cabols_control.workspace.grid import box_grid, piece_count, pieces_of, tilts
from cabols_control.workspace.tool.command import main
from cabols_control.workspace.tool.pieces import MANIFEST, piece_folder
from cabols_control.workspace.tool.workers import Workers
from cabols_control.workspace.wrench_set import wrench_box

LOW, HIGH = 1.0, 150.0
BOX = [50.0, 50.0, 50.0, 5.0, 5.0, 5.0]


@pytest.fixture
def small_pieces(monkeypatch):
    monkeypatch.setattr("cabols_control.workspace.grid.CHUNK_POSES", 70)


def grid_of(rig, counts=(5, 4, 3), angle=10.0):
    shape = rig.geometry
    half = (0.4, 0.3, 0.3)
    return box_grid(shape.reference_position, half, counts, tilts(angle), shape.reference_rotation)


def tasks(rig, box=BOX):
    task = capacity_task(rig.geometry, LOW, HIGH, wrench_box(box))
    return task, interference_task(rig.geometry, load_bodies())


def inline():
    return Workers(None, 1, "this process")


def complete(folder, pool, grid, task, bodies):
    for k, piece in pool.stream(grid, task, bodies, folder.missing()):
        folder.write(k, piece)
    return folder.figures()


def test_pieces_are_the_map(rig, tmp_path, small_pieces):
    grid = grid_of(rig)
    whole = inline().evaluate(grid, *tasks(rig), 0.005)
    folder = piece_folder(tmp_path / "map", grid, *tasks(rig), 0.005)
    figures = complete(folder, inline(), grid, *tasks(rig))
    rows = np.concatenate(list(folder.pieces())).reshape(*grid.shape, 7, -1)
    np.testing.assert_array_equal(rows[..., 0], whole.capacity.margin)
    np.testing.assert_array_equal(rows[..., RESULTS:].min(axis=-1), whole.clearance.least)
    assert figures["poses"] == grid.poses
    assert figures["poses_feasible"] == whole.feasible.sum()
    assert figures["poses_usable"] == whole.usable.sum()
    assert figures["usable_share"] == pytest.approx(whole.usable.all(axis=-1).mean())
    assert figures["poses_closed"] == whole.capacity.closed.sum()
    assert figures["least_margin_n"] == whole.capacity.margin.min()


def test_positions_of_a_piece_are_those_of_the_grid(rig, small_pieces):
    grid = grid_of(rig, (4, 3, 5))
    for part in pieces_of(grid):
        np.testing.assert_array_equal(grid.positions_of(part), grid.positions[part])


def test_a_run_goes_on_where_another_was_ended(rig, tmp_path, small_pieces):
    """Also where a piece was being written when it ended; in another order, by another run."""
    grid = grid_of(rig)
    once = piece_folder(tmp_path / "once", grid, *tasks(rig), 0.005)
    wanted = complete(once, inline(), grid, *tasks(rig))
    folder = piece_folder(tmp_path / "twice", grid, *tasks(rig), 0.005)
    first = folder.missing()[::-2]
    for k, piece in inline().stream(grid, *tasks(rig), first):
        folder.write(k, piece)
    (folder.path / ".0000001.123").write_bytes(b"half a piece")
    again = piece_folder(tmp_path / "twice", grid, *tasks(rig), 0.005)
    assert set(again.missing()) == set(range(piece_count(grid))) - set(first)
    assert complete(again, inline(), grid, *tasks(rig)) == wanted


def test_another_map_is_refused(rig, tmp_path, small_pieces):
    grid = grid_of(rig)
    piece_folder(tmp_path / "map", grid, *tasks(rig), 0.005)
    for other, parts in (
        (grid_of(rig, (5, 4, 4)), tasks(rig)),
        (grid_of(rig, angle=11.0), tasks(rig)),
        (grid, tasks(rig, [51.0, *BOX[1:]])),
        (grid, (tasks(rig)[0], None)),
    ):
        with pytest.raises(CabolsError, match="pieces of this map, got those of another one"):
            piece_folder(tmp_path / "map", other, *parts, 0.005)
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "thesis.tex").write_text("mine")
    with pytest.raises(CabolsError, match="expected an empty folder"):
        piece_folder(tmp_path / "own", grid, *tasks(rig), 0.005)
    (tmp_path / "map" / MANIFEST).write_text("no")
    with pytest.raises(CabolsError, match="expected JSON"):
        piece_folder(tmp_path / "map", grid, *tasks(rig), 0.005)


@pytest.mark.parametrize("damage", [b"", b"\x93NUMPY\x01", b"text"])
def test_a_damaged_piece_is_named(rig, tmp_path, small_pieces, damage):
    grid = grid_of(rig)
    folder = piece_folder(tmp_path / "map", grid, *tasks(rig), 0.005)
    complete(folder, inline(), grid, *tasks(rig))
    folder.file(2).write_bytes(damage)
    with pytest.raises(CabolsError, match=r"0000002.npy.*delete it"):
        folder.figures()


def test_memory_does_not_grow_with_the_map(rig, tmp_path, monkeypatch):
    """Four times the poses: not a tenth of their results, 64 bytes each, is kept."""
    monkeypatch.setattr("cabols_control.workspace.grid.CHUNK_POSES", 2000)
    task, _ = tasks(rig)
    most = []
    for count in (100, 400):
        grid = grid_of(rig, (count, 10, 10), 0.0)
        folder = piece_folder(tmp_path / str(count), grid, task, None, 0.0)
        next(inline().stream(grid, task, None, [0]))
        tracemalloc.start()
        complete(folder, inline(), grid, task, None)
        most.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert most[1] < most[0] + 6.4 * 30_000


@pytest.mark.slow
def test_killed_workers_and_a_killed_run_cost_nothing(tmp_path, monkeypatch, capsys):
    """The command is killed while it works, then a worker of the next run: the same bits."""
    words = ["map", "--in-pieces", "--counts", "24", "24", "24", "--tilt", "5", "--no-bodies"]
    folder = tmp_path / "map"
    run = [sys.executable, "-m", "cabols_control.workspace.tool.command", *words]
    run += ["--output", str(folder)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    process = subprocess.Popen([*run, "--scheduler", "inline"], env=environment)
    while not any(folder.glob("0*.npy")):
        assert process.poll() is None
        time.sleep(0.01)
    process.kill()
    process.wait()
    there = len(list(folder.glob("0*.npy")))
    killed = []
    stream = Workers.stream

    def with_a_kill(pool, *parts):
        for done in stream(pool, *parts):
            if not killed:
                killed.extend(pool._client.run(os.getpid).values())
                os.kill(killed[0], signal.SIGKILL)
            yield done

    monkeypatch.setattr(Workers, "stream", with_a_kill)
    count = json.loads((folder / MANIFEST).read_text())["pieces"]
    assert 0 < there < count
    assert main([*words, "--output", str(folder), "--workers", "2"]) == 0
    assert killed
    shown = capsys.readouterr().out
    assert f"{there} pieces are there from before" in shown
    monkeypatch.undo()
    assert main([*words, "--output", str(tmp_path / "once"), "--scheduler", "inline"]) == 0
    wanted = capsys.readouterr().out
    digest = next(line for line in wanted.splitlines() if "sha256" in line)
    assert digest in shown
