# SPDX-License-Identifier: Apache-2.0
"""Learning over runs of a programme: convergence, bounds, storage, forgetting."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lsim
from scipy.spatial.transform import Rotation

from cabols_control.errors import CabolsError
from cabols_control.load_programs.feasibility import check_shaped
from cabols_control.load_programs.learning import (
    LARGEST_SHARE,
    apply_learnt,
    fingerprint,
    learn,
    load_learnt,
    nothing_learnt,
    save_learnt,
)
from cabols_control.load_programs.lessons import School
from cabols_control.load_programs.preview import shape_program
from cabols_control.load_programs.programs import LoadProgram
from cabols_control.rig import load_rig

RIG = load_rig()
PLACE = (np.array(RIG.geometry.reference_position), np.eye(3))


def program(frequency=0.5, duration=4.0):
    time = np.arange(0.0, duration, 0.001)
    fade = np.clip(np.minimum(time, duration - time), 0.0, 1.0)
    wrench = np.zeros((time.size, 6))
    wrench[:, 0] = 40.0 * fade * np.sin(2.0 * np.pi * frequency * time)
    return LoadProgram("sine", time, wrench, held=False)


def loop(shaped, gain=1.0, delay_s=0.0, friction=0.0):
    """What is felt: the designed response by scipy, with a gain and delay that nobody knows."""
    poles, zero = np.asarray(RIG.control.poles), -abs(RIG.control.zero)
    numerator = np.prod(-poles) * np.array([-1.0 / zero, 1.0])
    late = round((RIG.control.preview_delay + delay_s) / 0.001)
    felt = np.zeros_like(shaped.smoothed.wrench)
    column = shaped.reference.wrench[:, 0]
    _, out, _ = lsim((numerator, np.poly(poles)), column, shaped.smoothed.time)
    felt[late:, 0] = gain * out[: out.size - late]
    felt[:, 0] -= friction * np.sign(np.gradient(felt[:, 0]))
    return felt


def rms(shaped, felt):
    return float(np.sqrt(np.mean((felt - shaped.smoothed.wrench)[:, 0] ** 2)))


@pytest.mark.parametrize(
    ("gain", "delay_s", "friction"), [(1.05, 0.0, 0.0), (0.9, 0.006, 0.3), (1.0, -0.002, 0.5)]
)
def test_the_error_shrinks_run_by_run(gain, delay_s, friction):
    shaped = shape_program(program(), RIG.control)
    learnt, followed, found = nothing_learnt(shaped, "a", *PLACE), shaped, []
    for _ in range(5):
        felt = loop(followed, gain, delay_s, friction)
        found.append(rms(shaped, felt))
        learnt, forgotten = learn(learnt, shaped, shaped.smoothed.time, felt)
        assert not forgotten
        followed = apply_learnt(shaped, learnt, RIG, 0.0)
    assert found[-1] < 0.25 * found[0] + 0.25 * friction
    np.testing.assert_allclose(learnt.history[:, 0], found)
    # What is asked for, and what errors count against, is as before.
    np.testing.assert_array_equal(followed.smoothed.wrench, shaped.smoothed.wrench)
    np.testing.assert_array_equal(followed.command.wrench, shaped.command.wrench)


def test_a_correction_has_a_bound_and_no_high_frequencies():
    shaped = shape_program(program(), RIG.control)
    learnt = nothing_learnt(shaped, "a", *PLACE)
    noise = np.random.default_rng(0).normal(0.0, 1.0, shaped.smoothed.wrench.shape)
    wrong = np.full_like(shaped.smoothed.wrench, 1000.0)
    learnt, _ = learn(learnt, shaped, shaped.smoothed.time, -wrong)
    peak = np.abs(shaped.smoothed.wrench).max()
    assert np.abs(learnt.correction).max() <= LARGEST_SHARE * peak + 1e-9
    learnt, _ = learn(
        nothing_learnt(shaped, "a", *PLACE),
        shaped,
        shaped.smoothed.time,
        shaped.smoothed.wrench + noise,
    )
    window = np.hanning(learnt.correction.shape[0])
    spectrum = np.abs(np.fft.rfft(window * learnt.correction[:, 0]))
    frequency = np.fft.rfftfreq(learnt.correction.shape[0], 0.001)
    assert spectrum[frequency > 30.0].max() < 1e-3 * spectrum[frequency < 10.0].max()


def test_a_change_of_the_target_is_forgotten():
    shaped = shape_program(program(), RIG.control)
    learnt, _ = learn(
        nothing_learnt(shaped, "a", *PLACE),
        shaped,
        shaped.smoothed.time,
        0.98 * shaped.smoothed.wrench,
    )
    assert learnt.runs == 1
    learnt, forgotten = learn(learnt, shaped, shaped.smoothed.time, 0.8 * shaped.smoothed.wrench)
    assert forgotten
    assert learnt.runs == 0
    assert not learnt.correction.any()


def mark_of(shaped, rig=RIG, frame=b""):
    return fingerprint(shaped.command, frame, shaped.bandwidth, rig)


def learnt_once(shaped, folder, place=PLACE):
    """What one run taught at a place, and its file."""
    learnt, _ = learn(
        nothing_learnt(shaped, mark_of(shaped), *place),
        shaped,
        shaped.smoothed.time,
        0.9 * shaped.smoothed.wrench,
    )
    return learnt, save_learnt(learnt, folder)


def test_it_is_stored_and_found_again(tmp_path):
    shaped = shape_program(program(), RIG.control)
    learnt, path = learnt_once(shaped, tmp_path / "learnt")
    again, wrong = load_learnt(shaped, mark_of(shaped), PLACE, path.parent)
    assert not wrong
    np.testing.assert_array_equal(again.correction, learnt.correction)
    np.testing.assert_array_equal(again.history, learnt.history)
    assert [each.name for each in path.parent.iterdir()] == [path.name]
    path.write_bytes(path.read_bytes()[:200])
    again, wrong = load_learnt(shaped, mark_of(shaped), PLACE, path.parent)
    assert not again.runs
    assert "delete it" in wrong[0]


def test_what_is_stored_keeps_its_bound(tmp_path):
    """A file that asks for more than learning may teach is not followed."""
    shaped = shape_program(program(), RIG.control)
    learnt, _ = learnt_once(shaped, tmp_path)
    save_learnt(replace(learnt, correction=100.0 * learnt.correction), tmp_path)
    again, wrong = load_learnt(shaped, mark_of(shaped), PLACE, tmp_path)
    assert not again.correction.any()
    assert "at most" in wrong[0]
    school = School(RIG, 0.0, tmp_path)
    followed = school.apply(shaped, *PLACE)
    np.testing.assert_array_equal(followed.reference.wrench, shaped.reference.wrench)
    assert "delete it" in school.notes[0]


def test_it_holds_for_one_programme_rig_and_pose(tmp_path):
    shaped = shape_program(program(), RIG.control)
    mark = mark_of(shaped)
    control = replace(RIG.control, preview_bandwidth=RIG.control.preview_bandwidth + 1.0)
    others = {
        mark_of(shape_program(program(0.6), RIG.control)),
        mark_of(shape_program(program().scaled(1.1), RIG.control)),
        mark_of(shaped, frame=b"tip"),
        mark_of(shaped, replace(RIG, control=control)),
        mark_of(shaped, replace(RIG, geometry=replace(RIG.geometry, pulley_radius=0.03))),
    }
    assert len(others) == 5
    assert mark not in others
    learnt_once(shaped, tmp_path)
    turn = Rotation.from_rotvec([0.0, 0.0, 0.004]).as_matrix()
    for place, found in (
        ((PLACE[0] + [0.0007, 0.0, 0.0], PLACE[1]), 1),
        ((PLACE[0] + [0.005, 0.0, 0.0], PLACE[1]), 0),
        ((PLACE[0], turn), 0),
    ):
        assert load_learnt(shaped, mark, place, tmp_path)[0].runs == found


def test_a_pose_that_is_measured_each_time_is_the_same_pose(tmp_path):
    """Noise of the pose moves the wrenches of a frame, and must not make another programme."""
    random = np.random.default_rng(3)
    # Halfway between two millimetres, where rounding would fall to either side.
    start = np.round(PLACE[0], 3) + 0.0005
    asked, found = program(), []
    for _ in range(4):
        place = (start + random.normal(0.0, 2e-5, 3), np.eye(3))
        moved = replace(asked, wrench=asked.wrench + 1e-4 * random.normal(size=6))
        plain = shape_program(moved, RIG.control)
        school = School(RIG, 0.0, tmp_path)
        school.begin(school.apply(plain, *place, (asked, b"tip")))
        for time_s, wrench in zip(plain.smoothed.time, plain.smoothed.wrench, strict=True):
            school.note(time_s, 0.99 * wrench)
        found.append(school.finish())
    assert [line.split(" of ")[0] for line in found] == [f"run {k}" for k in (1, 2, 3, 4)]
    assert len(list(tmp_path.iterdir())) == 1


@pytest.mark.parametrize("kept", [slice(0, 2000), slice(500, None)])
def test_a_run_that_was_cut_teaches_nothing(kept):
    shaped = shape_program(program(), RIG.control)
    with pytest.raises(CabolsError, match="whole run"):
        learn(
            nothing_learnt(shaped, "a", *PLACE),
            shaped,
            shaped.smoothed.time[kept],
            shaped.smoothed.wrench[kept],
        )


def test_another_programmes_correction_is_refused():
    shaped = shape_program(program(), RIG.control)
    other = shape_program(program(duration=3.0), RIG.control)
    with pytest.raises(CabolsError, match="another programme"):
        apply_learnt(shaped, nothing_learnt(other, "a", *PLACE), RIG, 0.0)


def test_a_session_keeps_what_its_runs_taught(tmp_path):
    """Also over a restart; measured wrenches come in platform axes."""
    turn = Rotation.from_rotvec([0.0, 0.0, 0.35]).as_matrix()
    plain = shape_program(program(), RIG.control)
    errors = []
    for _ in range(3):
        school = School(RIG, 0.0, tmp_path)
        followed = school.apply(plain, PLACE[0], turn)
        school.apply(shape_program(program(0.7), RIG.control), PLACE[0], turn)  # a check beside it
        school.begin(followed)
        felt = loop(followed, 0.95)
        errors.append(rms(plain, felt))
        in_platform = (felt.reshape(-1, 2, 3) @ turn).reshape(-1, 6)
        for time_s, wrench in zip(plain.smoothed.time[::4], in_platform[::4], strict=True):
            school.note(time_s, wrench)
        assert school.finish().startswith(f"run {len(errors)} of this programme")
    assert errors[2] < 0.3 * errors[0]
    assert "no wrench" in School(RIG, 0.0, tmp_path).finish()
    school.forget(plain, PLACE[0], turn)
    again = School(RIG, 0.0, tmp_path).apply(plain, PLACE[0], turn)
    np.testing.assert_array_equal(again.reference.wrench, plain.reference.wrench)


def test_runs_that_add_nothing_are_counted(tmp_path):
    """A programme that nothing is added to is the same object run after run."""
    plain, school = shape_program(program(), RIG.control), School(RIG, 0.0, tmp_path)
    for run in (1, 2, 3):
        assert school.apply(plain, *PLACE) is plain
        school.begin(plain)
        for time_s, wrench in zip(plain.smoothed.time, plain.smoothed.wrench, strict=True):
            school.note(time_s, wrench)
        assert school.finish().startswith(f"run {run} of this programme")


def test_a_run_that_was_cut_is_not_learnt_from(tmp_path):
    plain = shape_program(program(), RIG.control)
    school = School(RIG, 0.0, tmp_path)
    school.begin(school.apply(plain, *PLACE))
    for time_s in plain.smoothed.time[:500]:
        school.note(time_s, np.zeros(6))
    assert "whole run" in school.finish()
    assert not list(tmp_path.iterdir())


def taught(school, plain, wrench, age_s=0.001):
    """Finish a run in which a wrench (k, 6) was felt."""
    school.begin(school.apply(plain, *PLACE))
    for time_s, felt in zip(plain.smoothed.time, wrench, strict=True):
        school.note(time_s, felt, age_s)
    return school.finish()


def test_a_run_on_a_platform_that_moved_teaches_nothing(tmp_path):
    plain = shape_program(program(), RIG.control)
    school = School(RIG, 0.0, tmp_path)
    school.begin(school.apply(plain, *PLACE))
    for time_s, felt in zip(plain.smoothed.time, plain.smoothed.wrench, strict=True):
        school.note(time_s, felt)
        school.note_pose(PLACE[0] + 0.01 * np.sin(time_s), PLACE[1])
    assert "moved" in school.finish()
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("age_s", [0.08, -0.05, 3.0])
def test_another_clock_teaches_nothing(tmp_path, age_s):
    plain = shape_program(program(), RIG.control)
    assert "clock" in taught(School(RIG, 0.0, tmp_path), plain, plain.smoothed.wrench, age_s)
    assert not list(tmp_path.iterdir())


def test_what_is_learnt_passes_no_limit(tmp_path):
    """A load near the largest one that the sensor allows, and a target that gave too little."""
    limits = RIG.plannable
    time = np.arange(0.0, 4.0, 0.001)
    wrench = np.zeros((time.size, 6))
    wrench[:, 2] = 0.95 * limits.wrench_max[2] * np.clip(np.minimum(time, 4.0 - time), 0.0, 1.0)
    plain = shape_program(LoadProgram("near", time, wrench, held=False), RIG.control)
    before = check_shaped(RIG, plain, *PLACE)
    school = School(RIG, 0.0, tmp_path)
    for _ in range(3):
        taught(school, plain, 0.7 * plain.smoothed.wrench)
    followed = school.apply(plain, *PLACE)
    assert any("% of what was learnt" in note for note in school.notes)
    after = check_shaped(RIG, followed, *PLACE)
    assert (after.reached & after.rated)[before.reached & before.rated].all()


def test_nothing_is_learnt_where_the_cables_cannot_give_the_wrench(tmp_path):
    """Beyond the limits the error is not a lesson: aiming still farther would help nobody."""
    time = np.arange(0.0, 6.0, 0.001)
    wrench = np.zeros((time.size, 6))
    wrench[:, 0] = 600.0 * np.clip(np.minimum(time, 6.0 - time) - 1.0, 0.0, 1.0)
    plain = shape_program(LoadProgram("beyond", time, wrench, held=False), RIG.control)
    school = School(RIG, 0.0, tmp_path)
    taught(school, plain, np.clip(plain.smoothed.wrench, -50.0, 50.0))
    learnt, _ = load_learnt(plain, mark_of(plain), PLACE, tmp_path)
    found = check_shaped(RIG, plain, *PLACE)
    middle = np.flatnonzero(~(found.reached & found.rated))[200:-200]
    assert middle.size > 1000
    assert np.abs(learnt.correction[middle]).max() < 0.5
