# SPDX-License-Identifier: Apache-2.0
"""Rows and columns have names, and kernels have short argument lists, in all four packages."""

from __future__ import annotations

from pathlib import Path

import pytest

from named_columns import MOST_ARGUMENTS, long_kernels, numbered_columns

TREE = Path(__file__).parents[2]
PACKAGES = ("cabols_control", "cabols_hw", "cabols_sim", "cabols_stiffness")
FLAT_ARRAY = "cabols_control/cabols_control/tension/kernels/"
"""The tension kernels' flat work array: faster than records, its places are named functions."""
ALLOWED = {
    # np.cross over the last axis, faster: x, y and z of any vectors.
    "cabols_stiffness/cabols_stiffness/model/robot.py": {"one[..., ", "other[..., "},
}
"""Beginnings of what else is allowed in a file."""


def modules():
    for package in PACKAGES:
        for path in sorted((TREE / package / package).rglob("*.py")):
            if not path.name.endswith(("_pb2.py", "_pb2_grpc.py")):  # generated
                yield path.relative_to(TREE).as_posix(), path.read_text(encoding="utf-8")


def test_no_number_stands_for_a_row_or_column():
    found = [
        f"{name}:{finding.line}: {finding.code}"
        for name, source in modules()
        if not name.startswith(FLAT_ARRAY)
        for finding in numbered_columns(source)
        if not any(finding.code.startswith(each) for each in ALLOWED.get(name, ()))
    ]
    assert not found, "name these: a record's field, an unpacked value, an IntEnum"


def test_no_kernel_takes_a_long_list_of_arguments():
    found = [
        f"{name}:{finding.line}: {finding.code}"
        for name, source in modules()
        for finding in long_kernels(source)
    ]
    assert not found, f"at most {MOST_ARGUMENTS}: put what belongs together into a record"


def test_what_is_allowed_is_there():
    """An entry that nothing needs any more goes."""
    sources = dict(modules())
    assert any(numbered_columns(sources[name]) for name in sources if name.startswith(FLAT_ARRAY))
    for name, beginnings in ALLOWED.items():
        codes = [finding.code for finding in numbered_columns(sources[name])]
        for beginning in beginnings:
            assert any(code.startswith(beginning) for code in codes), (name, beginning)


@pytest.mark.parametrize(
    "planted",
    [
        "speed = rows[4]",
        "bound = limits[6]",
        "stiffness = table[:, 8]",
        "zero = state[:, 0]",
        "first = self._rows[..., 1]",
        "rows[5][i] = 0.0",
        "rows[4, i] = 0.0",
        "drive(table[i, 3])",
        "wrench[6] = 0.0",
        "a = wrenches[:, 3]",
    ],
)
def test_a_planted_number_is_found(planted):
    assert [finding.line for finding in numbered_columns("x = 1\n" + planted)] == [2]


@pytest.mark.parametrize(
    "allowed",
    [
        "torque_z = wrench[5]",
        "turned[3] += centre[1] * pull[2]",
        "x, y = points[:, 0], points[:, 1]",
        "stiffness = table['stiffness']",
        "last = rows[-1]",
        "head = rows[:4]",
        "item = rows[k, i]",
        "x = position[0]",
    ],
)
def test_axes_names_and_variables_are_no_findings(allowed):
    assert numbered_columns(allowed) == []


@pytest.mark.parametrize("decorator", ["@njit(cache=True)", "@njit", "@numba.njit", "@compiled"])
def test_a_planted_long_kernel_is_found(decorator):
    names = [f"a{k}" for k in range(MOST_ARGUMENTS + 1)]
    kernel = f"{decorator}\ndef kernel({', '.join(names)}):\n    pass\n"
    assert [each.code for each in long_kernels(kernel)] == [f"kernel: {len(names)} arguments"]
    assert long_kernels(f"{decorator}\ndef kernel({', '.join(names[1:])}):\n    pass\n") == []
    assert long_kernels(f"def plain({', '.join(names)}):\n    pass\n") == []
