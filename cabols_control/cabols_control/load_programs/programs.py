# SPDX-License-Identifier: Apache-2.0
"""Load programmes: desired wrench over time, built in or from CSV."""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.errors import ConfigError
from cabols_control.files.given_file import read_given
from cabols_control.files.plain_numbers import plain_number

COMPONENTS = ("fx", "fy", "fz", "mx", "my", "mz")
_NOT_FINITE = ("nan", "inf", "-inf")
LARGEST = 1e9
"""Largest number in a file: beyond any rig, and far from where sums of numbers overflow."""
CSV_HEADER = ("time_s", "fx_n", "fy_n", "fz_n", "mx_nm", "my_nm", "mz_nm")


@dataclass(frozen=True, eq=False)
class LoadProgram:
    """Desired wrench on the platform, at its origin, in base axes.

    Attributes:
        name: for messages and bags.
        time: (k,) increasing, from 0 [s].
        wrench: (k, 6) force [N] and torque [N m] at each time.
        held: True for steps (a value holds until the next time), False for straight lines.
    """

    name: str
    time: FloatArray
    wrench: FloatArray
    held: bool

    @property
    def duration(self) -> float:
        """Time of the last point [s]."""
        return float(self.time[-1])

    def at(self, time_s: float) -> FloatArray:
        """Return the (6,) desired wrench at a time; zero before the start, last value after it."""
        if not time_s >= self.time[0]:
            return np.zeros(6)
        after = int(np.searchsorted(self.time, time_s, side="right"))
        if self.held or after == self.time.size:
            return np.array(self.wrench[after - 1])
        t0, t1 = self.time[after - 1], self.time[after]
        share = (time_s - t0) / (t1 - t0)
        return np.asarray((1.0 - share) * self.wrench[after - 1] + share * self.wrench[after])

    def sample(self, times: FloatArray) -> FloatArray:
        """Return the (m, 6) desired wrenches at (m,) times, as `at` gives them one by one."""
        after = np.searchsorted(self.time, times, side="right")
        before = np.maximum(after - 1, 0)
        found = self.wrench[before]
        if not self.held:
            end = np.minimum(after, self.time.size - 1)
            length = self.time[end] - self.time[before]
            share = (times - self.time[before]) / np.where(length > 0.0, length, np.inf)
            found = found + share[:, None] * (self.wrench[end] - found)
        found[after == 0] = 0.0
        return found

    def scaled(self, factor: float) -> LoadProgram:
        """Return the same programme with every wrench multiplied.

        Raises:
            ConfigError: if the factor is not finite, or makes a wrench beyond LARGEST.
        """
        most = float(np.abs(self.wrench).max())
        if not abs(factor) * most <= LARGEST or not np.isfinite(factor):
            raise ConfigError(
                f"scale: expected a finite number that keeps {self.name} below {LARGEST:g} N, "
                f"got {factor!r}"
            )
        return LoadProgram(self.name, self.time, self.wrench * factor, self.held)


def steps() -> LoadProgram:
    """One component after the other: a step up and back to zero, 1.5 s each."""
    levels = np.diag([40.0, 40.0, 60.0, 4.0, 4.0, 4.0])
    time = [0.0]
    wrench = [np.zeros(6)]
    for k, level in enumerate(levels):
        time += [0.5 + 3.0 * k, 2.0 + 3.0 * k]
        wrench += [level, np.zeros(6)]
    return LoadProgram(
        "steps", np.array([*time, time[-1] + 1.5]), np.array([*wrench, 0 * wrench[0]]), True
    )


def ramps() -> LoadProgram:
    """All components together up to a plateau, down through zero to its negative, and back."""
    peak = np.array([30.0, -30.0, 50.0, 3.0, -3.0, 3.0])
    factors = [0.0, 1.0, 1.0, 0.0, -1.0, -1.0, 0.0]
    time = [0.0, 3.0, 5.0, 8.0, 11.0, 13.0, 16.0]
    return LoadProgram("ramps", np.array(time), np.outer(factors, peak), False)


def sines() -> LoadProgram:
    """A sine in each component with its own frequency, 0.1 to 0.35 Hz, faded in and out."""
    time = np.arange(0.0, 20.0 + 1e-9, 0.01)
    amplitude = np.array([25.0, 25.0, 35.0, 2.5, 2.5, 2.5])
    frequency = np.array([0.10, 0.15, 0.20, 0.25, 0.30, 0.35])
    fade = np.clip(np.minimum(time, time[-1] - time) / 2.0, 0.0, 1.0)
    phase = 2.0 * np.pi * np.outer(time, frequency)
    return LoadProgram("sines", time, fade[:, None] * amplitude * np.sin(phase), False)


