# SPDX-License-Identifier: Apache-2.0
"""The flow of figure 4.5 against a rig that is a list of answers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cabols_control.errors import ConfigError
from cabols_stiffness.campaign.flow import Flow
from cabols_stiffness.campaign.plan import CampaignPlan, TensionPath, load_plan, points
from cabols_stiffness.campaign.requests import (
    Apply,
    BeginLoading,
    Finish,
    LoadKey,
    Measure,
    Move,
    Pretighten,
    Reply,
    Rest,
    Tell,
)

REST_N = 6.0


@pytest.fixture(scope="module")
def plan() -> CampaignPlan:
    """Two configurations, two reflectors, a way with three stops and one with a single one."""
    bench = load_plan()
    return replace(
        bench,
        configurations=[4, 2],
        reflectors=[0, 2],
        paths=[
            TensionPath([50.0] * 8, [0.5, 1.0], down=True),
            TensionPath([80.0] + [6.0] * 7),
        ],
        reference_every=1,
        validation_configurations=[],
        validation_paths=[],
        retries=1,
    )


class FakeRig:
    """Carries out everything; `replies` overrides the answer to a request, by a function of it."""

    def __init__(self, plan, finished=(), replies=lambda request: None, stop_after=None):
        self.flow = Flow(plan, REST_N, finished)
        self.seen = []
        steps = self.flow.steps()
        request = next(steps)
        try:
            while stop_after is None or len(self.measured) < stop_after:
                self.seen.append(request)
                request = steps.send(replies(request) or Reply())
        except StopIteration:
            return
        # A cut: the driver is gone, and with it the generator.
        steps.close()

    def all(self, kind):
        return [request for request in self.seen if isinstance(request, kind)]

    @property
    def measured(self):
        return [request.key for request in self.all(Measure)]


def test_trajectory_has_branches_and_references(plan):
    stops = points(plan.paths, 1, REST_N)
    assert [point.branch for point in stops] == [0, 1, 1, -1, 0, 1, 0]
    assert [point.load for point in stops] == list(range(7))
    np.testing.assert_allclose(stops[1].tension, 28.0)
    np.testing.assert_allclose(stops[3].tension, stops[1].tension)
    np.testing.assert_allclose(stops[4].tension, REST_N)
    assert plan.total(REST_N) == 2 * 2 * 7


def test_flow_goes_through_everything_once(plan):
    rig = FakeRig(plan)
    wanted = [LoadKey(c, r, load) for c in (4, 2) for r in (0, 2) for load in range(7)]
    assert rig.measured == wanted
    assert [type(request) for request in rig.seen[:4]] == [Move, Pretighten, BeginLoading, Apply]
    assert [request.configuration for request in rig.all(Move)] == [4, 2]
    assert isinstance(rig.seen[-1], Finish)
    assert not rig.all(Tell)


@pytest.mark.parametrize("cut", [1, 3, 4, 6, 9, 14, 20])
def test_cut_campaign_goes_on_at_the_last_finished_load(plan, cut):
    first = FakeRig(plan, stop_after=cut)
    done = set(first.measured[: cut - 1])
    second = FakeRig(plan, finished=done)
    loads = [key for key in second.measured if plan_branch(plan, key) != 0]
    assert not done & set(loads), "nothing is measured twice but references"
    assert done | set(second.measured) >= {
        LoadKey(c, r, load) for c in (4, 2) for r in (0, 2) for load in (1, 2, 3, 5)
    }
    # Whatever is measured anew has a reference of its own stay before it.
    first_of = {}
    for key in second.measured:
        first_of.setdefault(key[:2], key)
    assert all(plan_branch(plan, key) == 0 for key in first_of.values())


def plan_branch(plan, key):
    return points(plan.paths, plan.reference_every, REST_N)[key.load].branch


def test_resumed_unloading_branch_comes_from_its_peak(plan):
    done = {LoadKey(4, 0, load) for load in range(3)}
    rig = FakeRig(plan, finished=done)
    applied = [request.key.load for request in rig.all(Apply) if request.key[:2] == (4, 0)]
    assert applied[:4] == [0, 1, 2, 3], "a hysteretic robot remembers its way"
    assert [key.load for key in rig.measured if key[:2] == (4, 0)][:2] == [0, 3]


def test_failed_measurement_is_tried_again_then_skipped(plan):
    bad = LoadKey(4, 2, 2)

    def replies(request):
        if isinstance(request, Measure) and request.key == bad:
            return Reply("the beam is blocked")
        return None

    rig = FakeRig(plan, replies=replies)
    assert rig.measured.count(bad) == 2
    assert [(tell.what, tell.keys, tell.reason) for tell in rig.all(Tell)] == [
        ("retried", (bad,), "the beam is blocked"),
        ("skipped", (bad,), "the beam is blocked"),
    ]
    assert rig.flow.skipped == {bad}
    assert len(rig.flow.finished) == 2 * 2 * 7 - 1
    # It is not given up for ever: the next run tries it again.
    again = FakeRig(plan, finished=rig.flow.finished)
    assert bad in again.measured
    assert len(again.all(Move)) == 1


def test_load_beyond_the_limits_is_not_tried_again(plan):
    def replies(request):
        heavy = isinstance(request, Apply) and request.point.load == 2
        return Reply("beyond the limits", hopeless=True) if heavy else None

    rig = FakeRig(plan, replies=replies)
    assert {tell.what for tell in rig.all(Tell)} == {"skipped"}
    # Without its peak the way back is none.
    assert {key.load for key in rig.flow.skipped} == {2, 3}


def test_configuration_that_cannot_be_reached_is_skipped_whole(plan):
    def replies(request):
        stuck = isinstance(request, Move) and request.configuration == 4
        return Reply("the controller refuses") if stuck else None

    rig = FakeRig(plan, replies=replies)
    assert [request.configuration for request in rig.all(Move)] == [4, 4, 2]
    assert len(rig.flow.skipped) == 2 * 7
    assert {key.configuration for key in rig.measured} == {2}


def test_pause_rests_and_measures_a_new_reference(plan):
    asked = []

    def replies(request):
        if isinstance(request, Measure) and request.key == LoadKey(4, 0, 1) and not asked:
            asked.append(request)
            return Reply(pause=True)
        return None

    rig = FakeRig(plan, replies=replies)
    rest = next(i for i, request in enumerate(rig.seen) if isinstance(request, Rest))
    following = [r.key.load for r in rig.seen[rest:] if isinstance(r, Measure)]
    assert following[:3] == [0, 2, 3]
    assert len(rig.all(Rest)) == 1
    assert len(rig.flow.finished) == 2 * 2 * 7


def test_accuracy_ends_the_campaign_but_not_its_validation(plan):
    validated = replace(
        plan, validation_configurations=[7], validation_paths=[TensionPath([30.0] * 8)]
    )

    def replies(request):
        enough = isinstance(request, Measure) and request.key == LoadKey(4, 2, 5)
        return Reply(enough=True) if enough else None

    rig = FakeRig(validated, replies=replies)
    assert {key.configuration for key in rig.measured} == {4, 7}
    assert len([key for key in rig.measured if key.configuration == 7]) == 2 * 3


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"configurations": []}, "configurations: expected at least one"),
        ({"configurations": [1, 1]}, "each only once"),
        ({"reflectors": [3]}, "reflectors"),
        ({"averaging_time": float("nan")}, "averaging_time"),
        ({"model": "quartic"}, "expected one of linear"),
        ({"validation_configurations": [9]}, "validation"),
        ({"wrench_limit": [1.0]}, "wrench_limit"),
    ],
)
def test_plan_names_what_is_wrong(plan, changes, message):
    with pytest.raises(Exception, match=message):
        replace(plan, **changes)


def test_unknown_key_of_campaign_yaml_is_an_error(tmp_path):
    file = tmp_path / "campaign.yaml"
    text = "configurations: [1]\nspeed: 3\n"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match="speed"):
        load_plan(file)


def test_bench_campaign_is_ten_configurations_and_three_reflectors():
    plan = load_plan()
    assert len(plan.configurations) == 10
    assert plan.reflectors == [0, 1, 2]
    assert plan.validation_configurations
