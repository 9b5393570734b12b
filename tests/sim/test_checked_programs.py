# SPDX-License-Identifier: Apache-2.0
"""What check_program calls feasible runs to its end, on rigs of 7, 8 and 10 cables.

The bridge's own guard judges, on the simulated plant, in one process.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lsim

from cabols_control.load_programs.feasibility import check_program, check_shaped
from cabols_control.load_programs.motor_demand import fastest_preview
from cabols_control.load_programs.preview import as_given, designed_response
from cabols_control.load_programs.programs import LoadProgram, steps
from cabols_control.rig import load_rig
from cabols_control.rig_tools.new_rig import make_rig
from cabols_control.supervision.modes import OperatingMode
from cabols_sim.fault_campaign.in_process.trials import Bench

CABLES = (7, 8, 10)
PUBLISHED_S = 0.004
"""Between two desired wrenches of the load programme's node."""
LONGEST_S = 2.0
KINDS = ("square", "steps", "near", "one axis", "sine")


@pytest.fixture(scope="module")
def benches(tmp_path_factory):
    made = {}
    for cables in CABLES:
        folder = tmp_path_factory.mktemp("rigs") / f"rig_{cables}"
        make_rig(folder, cables)
        made[cables] = load_rig(folder), Bench(folder)
    return made


def direction(random):
    found = random.normal(size=6) * [1, 1, 1, 0.08, 0.08, 0.08]
    if random.random() < 0.3:
        found[random.integers(6)] *= 10.0
    return found / max(np.linalg.norm(found[:3]) / 100.0, np.linalg.norm(found[3:]) / 8.0)


def programme(kind, random):
    """One of KINDS, of a size to be scaled."""
    zero = np.zeros(6)
    if kind == "square":
        step = random.uniform(0.1, 0.5)
        count = int(1.5 / step) + 2
        wrench = np.outer(np.arange(count) % 2, direction(random))
        return LoadProgram(kind, step * np.arange(count), wrench, True)
    if kind == "steps":
        times = np.cumsum([0.0, *random.uniform(0.05, 0.6, 4)])
        wrench = np.array([zero, *(direction(random) for _ in range(3)), zero])
        return LoadProgram(kind, times, wrench, True)
    if kind == "sine":
        times = np.arange(0.0, 1.6, 0.002)
        phase = 2.0 * np.pi * np.outer(times, np.exp(random.uniform(-1.0, 2.5, 6)))
        fade = np.clip(times / 0.3, 0.0, 1.0)[:, None]
        return LoadProgram(kind, times, fade * direction(random) * np.sin(phase), False)
    wrench = direction(random)
    if kind == "one axis":
        axis = random.integers(6)
        wrench = random.choice([-1.0, 1.0]) * np.eye(6)[axis] * (100.0 if axis < 3 else 8.0)
    rise = random.uniform(0.002, 0.5)
    return LoadProgram(kind, np.array([0.0, rise, 1.2]), np.array([zero, wrench, wrench]), False)


def largest(rig, given, previewed, check):
    """The programme, shaped, at the largest scale that a check calls feasible."""
    place = rig.geometry.reference_position, rig.geometry.reference_rotation

    def shaped(factor):
        scaled = given.scaled(factor)
        return fastest_preview(scaled, rig, *place, PUBLISHED_S) if previewed else as_given(scaled)

    low, high = 0.0, 8.0
    for _ in range(12):
        middle = 0.5 * (low + high)
        if check_program(rig, given.scaled(middle), *place).feasible:
            low = middle
        else:
            high = middle
    for _ in range(60):
        found = shaped(low)
        if check(rig, found, *place).feasible:
            return found
        low *= 0.96
    raise AssertionError("no scale is feasible")


def run(bench, shaped, previewed):
    """Load with it; return the rig."""
    rig = bench.zeroed(0)
    rig.mode = OperatingMode.LOADING
    rig.run(0.05)
    began_s, every = rig.now_s, round(PUBLISHED_S / 0.001) if previewed else 1
    for k in range(int(min(shaped.duration, LONGEST_S) / 0.001) + 200):
        if k % every == 0:
            rig.desired = np.array(shaped.reference.at(rig.now_s - began_s))
        rig.cycle()
        if rig.guard.fault is not None:
            break
    return rig


@pytest.mark.parametrize("previewed", [True, False])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("cables", CABLES)
def test_what_is_called_feasible_meets_no_limit(benches, cables, kind, previewed):
    rig, bench = benches[cables]
    random = np.random.default_rng([cables, *kind.encode(), previewed])
    shaped = largest(rig, programme(kind, random), previewed, check_shaped)
    assert run(bench, shaped, previewed).guard.fault is None


@pytest.mark.parametrize(("cables", "axis", "size"), [(10, 0, 100.0), (7, 4, 8.0), (7, 5, 8.0)])
def test_a_programme_that_is_too_fast_to_be_stopped_is_refused_and_would_trip(
    benches, cables, axis, size
):
    """Its wrenches are all within the limits: what the points alone tell calls it feasible."""
    rig, bench = benches[cables]
    place = rig.geometry.reference_position, rig.geometry.reference_rotation
    wrench = np.outer(np.arange(18) % 2, size * np.eye(6)[axis])
    given = LoadProgram("square", 0.1 * np.arange(18), wrench, True)

    def points(rig, shaped, *place):
        return check_program(rig, shaped.smoothed, *place)

    shaped = largest(rig, given, True, points)
    found = check_shaped(rig, shaped, *place)
    assert points(rig, shaped, *place).feasible
    assert not found.feasible
    assert "too fast" in found.sentence()
    assert run(bench, shaped, True).guard.fault is not None


def test_designed_response_is_that_of_scipy(rig):
    given = steps()
    found = designed_response(given, rig.control)
    poles, zero = np.array(rig.control.poles), abs(rig.control.zero)
    system = np.prod(-poles) * np.array([1.0 / zero, 1.0]), np.poly(poles)
    times = np.arange(0.0, given.duration, 0.0002)
    _, felt, _ = lsim(system, given.sample(times)[:, 0], times, interp=False)
    inside = found.time < given.duration - 0.01
    apart = np.interp(found.time[inside], times, felt) - found.wrench[inside, 0]
    # A step between two points is taken as a line: 1 ms of the steepest rise, at most.
    assert np.abs(apart).max() < 0.005 * np.abs(felt).max()
