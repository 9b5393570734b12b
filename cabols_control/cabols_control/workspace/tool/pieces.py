# SPDX-License-Identifier: Apache-2.0
"""Maps that memory does not hold: a folder of pieces, which a later run completes.

A piece is a file of some thousand poses, written whole or not at all. Whatever ends a run, a killed
worker or a machine that is switched off, the next one computes what is missing. The pieces of
any number of workers, in any order, are the same bytes.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.errors import CabolsError
from cabols_control.workspace.bodies import InterferenceTask
from cabols_control.workspace.capacity import CLOSED, CapacityTask
from cabols_control.workspace.facet_result import CLOSURE, FACTOR, MARGIN, RESULTS
from cabols_control.workspace.grid import Piece, PoseGrid, piece_count, piece_of

MANIFEST = "map.json"
FORMAT = "cabols map in pieces 1"
COLUMNS = (
    "margin_n",
    "factor",
    "closure",
    "factor_low",
    "factor_high",
    "cable_clearance_m",
    "platform_clearance_m",
    "target_clearance_m",
)
"""Of the last axis of every piece, (positions, orientations, columns)."""


@dataclass(frozen=True, eq=False)
class PieceFolder:
    """A map's folder; made by `piece_folder`.

    Attributes:
        path: of the folder.
        grid: poses.
        free_above: clearance that counts as free [m].
    """

    path: Path
    grid: PoseGrid
    free_above: float

    def file(self, k: int) -> Path:
        """Path of a piece.

        Args:
            k: number of the piece, from 0.
        """
        return self.path / f"{k:07d}.npy"

    def missing(self) -> list[int]:
        """Pieces that no run has written yet."""
        return [k for k in range(piece_count(self.grid)) if not self.file(k).exists()]

    def write(self, k: int, piece: Piece) -> None:
        """Write a piece whole.

        Args:
            k: number of the piece, from 0.
            piece: its results.
        """
        beside = self.path / f".{k:07d}.{os.getpid()}"
        with beside.open("wb") as file:
            np.save(file, np.concatenate([piece.capacity, piece.clearance], axis=-1))
            file.flush()
            os.fsync(file.fileno())
        beside.replace(self.file(k))

    def read(self, k: int) -> FloatArray:
        """(positions, orientations, COLUMNS) results of a piece.

        Args:
            k: number of the piece, from 0.

        Raises:
            CabolsError: if the file is not this piece's; delete it, and the next run computes it.
        """
        part = piece_of(self.grid, k)
        expected = (part.stop - part.start, len(self.grid.angles_deg), len(COLUMNS))
        try:
            found = np.load(self.file(k), allow_pickle=False)
        except (OSError, ValueError, EOFError) as error:
            raise CabolsError(
                f"{self.file(k)}: expected a piece, got {error}; delete it"
            ) from error
        if found.shape != expected or found.dtype != np.float64:
            raise CabolsError(
                f"{self.file(k)}: expected {expected} numbers, got {found.shape}; delete it"
            )
        return np.asarray(found, dtype=np.float64)

    def pieces(self) -> Iterator[FloatArray]:
        """Results of one piece after the other, in order."""
        for k in range(piece_count(self.grid)):
            yield self.read(k)

    def figures(self) -> dict[str, Any]:
        """Numbers of the complete map, units in the keys; one piece in memory at a time.

        `sha256` is of all results in order: equal ones are equal to the bit.
        """
        digest, at = hashlib.sha256(), 0
        closed = feasible = usable = all_feasible = all_usable = 0
        worst, least_factor = np.inf, np.inf
        for piece in self.pieces():
            digest.update(piece.tobytes())
            margin, clear = piece[..., MARGIN], piece[..., RESULTS:].min(axis=-1)
            good = margin >= 0.0
            # Written so that NaN is neither free nor usable.
            both = good & (clear >= self.free_above)
            closed += int((piece[..., CLOSURE] > CLOSED).sum())
            feasible, usable = feasible + int(good.sum()), usable + int(both.sum())
            all_feasible += int(good.all(axis=-1).sum())
            all_usable += int(both.all(axis=-1).sum())
            worst = min(worst, float(margin.min()))
            least_factor = min(least_factor, float(piece[..., FACTOR].min()))
            at += len(piece)
        return {
            "poses": self.grid.poses,
            "orientations": len(self.grid.angles_deg),
            "poses_closed": closed,
            "poses_feasible": feasible,
            "poses_usable": usable,
            "feasible_share": all_feasible / at,
            "usable_share": all_usable / at,
            "least_margin_n": worst,
            "least_factor": least_factor,
            "sha256": digest.hexdigest(),
        }


def piece_folder(
    path: Path,
    grid: PoseGrid,
    task: CapacityTask,
    bodies: InterferenceTask | None,
    free_above: float,
) -> PieceFolder:
    """Make a map's folder, or open the one of an earlier run.

    Args:
        path: of the folder.
        grid: poses.
        task: rig, limits and required wrenches.
        bodies: for the interference test; None leaves it out.
        free_above: clearance that counts as free [m].

    Raises:
        CabolsError: if the folder holds something else, or the map of another task.
    """
    path.mkdir(parents=True, exist_ok=True)
    manifest = path / MANIFEST
    wanted = {
        "format": FORMAT,
        "columns": list(COLUMNS),
        "pieces": piece_count(grid),
        "poses": grid.poses,
        "task_sha256": _task_digest(grid, task, bodies),
        "free_above_m": free_above,
    }
    if not manifest.exists():
        if any(path.iterdir()):
            raise CabolsError(f"{path}: expected an empty folder, or one of a map in pieces")
        beside = path / f".{MANIFEST}.{os.getpid()}"
        beside.write_text(json.dumps(wanted, indent=1) + "\n", encoding="utf-8")
        beside.replace(manifest)
    try:
        found = json.loads(manifest.read_text(encoding="utf-8"))
    except ValueError as error:
        raise CabolsError(f"{manifest}: expected JSON, got {error}") from error
    if found != wanted:
        other = [
            key for key in wanted if not isinstance(found, dict) or found.get(key) != wanted[key]
        ]
        raise CabolsError(
            f"{path}: expected the pieces of this map, got those of another one (other "
            f"{', '.join(other)}); name another folder"
        )
    return PieceFolder(path, grid, free_above)


def _task_digest(grid: PoseGrid, task: CapacityTask, bodies: InterferenceTask | None) -> str:
    """Hash of everything that the results depend on."""
    digest = hashlib.sha256()
    parts: list[Any] = [grid.x, grid.y, grid.z, grid.angles_deg, grid.rotation, *task]
    for part in (*parts, *(() if bodies is None else bodies)):
        array = np.ascontiguousarray(part)
        digest.update(f"{array.dtype} {array.shape} ".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()
