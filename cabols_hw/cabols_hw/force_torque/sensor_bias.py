# SPDX-License-Identifier: Apache-2.0
"""The force/torque sensor's bias and its file: it outlives the bridge, as a load on gears does.

A bridge that starts while the gears hold a load must not take that load for zero. The newest bias
that was shown to be one is on the disk, with the sensor's serial number and the time.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cabols_control.checks import FloatArray, finite_array
from cabols_control.errors import CabolsError, ConfigError
from cabols_control.files.durable_file import write_durably
from cabols_control.files.state_folder import state_folder

FORM = 1
"""Version of the file."""
DAY_S = 86400.0
LONGEST_AGE_DAYS = 30.0
"""Age from which a bias counts as a guess: strain gauges drift [d]."""


@dataclass(frozen=True, eq=False)
class SensorBias:
    """What the gauges show without any cable.

    Attributes:
        serial: of the sensor and its calibration.
        time_ns: when it was measured, since the epoch [ns].
        volts: (6,) of the gauges [V].
        tare_weight: (6,) weight of the tool at that time, sensor axes [N, N m].
    """

    serial: str
    time_ns: int
    volts: FloatArray
    tare_weight: FloatArray

    def doubt(self, now_s: float) -> str:
        """Why this bias is no more than a guess; empty if it may be used for a load.

        Args:
            now_s: since the epoch, by the clock that stamped it [s].
        """
        days = (now_s - 1e-9 * self.time_ns) / DAY_S
        if -1.0 <= days <= LONGEST_AGE_DAYS:
            return ""
        when = f"{days:.0f} days old" if days > 0.0 else f"{-days:.0f} days in the future"
        return (
            f"the sensor's bias on the disk is {when}, at most {LONGEST_AGE_DAYS:g} days are "
            "trusted: pay the cables out until they hang, then tare; a pre-tightening proves it"
        )

    def unloaded_volts(self, matrix: FloatArray) -> FloatArray:
        """(6,) volts without the tool, too.

        Args:
            matrix: (6, 6) of the sensor's calibration [N/V, N m/V].
        """
        return self.volts - np.linalg.solve(matrix, self.tare_weight)


def bias_path(serial: str) -> Path:
    """File of a sensor's bias in the state folder.

    Args:
        serial: of the sensor.
    """
    return state_folder() / f"bias_{re.sub(r'[^A-Za-z0-9_.-]', '_', serial)}.json"


def save_bias(path: Path, bias: SensorBias) -> None:
    """Write a bias; the file is complete or as before.

    Args:
        path: of the file; its folder is made.
        bias: to write.

    Raises:
        CabolsError: if it cannot be written.
    """
    content = {
        "form": FORM,
        "serial": bias.serial,
        "time_ns": int(bias.time_ns),
        "volts": bias.volts.tolist(),
        "tare_weight": bias.tare_weight.tolist(),
    }
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_durably(path, json.dumps(content))
    except OSError as error:
        raise CabolsError(f"{path}: the sensor's bias cannot be written ({error})") from error


def load_bias(path: Path, serial: str) -> SensorBias | None:
    """Read a bias; None if there is no file yet.

    Args:
        path: of the file.
        serial: of the sensor that is connected.

    Raises:
        ConfigError: if the file cannot be used, or is of another sensor.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        return None
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: the sensor's bias cannot be read ({error})") from error
    try:
        content: dict[str, Any] = json.loads(text, object_pairs_hook=_each_once)
        form, found = content["form"], content["serial"]
        volts = finite_array("volts", _numbers(content["volts"]), (6,))
        weight = finite_array("tare_weight", _numbers(content["tare_weight"]), (6,))
        time_ns = content["time_ns"]
        if not (type(time_ns) is int and 0 <= time_ns < 1 << 63):
            raise ValueError(f"time_ns: expected a time in ns, got {time_ns!r}")
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError, CabolsError) as error:
        raise ConfigError(
            f"{path}: expected a sensor's bias as the bridge writes it ({error}); delete the file, "
            "then tare with slack cables"
        ) from error
    if form != FORM or found != serial:
        raise ConfigError(
            f"{path}: expected the bias of sensor {serial!r} in form {FORM}, got {found!r} in form "
            f"{form!r}; after an exchange of the sensor delete the file and tare with slack cables"
        )
    return SensorBias(serial, time_ns, volts, weight)


def _each_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Refuse a key that stands twice, of which JSON takes the last."""
    content = dict(pairs)
    if len(content) != len(pairs):
        raise ValueError("expected each key once, got one twice")
    return content


def _numbers(values: Any) -> Any:
    """Refuse true, false and text, which numpy reads as numbers."""
    if not (isinstance(values, list) and all(type(value) in (int, float) for value in values)):
        raise TypeError(f"expected a list of numbers, got {str(values)[:80]}")
    return values
