# SPDX-License-Identifier: Apache-2.0
"""Efforts of joints become setpoints of all limbs, or are refused as a whole."""

from __future__ import annotations

import numpy as np
import pytest

from cabols_control.wrench_control.joint_commands import (
    JointCommandError,
    JointCommands,
    limb_joints,
    wrench_joints,
)

N = 8
NAMES = limb_joints(N)
MEASURED = np.linspace(10.0, 17.0, N)
NAN, INF = float("nan"), float("inf")


def commands():
    return JointCommands(N, 0.25)


def test_names_count_from_one():
    assert NAMES[0] == "cable_1"
    assert NAMES[-1] == f"cable_{N}"
    assert len(wrench_joints()) == 6
    assert not set(NAMES) & set(wrench_joints())


def test_all_limbs_in_any_order():
    order = np.random.default_rng(3).permutation(N)
    wanted = np.linspace(20.0, 34.0, N)
    found = commands().take(0.0, [NAMES[i] for i in order], wanted[order].tolist(), MEASURED)
    np.testing.assert_array_equal(found, wanted)


def test_one_limb_alone_leaves_the_others_as_they_were():
    taken = commands()
    found = taken.take(0.0, NAMES, [30.0 if i == 2 else NAN for i in range(N)], MEASURED)
    np.testing.assert_array_equal(found, np.where(np.arange(N) == 2, 30.0, MEASURED))
    # The sensor's noise of later samples is not followed.
    found = taken.take(0.1, ["cable_5"], [40.0], MEASURED + 1.0)
    wanted = MEASURED.copy()
    wanted[[2, 4]] = 30.0, 40.0
    np.testing.assert_array_equal(found, wanted)


@pytest.mark.parametrize("pause", [0.3, 100.0])
def test_after_silence_it_begins_with_what_the_limbs_have(pause):
    taken = commands()
    taken.take(0.0, ["cable_3"], [30.0], MEASURED)
    found = taken.take(pause, ["cable_5"], [40.0], MEASURED + 1.0)
    np.testing.assert_array_equal(found, np.where(np.arange(N) == 4, 40.0, MEASURED + 1.0))
    taken.reset()
    found = taken.take(pause, ["cable_1"], [11.0], MEASURED)
    np.testing.assert_array_equal(found[1:], MEASURED[1:])


def test_no_controller_no_command():
    assert commands().take(0.0, NAMES, [NAN] * N, MEASURED) is None
    assert commands().take(0.0, [], [], MEASURED) is None


@pytest.mark.parametrize(
    ("names", "efforts", "said"),
    [
        (["cable_9"], [10.0], "got cable_9"),
        (["cable_0"], [10.0], "got cable_0"),
        (["joint_1", "cable_1"], [10.0, 10.0], "got joint_1"),
        (["cable_1", "cable_1"], [10.0, 12.0], "each joint once"),
        (["cable_1", "cable_2"], [10.0], "an effort .* got 1"),
        (["cable_1"], [], "positions and velocities"),
        (["cable_1"], [INF], "finite efforts"),
        (["cable_1", "cable_2"], [10.0, -INF], "finite efforts"),
    ],
)
def test_what_cannot_be_used_changes_nothing(names, efforts, said):
    taken = commands()
    taken.take(0.0, NAMES, [20.0] * N, MEASURED)
    with pytest.raises(JointCommandError, match=said):
        taken.take(0.1, names, efforts, MEASURED)
    found = taken.take(0.2, ["cable_1"], [21.0], MEASURED)
    np.testing.assert_array_equal(found, [21.0] + [20.0] * (N - 1))


def test_limbs_without_a_zero_have_nothing_to_keep():
    unknown = np.full(N, NAN)
    with pytest.raises(JointCommandError, match="pre-tighten first"):
        commands().take(0.0, ["cable_1"], [10.0], unknown)
    np.testing.assert_array_equal(commands().take(0.0, NAMES, [9.0] * N, unknown), [9.0] * N)