def multi_axis() -> LoadProgram:
    """A 6-DOF trajectory as in section 3.5: steps of single components, then several at once.

    The source's figure 3.11 is a picture without numbers; this programme keeps its character:
    20 s, every component is loaded, steps of 1 s among longer ones (7.5 to 8.5 s), overlapping.
    """
    table = [
        # time    fx     fy     fz    mx    my    mz
        (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        (1.0, 40.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        (3.0, 40.0, -30.0, 0.0, 0.0, 0.0, 0.0),
        (5.0, 0.0, -30.0, 50.0, 0.0, 0.0, 0.0),
        (6.5, 0.0, 0.0, 50.0, 0.0, 0.0, 0.0),
        (7.5, 0.0, 0.0, 0.0, 3.0, 0.0, 0.0),
        (8.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        (9.5, 0.0, 0.0, 0.0, 0.0, -3.0, 0.0),
        (11.0, 0.0, 0.0, 0.0, 0.0, -3.0, 3.0),
        (12.5, -25.0, 25.0, -30.0, 0.0, 0.0, 3.0),
        (14.5, -25.0, 25.0, -30.0, -2.0, 2.0, -2.0),
        (17.0, 20.0, 20.0, 20.0, 2.0, 2.0, 2.0),
        (19.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        (20.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    ]
    points = np.array(table)
    return LoadProgram("multi_axis", points[:, 0].copy(), points[:, 1:].copy(), True)


BUILT_IN: dict[str, Callable[[], LoadProgram]] = {
    "steps": steps,
    "ramps": ramps,
    "sines": sines,
    "multi_axis": multi_axis,
}


def read_csv(path: str | Path) -> LoadProgram:
    """Read a programme from a CSV file: see parse_csv.

    Raises:
        ConfigError: naming the file and the line of what cannot be used.
    """
    source = Path(path)
    try:
        # Spreadsheets begin their UTF-8 by a byte order mark.
        text = read_given(source, "utf-8-sig")
    except UnicodeDecodeError as error:
        raise ConfigError(f"{source}: expected UTF-8; save it as CSV UTF-8 ({error})") from error
    except OSError as error:
        raise ConfigError(f"{source}: cannot be read ({error})") from error
    return parse_csv(text, source.stem, str(source))


def parse_csv(text: str, name: str, source: str) -> LoadProgram:
    """Read CSV: header `time_s,fx_n,fy_n,fz_n,mx_nm,my_nm,mz_nm`, straight lines between rows.

    Args:
        text: of the file.
        name: of the programme.
        source: what messages call the file.

    Raises:
        ConfigError: naming the source and the line of what cannot be used.
    """
    try:
        # Not splitlines(), which takes eight more characters for ends of lines. The ends are kept:
        # a number in quotes that goes on in the next line is none.
        ended = [line + "\n" for line in text.replace("\r\n", "\n").split("\n")]
        rows = list(csv.reader(ended))
    except csv.Error as error:
        raise ConfigError(
            f"{source}: cannot be read ({error}); save it as plain CSV with a line for each time"
        ) from error
    header = tuple(cell.strip() for cell in rows[0]) if rows else ()
    if header != CSV_HEADER:
        raise ConfigError(
            f"{source}: expected the header {','.join(CSV_HEADER)}, got {str(header)[:200]}; times "
            "in s, forces in N, torques in N m, decimal points, commas between columns"
        )
    values, lines = [], []
    for number, row in enumerate(rows[1:], start=2):
        if not row:
            continue
        try:
            cells = [cell for cell in row if cell.strip() not in _NOT_FINITE]
            numbers = [plain_number(cell, LARGEST) for cell in cells]
        except ValueError as error:
            raise ConfigError(f"{source}, line {number}: {error}") from error
        if not len(numbers) == len(row) == len(CSV_HEADER):
            raise ConfigError(
                f"{source}, line {number}: expected 7 finite numbers, got {str(row)[:200]}"
            )
        values.append(numbers)
        lines.append(number)
    table = np.array(values, dtype=np.float64).reshape(-1, len(CSV_HEADER))
    time, *_ = table.T
    if time.size < 2:
        raise ConfigError(
            f"{source}: expected at least two lines below the header, time from 0 and increasing, "
            f"got {time.size}; to hold a wrench, repeat it at a later time"
        )
    if time[0] != 0.0:
        raise ConfigError(
            f"{source}, line {lines[0]}: expected time from 0 and increasing, got {time[0]:g} s"
        )
    if not np.diff(time).min() > 0.0:
        k = int(np.flatnonzero(~(np.diff(time) > 0.0))[0]) + 1
        raise ConfigError(
            f"{source}, line {lines[k]}: expected time from 0 and increasing, got {time[k]:g} s "
            f"after {time[k - 1]:g} s; write a step as two rows a millisecond apart"
        )
    return LoadProgram(name, time.copy(), table[:, 1:].copy(), False)


def load_program(name: str) -> LoadProgram:
    """Return a built-in programme, or read the CSV file of that path.

    Raises:
        ConfigError: if there is neither.
    """
    if name in BUILT_IN:
        return BUILT_IN[name]()
    if Path(name).suffix.lower() == ".csv":
        return read_csv(name)
    raise ConfigError(
        f"program: expected one of {', '.join(sorted(BUILT_IN))} or the path of a .csv file, "
        f"got {name!r}"
    )
