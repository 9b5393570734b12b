# SPDX-License-Identifier: Apache-2.0
"""A campaign's folder: plan, finished loads, log of failures; survives interruptions.

`campaign.yaml` holds the plan, `samples.csv` a line for each finished load, `log.csv` every retried
or skipped load with its reason, `bags/NNNN` a bag for each run. A line is on the disk before the
campaign continues; a last line that a power failure has cut is dropped, as its load was not
finished.
"""

from __future__ import annotations

import csv
import fcntl
import io
import os
from collections.abc import Iterable, Sequence
from pathlib import Path

from cabols_control.files.durable_file import sync_folder, write_durably
from cabols_control.files.output_folder import MARKER
from cabols_control.naming import load_name, number
from cabols_control.rig_folder import RigFolder
from cabols_stiffness.campaign.plan import CampaignPlan, load_plan, plan_text
from cabols_stiffness.campaign.requests import LoadKey
from cabols_stiffness.errors import CampaignError
from cabols_stiffness.measurements.measured_load import (
    INDICES,
    MeasuredLoad,
    columns,
    from_cells,
    present_name,
    to_cells,
)

PLAN, SAMPLES, LOG, BAGS, LOCK = "campaign.yaml", "samples.csv", "log.csv", "bags", ".lock"
MAY_BE_THERE = {LOCK, MARKER, "log"}
"""In a folder without a plan: what the commands make that run a campaign."""
LOG_COLUMNS = ("time_ns", "what", *INDICES, "reason")


class Table:
    """A CSV file to which lines are appended; each is on the disk before append() returns."""

    def __init__(self, path: Path, header: Sequence[str]) -> None:
        """Open or create; a last line without its end is dropped.

        Raises:
            CampaignError: if the file has another header.
        """
        self.path = path
        self._width = len(header)
        fresh = not path.exists() or path.stat().st_size == 0
        self._stream = path.open("a+b")
        if fresh:
            self.append(header)
            sync_folder(path.parent)
        self._drop_cut_line()
        found = [present_name(name) for name in next(iter(self._rows()), [])]
        if list(found) != list(header):
            raise CampaignError(
                f"{path}: expected columns {', '.join(header[:5])}, ..., got "
                f"{', '.join(found[:5])}, ...; was it written by another version, or with another "
                "number of limbs?"
            )

    def rows(self) -> list[list[str]]:
        """All lines but the header."""
        return self._rows()[1:]

    def append(self, cells: Sequence[str]) -> None:
        """Add one line; it is on the disk when this returns."""
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerow(cells)
        self._stream.write(text.getvalue().encode())
        self._stream.flush()
        os.fsync(self._stream.fileno())

    def close(self) -> None:
        """Close the file."""
        self._stream.close()

    def _rows(self) -> list[list[str]]:
        return _cells(self.path, self.path.read_bytes())

    def _drop_cut_line(self) -> None:
        content = self.path.read_bytes()
        whole = content.rfind(b"\n") + 1
        if whole < len(content):
            self._stream.truncate(whole)
            os.fsync(self._stream.fileno())


