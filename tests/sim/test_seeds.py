# SPDX-License-Identifier: Apache-2.0
"""A seed of the simulated rig reaches every source of noise."""

from __future__ import annotations

import numpy as np

from cabols_control.bringup.specs import give
from cabols_sim.bringup_nodes import ARGUMENTS, bench_graph
from cabols_sim.devices.simulator import _arguments, tracker_truth
from cabols_sim.devices.tracker.model import TrackerModel


def measured(seed):
    """Three readings of a resting reflector, by a tracker of a device simulator with this seed."""
    model = TrackerModel(tracker_truth(_arguments(["--seed", str(seed)])))
    model.observe(1_000_000_000, [0.0, 1.2, 0.8], np.eye(3), 0.0, False)
    path = np.tile([2.0, 0.1, 0.3], (2, 1))
    times = [[10**9 * k, 10**9 * k + 10**8] for k in (2, 3, 4)]
    return np.array([model.average(pair, path, 1000.0).position for pair in times])


def test_graph_gives_the_seed_to_plant_and_devices():
    nodes = {node.executable: node for node in give(bench_graph(), ARGUMENTS, {"seed": 7})}
    assert nodes["device_simulator"].options["seed"] == 7
    assert dict(nodes["plant"].parameters)["seed"] == 7


def test_trackers_of_two_seeds_draw_other_noise_and_drift():
    same, again, other = measured(3), measured(3), measured(4)
    np.testing.assert_array_equal(same, again)
    assert np.abs(same - other).min() > 1e-9
    drift = (same - other).mean(axis=0)
    assert np.abs(drift).max() > 1e-7
