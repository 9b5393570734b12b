# SPDX-License-Identifier: Apache-2.0
"""Programmes followed without lag: against python-control's response, and by properties."""

from __future__ import annotations

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cabols_control.errors import ConfigError
from cabols_control.load_programs.feasibility import check_shaped
from cabols_control.load_programs.motor_demand import (
    CURRENT_SHARE,
    fastest_preview,
    motor_current,
)
from cabols_control.load_programs.preview import (
    PERIOD_S,
    as_given,
    shape_program,
    smoothed_rise_time,
)
from cabols_control.load_programs.programs import BUILT_IN, LoadProgram, load_program
from cabols_control.rig import load_rig
from cabols_control.rig_folder import rig_file
from cabols_hw.card.config import load_card
from cabols_sim.plant.closed_loop import simulate
from cabols_sim.plant.config import load_plant


@pytest.fixture(scope="module", params=["", "control_fast.yaml"], ids=["published", "fast"])
def design(request):
    path = rig_file(request.param) if request.param else None
    return load_rig(control=path)


def closed_loop(rig):
    """(3.26) by another library: poles, zero, gain one at rest."""
    poles, zero = np.array(rig.control.poles), -abs(rig.control.zero)
    gain = np.prod(-poles) / -zero
    return control.zpk([zero], poles, gain)


@pytest.mark.parametrize("name", sorted(BUILT_IN))
def test_the_designed_response_to_the_reference_is_the_smoothed_programme(design, name):
    shaped = shape_program(load_program(name), design.control)
    time, reference = shaped.reference.time, shaped.reference.wrench
    # The delay of the loop beside the design is previewed, too: put it back.
    delay = round(design.control.preview_delay / PERIOD_S)
    for axis in range(6):
        found = control.forced_response(closed_loop(design), time, reference[:, axis]).outputs
        wanted = shaped.smoothed.wrench[:, axis]
        late = np.concatenate([wanted[delay:], np.repeat(wanted[-1:], delay)])
        span = max(np.abs(wanted).max(), 1.0)
        assert np.abs(found - late).max() < 2e-3 * span


@settings(max_examples=30)
@given(
    times=st.lists(st.floats(0.002, 2.0), min_size=1, max_size=8),
    held=st.booleans(),
    seed=st.integers(0, 999),
)
def test_smoothing_keeps_range_area_and_rest(times, held, seed):
    rig, random = load_rig(), np.random.default_rng(seed)
    wrench = random.uniform(-50.0, 50.0, (len(times) + 2, 6))
    wrench[0] = wrench[-2:] = 0.0
    clock = np.concatenate([[0.0], np.cumsum(times), [sum(times) + 0.5]])
    program = LoadProgram("any", clock, wrench, held)
    shaped = shape_program(program, rig.control)
    smoothed = shaped.smoothed.wrench
    assert smoothed.min() >= wrench.min() - 1e-9
    assert smoothed.max() <= wrench.max() + 1e-9
    for ends in (smoothed[0], smoothed[-1], shaped.reference.wrench[0]):
        np.testing.assert_allclose(ends, 0.0, atol=1e-9)
    fine = np.arange(0.0, program.duration, PERIOD_S)
    area = PERIOD_S * program.sample(fine).sum(axis=0)
    np.testing.assert_allclose(PERIOD_S * smoothed.sum(axis=0), area, atol=0.11)


def test_sample_is_at(design):
    for name in BUILT_IN:
        program = load_program(name)
        times = np.random.default_rng(1).uniform(-1.0, program.duration + 1.0, 300)
        times = np.concatenate([times, program.time])
        expected = [program.at(float(time)) for time in times]
        np.testing.assert_allclose(program.sample(times), expected, atol=1e-12)