class Journal:
    """One campaign's folder, opened for writing by one process.

    Attributes:
        folder: where it is.
        plan: of the campaign.
        loads: finished so far, in order.
    """

    def __init__(
        self, folder: str | Path, campaign: str | Path = "", rig: str | Path | RigFolder = ""
    ) -> None:
        """Start a campaign, or continue the one in the folder.

        Args:
            folder: of the campaign; created if it is missing.
            campaign: path of the campaign.yaml; empty: the folder's own, or the rig's.
            rig: name or folder, see find_rig; empty: the reference bench.

        Raises:
            CampaignError: if another process writes there, or the folder holds another campaign or
                foreign files.
            ConfigError: if the campaign cannot be used.
        """
        self.folder = Path(folder)
        self._refuse_foreign_files()
        self.folder.mkdir(parents=True, exist_ok=True)
        self._lock = (self.folder / LOCK).open("w")
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            self._lock.close()
            raise CampaignError(
                f"{self.folder}: expected a folder that no campaign writes to, got one in use; "
                "is another campaign running?"
            ) from error
        try:
            self.plan = self._adopt(campaign, rig)
            self._samples = Table(self.folder / SAMPLES, columns(self.plan.limbs))
            self._log = Table(self.folder / LOG, LOG_COLUMNS)
            self.loads = self._read()
        except BaseException:
            self._lock.close()
            raise

    def _refuse_foreign_files(self) -> None:
        """Begin nothing among files that are no campaign's."""
        if not self.folder.is_dir() or (self.folder / PLAN).exists():
            return
        there = sorted({path.name for path in self.folder.iterdir()} - MAY_BE_THERE)
        if there:
            raise CampaignError(
                f"{self.folder}: expected a new or empty folder, or a campaign's, got one with "
                f"{', '.join(there[:3])}; name another folder"
            )

    def _adopt(self, campaign: str | Path, rig: str | Path | RigFolder) -> CampaignPlan:
        """Return the folder's campaign; store the requested one there if the folder has none."""
        own = self.folder / PLAN
        if not own.exists():
            plan = load_plan(campaign, rig)
            write_durably(own, plan_text(campaign, rig))
            if plan.rig.urdf:
                robot = Path(plan.rig.urdf)
                write_durably(self.folder / robot.name, robot.read_text(encoding="utf-8"))
            return load_plan(own)
        if campaign and plan_text(campaign, rig) != own.read_text(encoding="utf-8"):
            raise CampaignError(
                f"{self.folder}: expected an empty folder or the same campaign, got one with "
                f"another {PLAN}; name another folder, or leave the campaign out to go on"
            )
        return load_plan(own)

    def _read(self) -> list[MeasuredLoad]:
        return _loads(self._samples.path, self._samples.rows(), self.plan.limbs)

    @property
    def finished(self) -> set[LoadKey]:
        """Loads that need not be measured again."""
        return {LoadKey(m.configuration, m.reflector, m.load) for m in self.loads}

    @property
    def next_group(self) -> int:
        """First unused number of a pass."""
        return 1 + max((load.group for load in self.loads), default=-1)

    def bags(self) -> list[Path]:
        """Bags of all runs, oldest first."""
        return bags_of(self.folder)

    def new_bag(self) -> Path:
        """Return the folder for this run's bag; not yet there."""
        numbers = [int(path.name) for path in self.bags()]
        return self.folder / BAGS / f"{max(numbers, default=0) + 1:04d}"

    def add(self, load: MeasuredLoad) -> None:
        """Save a finished load."""
        self._samples.append(to_cells(load))
        self.loads.append(load)

    def adopt(self, loads: Iterable[MeasuredLoad]) -> int:
        """Save loads that are only in the bag of an interrupted run; return their number."""
        known = {(load.group, load.load) for load in self.loads}
        missing = [load for load in loads if (load.group, load.load) not in known]
        for load in missing:
            self.add(load)
        return len(missing)

    def tell(self, time_ns: int, what: str, keys: Iterable[LoadKey], reason: str) -> None:
        """Log retried or skipped loads; one line for each.

        Args:
            time_ns: rig's time [ns].
            what: was done, in a word.
            keys: of the loads.
            reason: why.
        """
        for key in keys:
            cells = (time_ns, what, key.configuration, key.reflector, key.load, reason)
            self._log.append([str(cell) for cell in cells])

    def close(self) -> None:
        """Release the folder for other writers."""
        self._samples.close()
        self._log.close()
        self._lock.close()


def bags_of(folder: str | Path) -> list[Path]:
    """A campaign's bags, oldest first."""
    place = Path(folder) / BAGS
    numbered = place.iterdir() if place.is_dir() else ()
    return sorted(path for path in numbered if path.name.isdigit())


def read_samples(folder: str | Path, skip: int = 0) -> list[MeasuredLoad]:
    """Finished loads of a campaign that another process may be writing.

    Args:
        folder: of the campaign.
        skip: number of first loads to leave out.

    Raises:
        CampaignError: if a line cannot be used.
    """
    path = Path(folder) / SAMPLES
    content = path.read_bytes()
    lines = _cells(path, content[: content.rfind(b"\n") + 1])
    limbs = sum(name.startswith("tension_") for name in lines[0]) if lines else 0
    return _loads(path, lines[1:], limbs)[skip:]


def _cells(path: Path, content: bytes) -> list[list[str]]:
    """Split a file's bytes into lines of cells.

    Raises:
        CampaignError: naming file and line, if a byte is no text or a line is no CSV.
    """
    try:
        text = content.decode("utf-8")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise CampaignError(
            f"{path}, line {line}: expected UTF-8 text, got the byte {content[error.start]:#04x}; "
            "restore the line from a copy, or delete it: its load is then measured again"
        ) from error
    rows = csv.reader(io.StringIO(text))
    try:
        return list(rows)
    except csv.Error as error:
        raise CampaignError(f"{path}, line {rows.line_num}: expected CSV, {error}") from error


def _loads(path: Path, rows: Sequence[list[str]], limbs: int) -> list[MeasuredLoad]:
    """Return the loads of samples.csv, each once.

    A pass and the load's place in it make a load: the same line again is the same load, another
    line about it is an error.

    Args:
        path: of the file, for messages.
        rows: behind the header.
        limbs: of the rig.

    Raises:
        CampaignError: naming the line that cannot be used.
    """
    found: dict[tuple[int, int], tuple[int, list[str], MeasuredLoad]] = {}
    for line, cells in enumerate(rows, start=2):
        try:
            load = from_cells(cells, limbs)
        except CampaignError as error:
            raise CampaignError(f"{path}, line {line}: {error}") from error
        before = found.setdefault((load.group, load.load), (line, cells, load))
        if before[1] != cells:
            raise CampaignError(
                f"{path}, line {line}: expected each load of a pass once, got "
                f"{load_name(load.load)} of pass {number(load.group)} with other values than in "
                f"line {before[0]}; delete the wrong one"
            )
    return [load for _, _, load in found.values()]


def read_log(folder: str | Path) -> list[dict[str, str]]:
    """Return the rows of log.csv by LOG_COLUMNS, also of a folder of version 0.1."""
    path = Path(folder) / LOG
    if not path.exists():
        return []
    lines = _cells(path, path.read_bytes())
    header = [present_name(name) for name in lines[0]] if lines else []
    return [dict(zip(header, cells, strict=False)) for cells in lines[1:]]
