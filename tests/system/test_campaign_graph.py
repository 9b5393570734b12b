# SPDX-License-Identifier: Apache-2.0
"""A short campaign through all real nodes in lockstep: killed, paused, aborted, completed."""

from __future__ import annotations

import threading

import numpy as np
import pytest
from cabols_msgs.msg import Mode
from std_srvs.srv import Trigger

from cabols_sim.bench.campaign import TOOL, BenchCampaign
from cabols_sim.bench.campaign_kills import Killer, finished, keys, short_campaign
from cabols_stiffness.analysis.source import read_source
from cabols_stiffness.campaign.journal import bags_of, read_samples
from cabols_stiffness.measurements.measured_load import to_cells
from graph_harness import Watcher, next_environment

WATCHED = ("mode", "campaign_status", "stiffness_estimate", "stiffness_load")


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    """One configuration, three reflectors, one load between two references."""
    folder = tmp_path_factory.mktemp("campaign")
    short_campaign(folder / "campaign.yaml", [9], 1)
    return BenchCampaign(folder / "data", str(folder / "campaign.yaml"))


def run(campaign, scenario=None):
    """Run the graph; the scenario plays beside it. Returns how it ended and what was said."""
    environment, lines, failure, watchers = next_environment(), [], [], []

    def start(_):
        def body():
            watcher = Watcher(int(environment["ROS_DOMAIN_ID"]), WATCHED)
            watchers.append(watcher)
            try:
                scenario(watcher)
            except BaseException as error:
                failure.append(error)

        threading.Thread(target=body, daemon=True).start()

    try:
        ended = campaign.run(
            lambda node, line: lines.append(f"{node}: {line}"),
            start if scenario is not None else None,
            environment,
        )
    finally:
        for watcher in watchers:
            watcher.close()
    if failure:
        raise AssertionError("\n".join(lines[-30:])) from failure[0]
    return ended, lines


def call(watcher, name):
    return watcher.call(Trigger, name, Trigger.Request())


def status(watcher):
    seen = watcher.seen["campaign_status"]
    return seen[-1] if seen else None


def pause_then_abort(watcher):
    """Pause after the first load, look, go on, abort."""
    watcher.wait(lambda: status(watcher) is not None and status(watcher).active, "a campaign")
    watcher.wait(lambda: len(watcher.seen["stiffness_load"]) > 0, "its first load")
    assert call(watcher, "pause_stiffness_test").success
    watcher.wait(lambda: status(watcher).phase == "paused", "the pause")
    assert watcher.modes()[-1] == Mode.LOADING
    count = len(watcher.seen["stiffness_load"])
    assert call(watcher, "resume_stiffness_test").success
    watcher.wait(lambda: len(watcher.seen["stiffness_load"]) > count, "a load after the pause")
    assert watcher.seen["stiffness_load"][count].branch == 0, "a new reference comes first"
    assert call(watcher, "abort_stiffness_test").success
    watcher.wait(lambda: not status(watcher).active, "the end")
    assert watcher.modes()[-1] == Mode.STOPPED


@pytest.mark.ros
@pytest.mark.slow
@pytest.mark.timeout(300)
def test_campaign_survives_a_kill_a_pause_and_an_abort(campaign):
    killer = Killer(campaign, "stiffness_campaign", 3)
    killed = campaign.run(lambda *_: None, killer.start, next_environment())
    assert killed.first == "stiffness_campaign"
    before = killer.before[: killer.before.rfind(b"\n") + 1]
    assert before.count(b"\n") - 1 >= 3
    assert not (bags_of(campaign.folder)[0] / "metadata.yaml").exists()

    ended, lines = run(campaign, pause_then_abort)
    assert ended.first == TOOL
    assert ended.code == 1, lines[-20:]
    assert any("aborted" in line for line in lines)
    assert (campaign.folder / "samples.csv").read_bytes().startswith(before)
    assert len(finished(campaign.folder)) > before.count(b"\n") - 1

    ended, lines = run(campaign)
    assert (ended.first, ended.code) == (TOOL, 0), lines[-20:]
    assert keys(campaign.folder) == {(9, reflector, 1) for reflector in range(3)}
    online = {(m.group, m.load): to_cells(m) for m in read_samples(campaign.folder)}
    offline = {(m.group, m.load): to_cells(m) for m in read_source(campaign.folder).loads}
    assert online == offline, "the bags alone say the same, digit by digit"
    assert len(bags_of(campaign.folder)) == 3
    loads = read_samples(campaign.folder)
    forces = [np.linalg.norm(m.average.wrench[:3]) for m in loads if m.branch]
    assert min(forces) > 100.0
    assert max(np.linalg.norm(m.average.wrench[:3]) for m in loads if not m.branch) < 20.0
