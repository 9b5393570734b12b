# SPDX-License-Identifier: Apache-2.0
"""Processes that share a grid's work: on this machine, or on several through Dask."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from importlib import import_module
from itertools import islice
from typing import Any

from cabols_control.errors import CabolsError
from cabols_control.workspace.bodies import InterferenceTask
from cabols_control.workspace.capacity import CapacityTask
from cabols_control.workspace.grid import (
    Piece,
    PoseGrid,
    WorkspaceMap,
    assemble,
    evaluate_piece,
    piece_of,
    pieces_of,
)

INLINE, LOCAL = "inline", "local"
CONNECT_TIMEOUT_S = 10
AHEAD = 3
"""Pieces for each worker that are asked for and not yet taken."""
QUIET = {"dashboard": False, "dashboard_address": "127.0.0.1:0"}
"""Of a local scheduler: no dashboard, and its HTTP server on any free port of this machine."""
Progress = Callable[[int, int], None]


def cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0))


class Workers:
    """Something that evaluates grids; made by `workers`.

    Attributes:
        count: number of processes (or threads of a cluster) that work.
        description: for messages.
    """

    def __init__(self, client: Any, count: int, description: str) -> None:
        """Use a Dask client; None works in this process."""
        self._client = client
        self.count = count
        self.description = description

    def evaluate(
        self,
        grid: PoseGrid,
        task: CapacityTask,
        bodies: InterferenceTask | None = None,
        free_above: float = 0.0,
        progress: Progress | None = None,
    ) -> WorkspaceMap:
        """Evaluate every pose of a grid.

        Args:
            grid: poses.
            task: rig, limits and required wrenches.
            bodies: for the interference test; None leaves it out.
            free_above: clearance that counts as free [m].
            progress: called with the pieces done and all pieces.

        Returns:
            The map; the same bits for any number of workers.
        """
        positions, rotations, parts = grid.positions, grid.rotations, pieces_of(grid)
        done: list[Piece | None] = [None] * len(parts)
        if self._client is None:
            for k, part in enumerate(parts):
                done[k] = evaluate_piece(task, bodies, positions[part], rotations)
                if progress is not None:
                    progress(k + 1, len(parts))
        else:
            self._gather(parts, positions, (task, bodies, rotations), done, progress)
        return assemble(grid, [piece for piece in done if piece is not None], free_above)

    def stream(
        self,
        grid: PoseGrid,
        task: CapacityTask,
        bodies: InterferenceTask | None,
        wanted: Iterable[int],
    ) -> Iterator[tuple[int, Piece]]:
        """Evaluate some pieces of a grid, as they come; memory does not grow with the grid.

        Args:
            grid: poses.
            task: rig, limits and required wrenches.
            bodies: for the interference test; None leaves it out.
            wanted: numbers of the pieces, from 0.

        Yields:
            Number and results of a piece; the same bits for any number of workers.
        """
        rotations = grid.rotations
        if self._client is None:
            for k in wanted:
                positions = grid.positions_of(piece_of(grid, k))
                yield k, evaluate_piece(task, bodies, positions, rotations)
            return
        as_completed: Any = import_module("distributed").as_completed
        waiting, numbers = iter(wanted), {}

        def submit(k: int) -> Any:
            positions = grid.positions_of(piece_of(grid, k))
            future = self._client.submit(
                evaluate_piece, task, bodies, positions, rotations, pure=False
            )
            numbers[future.key] = k
            return future

        running = as_completed([submit(k) for k in islice(waiting, AHEAD * self.count)])
        for future in running:
            yield numbers.pop(future.key), future.result()
            future.release()
            for k in islice(waiting, 1):
                running.add(submit(k))

    def map(self, function: Callable[[Any], Any], items: Iterable[Any]) -> list[Any]:
        """Apply a function to many items, as Python's map does.

        Args:
            function: of one item; it, the items and the results must allow pickling.
            items: taken at once, shared out in parts.

        Returns:
            The results in the order of the items.
        """
        arguments = list(items)
        if self._client is None:
            return [function(item) for item in arguments]
        size = max(len(arguments) // (4 * self.count), 1)
        parts = [arguments[k : k + size] for k in range(0, len(arguments), size)]
        done = self._client.gather(
            self._client.map(_apply, [function] * len(parts), parts, pure=False)
        )
        return [value for part in done for value in part]

    def _gather(
        self,
        parts: list[slice],
        positions: Any,
        common: tuple[CapacityTask, InterferenceTask | None, Any],
        done: list[Piece | None],
        progress: Progress | None,
    ) -> None:
        as_completed: Any = import_module("distributed").as_completed
        task, bodies, rotations = common
        futures = {
            self._client.submit(
                evaluate_piece, task, bodies, positions[part], rotations, pure=False
            ): k
            for k, part in enumerate(parts)
        }
        for count, future in enumerate(as_completed(list(futures)), start=1):
            done[futures[future]] = future.result()
            if progress is not None:
                progress(count, len(parts))


def _apply(function: Callable[[Any], Any], items: list[Any]) -> list[Any]:
    return [function(item) for item in items]


@contextmanager
def workers(scheduler: str = LOCAL, count: int | None = None) -> Iterator[Workers]:
    """Open workers; close them at the end.

    Args:
        scheduler: "local": new processes on this machine; "inline": none, this process alone; or
            the address of a Dask scheduler, such as tcp://10.0.0.5:8786, whose workers, on any
            number of machines, have this package installed.
        count: processes of "local"; None for one per core.

    Raises:
        CabolsError: if dask is missing, the count is below 1, or no scheduler or worker answers.
    """
    if scheduler == INLINE:
        yield Workers(None, 1, "this process")
        return
    try:
        distributed: Any = import_module("distributed")
    except ImportError as error:
        raise CabolsError(
            "scheduler: expected the Python package `dask[distributed]`, not found; install it "
            'with `pip install "dask[distributed]"`, or use "inline"'
        ) from error
    if scheduler == LOCAL:
        number = cores() if count is None else count
        if number < 1:
            raise CabolsError(f"workers: expected at least 1, got {number}")
        # Loopback only, and no dashboard: the scheduler must not be reachable from the network.
        cluster = distributed.LocalCluster(
            n_workers=number,
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            scheduler_kwargs=QUIET,
            silence_logs="ERROR",
        )
        with cluster, distributed.Client(cluster, timeout=CONNECT_TIMEOUT_S) as client:
            client.wait_for_workers(number, timeout=60)
            yield Workers(client, number, f"{number} processes on this machine")
        return
    try:
        client = distributed.Client(scheduler, timeout=CONNECT_TIMEOUT_S)
        client.wait_for_workers(1, timeout=CONNECT_TIMEOUT_S)
    except (OSError, ValueError, TimeoutError) as error:
        raise CabolsError(
            f"scheduler: expected a Dask scheduler with workers at {scheduler}, got {error}; start "
            "`dask scheduler`, then `dask worker ADDRESS` on each machine"
        ) from error
    with client:
        number = sum(client.nthreads().values())
        yield Workers(client, number, f"{number} threads of {scheduler}")
