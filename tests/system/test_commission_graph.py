# SPDX-License-Identifier: Apache-2.0
"""commission_bench on the real graph: what it writes, against the simulated rig's truth."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest

from cabols_control.configuration import read_yaml
from cabols_control.kinematics import cable_lengths
from cabols_control.rig import load_rig
from graph_harness import next_environment

pytestmark = [pytest.mark.ros, pytest.mark.slow, pytest.mark.timeout(120)]

LIMB = 2


def commission(folder, *words):
    """Run the tool on its own bench; in slow motion a stall of the machine counts for less."""
    path = os.pathsep.join(p for p in sys.path if p)
    return subprocess.run(
        [sys.executable, "-m", "cabols_sim.bench.commission", "--output", str(folder), *words],
        env={**os.environ, "PYTHONPATH": path, **next_environment()},
        capture_output=True,
        text=True,
        timeout=400,
        check=False,
    )


def test_limb_is_identified_and_what_is_written_loads(tmp_path, rig, plant_config):
    words = ("--limb", str(LIMB + 1), "--speed", "0.25", "--ramp-tension", "25")
    done = commission(tmp_path / "out", *words)
    assert done.returncode == 0, done.stdout + done.stderr
    for phase in ("slacken", "step", "coast", "back", "pre-tightening", "ramp"):
        assert phase in done.stdout
    again = load_rig(limbs=tmp_path / "out" / "limbs.yaml")
    truth = plant_config.limbs
    # Viscous friction is part of what (3.11) calls k and T: see physics.limb_step.
    slower = 1.0 + truth.gain[LIMB] * truth.viscous_current
    assert again.limbs.gain[LIMB] == pytest.approx(truth.gain[LIMB] / slower, rel=0.02)
    assert again.limbs.time_constant[LIMB] == pytest.approx(
        truth.time_constant[LIMB] / slower, rel=0.04
    )
    geometry = rig.geometry
    pose = (geometry.reference_position, geometry.reference_rotation)
    length = cable_lengths(geometry, *pose)[LIMB]
    compliance = 1.0 / truth.spring_stiffness + truth.cable_compliance_per_metre * length
    assert again.limbs.stiffness == pytest.approx(1.0 / compliance, rel=0.02)
    others = [i for i in range(8) if i != LIMB]
    assert [again.limbs.gain[i] for i in others] == [rig.limbs.gain[i] for i in others]
    gains = read_yaml(tmp_path / "out" / "gains.yaml")
    np.testing.assert_allclose(gains["k_I"], [g.integral for g in again.gains.limbs], rtol=1e-5)
    assert f"{LIMB + 1:4d}" in (tmp_path / "out" / "table.txt").read_text(encoding="utf-8")
    for name in (f"limb_{LIMB + 1}.png", "overview.png"):
        assert (tmp_path / "out" / name).read_bytes().startswith(b"\x89PNG")
