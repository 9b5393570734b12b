# SPDX-License-Identifier: Apache-2.0
"""Files of a loaded robot's path: read as written, or refused with the row."""

from __future__ import annotations

import numpy as np
import pytest

from cabols_control.errors import ConfigError
from cabols_hw.abb.configurations import load_configurations
from cabols_hw.abb.path import MOST_POINTS, path_points, read_path

HEADER = "joint_1,joint_2,joint_3,joint_4,joint_5,joint_6\n"


def written(folder, text):
    path = folder / "path.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_angles_are_degrees(tmp_path):
    path = written(tmp_path, HEADER + "0,10,-20.5,3e1,90, 180\n\n1,2,3,4,5,6\n")
    expected = np.deg2rad([[0, 10, -20.5, 30, 90, 180], [1, 2, 3, 4, 5, 6]])
    assert read_path(path) == pytest.approx(expected, abs=1e-15)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "header"),
        ("a,b\n1,2\n", "header"),
        (HEADER, "points"),
        (HEADER + "0,0,0,0,0,0\n" * (MOST_POINTS + 1), "points"),
        (HEADER + "1,2,3,4,5\n", "row 2"),
        (HEADER + "1,2,3,4,5,6,7\n", "row 2"),
        (HEADER + "0,0,0,0,0,0\n0,0,0,0,0,nan\n", "row 3"),
        (HEADER + "0,0,0,0,0,inf\n", "row 2"),
        (HEADER + "0,0,0,0,0,401\n", "degrees"),
        (HEADER + "0,0,0,0,0,1_0\n", "row 2"),
        (HEADER + "0,0,0,0,0,\u0661\n", "row 2"),
        (HEADER + '0,0,0,0,0,"1\n2"\n', "row 2"),
    ],
)
def test_what_is_no_path_is_refused(tmp_path, text, said):
    with pytest.raises(ConfigError, match=said):
        read_path(written(tmp_path, text))


def test_configurations_or_a_file(tmp_path):
    stored = load_configurations()
    found = path_points(stored, [1, 0], "", tmp_path)
    assert found == pytest.approx(np.array([stored.joints(1), stored.joints(0)]))
    for index, file in (([], ""), ([0], "path.csv"), ([len(stored)], ""), ([-1], "")):
        with pytest.raises(ConfigError):
            path_points(stored, index, file, tmp_path)
