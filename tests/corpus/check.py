# SPDX-License-Identifier: Apache-2.0
"""Read the corpus and compare with its table: `make corpus`."""

from __future__ import annotations

import shutil
import sys
import tempfile
import warnings
from pathlib import Path

import numpy as np
import yaml

from cabols_control.bags.reader import read_bag
from cabols_control.bags.recover import recover
from cabols_control.errors import CabolsError
from cabols_hw.force_torque.ati import read_calibration

HERE = Path(__file__).resolve().parent


def rows():
    """Every row of the table, with its kind."""
    table = yaml.safe_load((HERE / "table.yaml").read_text("utf-8"))
    return [(kind, row) for kind in ("bags", "calibrations") for row in table[kind]]


def heard(call):
    """What a call gives, or its documented error, and all that was said; others escape."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            found = call()
        except CabolsError as error:
            return None, str(error)
    return found, " ".join(str(warning.message) for warning in caught)


def wrong_of_bag(row):
    """What is not as the row says, as a list of texts."""
    bag, wrong = HERE / "bags" / row["file"], []
    topic, field = row.get("topic", "wrench"), row.get("field", "wrench.force.x")
    series, said = heard(lambda: read_bag(bag, [topic])[topic])
    came = "refused" if series is None else len(series)
    if came != row["read"]:
        wrong.append(f"read {came}")
    if series is not None:
        values = row.get("values", [*range(50), row.get("last", 50)][: len(series)])
        if not np.array_equal(series[field], values):
            wrong.append("other values")
    if row.get("says", "") not in said or bool(said) != ("says" in row):
        wrong.append(f"said {said!r}")
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "bag"
        shutil.copytree(bag, source)
        result, _ = heard(lambda: recover(source, Path(folder) / "out"))
        saved = None if result is None else result.messages
        if saved != row["saved"]:
            wrong.append(f"saved {saved}")
        elif row["saved"] and row["read"] != "refused":
            again, _ = heard(lambda: read_bag(Path(folder) / "out", [topic])[topic])
            if again is None or not np.array_equal(again[field], series[field]):
                wrong.append("the saved bag reads differently")
    return wrong


def wrong_of_calibration(row):
    """What is not as the row says, as a list of texts."""
    found, said = heard(lambda: read_calibration(HERE / "cal" / f"{row['file']}.cal"))
    wrong = []
    if row.get("says", "") not in said or bool(said) != ("says" in row):
        wrong.append(f"said {said!r}")
    if (found is None) != ("force" not in row):
        wrong.append("refused" if found is None else "read")
    elif found is not None:
        values = [found.matrix[0, 0], found.matrix[3, 3], found.saturated_volts]
        if not np.allclose(values, [row["force"], row["torque"], row["volts"]], rtol=1e-9):
            wrong.append(f"got {values}")
    return wrong


def wrong_of(kind, row):
    """What is not right of a row."""
    return wrong_of_bag(row) if kind == "bags" else wrong_of_calibration(row)


def right(row):
    """What is right, in a few words."""
    words = []
    if "read" in row:
        words.append(f"read {row['read']}, saved {row['saved']}")
    if "force" in row:
        words.append(f"{row['force']:g} N/V, {row['torque']:g} N m/V, to {row['volts']:g} V")
    if "says" in row:
        words.append(f"says {row['says']!r}")
    return "; ".join(words)


def main():
    """Print the table; 0 if every row is right."""
    bad = 0
    for kind, row in rows():
        wrong = wrong_of(kind, row)
        bad += bool(wrong)
        verdict = "right" if not wrong else "WRONG: " + "; ".join(wrong)
        print(f"{kind[:4]:4s} {row['file']:24s} {row['form']:42s} {right(row):60s} {verdict}")
        print(f"{'':29s} {row['source']}")
    print(f"{len(rows()) - bad} of {len(rows())} right")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