def test_bandwidth_is_at_least_what_is_stated():
    rig = load_rig()
    shaped = shape_program(load_program("steps"), rig.control)
    assert shaped.bandwidth >= rig.control.preview_bandwidth == 5.0
    frequency = shaped.bandwidth
    time = np.arange(0.0, 20.0 / frequency, PERIOD_S)
    wave = np.zeros((time.size, 6))
    wave[:, 0] = np.sin(2.0 * np.pi * frequency * time)
    smoothed = shape_program(LoadProgram("sine", time, wave, False), rig.control).smoothed
    middle = smoothed.wrench[smoothed.time.size // 3 : -smoothed.time.size // 3, 0]
    assert np.abs(middle).max() == pytest.approx(1.0 / np.sqrt(2.0), abs=0.01)
    assert 0.05 < smoothed_rise_time(rig.control) < 0.35 / frequency * 1.1


def test_smoothing_is_the_least_that_the_motors_bear():
    """Steps need 5 Hz; a slow sine is not smoothed more than it must be."""
    rig = load_rig()
    place = (rig.geometry.reference_position, rig.geometry.reference_rotation)
    assert fastest_preview(load_program("steps"), rig, *place).bandwidth < 6.0
    slow = fastest_preview(load_program("sines"), rig, *place)
    assert slow.bandwidth > 15.0
    for shaped in (slow, fastest_preview(load_program("steps").scaled(0.3), rig, *place)):
        current = np.abs(motor_current(rig, shaped.smoothed, *place)).max()
        assert current <= CURRENT_SHARE * rig.control.current_limit


@pytest.mark.parametrize("name", ["steps", "sines"])
def test_current_is_that_of_the_plant_without_friction(name):
    """The compiled loop's largest current, against the prediction from the smoothed wrench."""
    rig, plant = load_rig(), load_plant().linear()
    place = (rig.geometry.reference_position, rig.geometry.reference_rotation)
    shaped = fastest_preview(load_program(name), rig, *place)
    rest = np.zeros((1500, 6))
    trace = simulate(rig, load_card(), plant, np.vstack([rest, shaped.reference.wrench]))
    predicted = np.abs(motor_current(rig, shaped.smoothed, *place)).max()
    measured = np.abs(trace.current[1500:]).max()
    assert measured <= 1.15 * predicted
    assert (trace.status[1500:] == 0).all()


def test_preview_that_the_cables_cannot_give_is_refused_though_the_programme_is_feasible():
    """A step of 5 Hz needs a larger control signal than the load that it leads to."""
    rig = load_rig()
    pose = (rig.geometry.reference_position, rig.geometry.reference_rotation)
    given_, found = None, None
    for scale in np.arange(1.0, 12.0, 0.25):
        program = load_program("steps").scaled(scale)
        given_ = check_shaped(rig, as_given(program), *pose)
        found = check_shaped(rig, shape_program(program, rig.control), *pose)
        if given_.reached.all() and not found.reached.all():
            break
    assert given_.reached.all()
    assert not found.feasible
    assert "not feasible" in found.sentence()


@pytest.mark.parametrize("duration", [1e-300, 1e-6, 0.001, 0.013])
@pytest.mark.parametrize("held", [True, False])
def test_the_shortest_programmes_are_shaped(duration, held):
    rig = load_rig()
    wrench = np.array([[0.0] * 6, [5.0] + 5 * [0.0]])
    short = LoadProgram("short", np.array([0.0, duration]), wrench, held)
    place = rig.geometry.reference_position, np.eye(3)
    shaped = fastest_preview(short, rig, *place, 0.004)
    assert shaped.smoothed.wrench[0] == pytest.approx(np.zeros(6), abs=1e-9)
    assert shaped.smoothed.wrench[-1] == pytest.approx(wrench[1], abs=1e-9)
    assert np.abs(motor_current(rig, shaped.smoothed, *place)).max() > 0.0
    assert check_shaped(rig, shaped, *place).feasible


@pytest.mark.parametrize("duration", [36000.0, 1e9])
def test_a_programme_that_no_memory_holds_is_refused(duration):
    long = LoadProgram("long", np.array([0.0, duration]), np.zeros((2, 6)), held=False)
    with pytest.raises(ConfigError, match="preview:=false"):
        shape_program(long, load_rig().control)
    assert as_given(long).duration == duration
