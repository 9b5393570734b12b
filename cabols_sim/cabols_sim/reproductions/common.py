# SPDX-License-Identifier: Apache-2.0
"""What the reproductions share: the bench's configuration, the form of a result, the lone limb."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.compiling import njit
from cabols_control.gains import LimbGains
from cabols_control.limb_control.law import advance_law
from cabols_control.limb_control.records import limb_records
from cabols_control.rig import Rig, load_rig
from cabols_control.rig_folder import BENCH
from cabols_hw.card.config import CardConfig, load_card
from cabols_sim.plant.config import LimbPlantConfig, PlantConfig, load_plant
from cabols_sim.plant.limb_physics import LIMB_STATE, limb_step

PERIOD_S = 0.001
CABLE_LENGTH_M = 1.424
"""Mean cable length of the bench; 6.55e-5 1/N then is 10.72 N/mm."""
K_SPRING, K_CABLE = 2200.0, 10720.0
"""k_e with and without the spring [N/m], section 3.4.1."""
DPI = 120


@dataclass(frozen=True)
class Bench:
    """Configuration of the reference bench."""

    rig: Rig
    card: CardConfig
    plant: PlantConfig


@cache
def bench(rig: str = BENCH) -> Bench:
    """Read a rig's files once; the source's results are of the reference bench."""
    return Bench(load_rig(rig), load_card(rig), load_plant(rig))


def without_spring(limbs: LimbPlantConfig) -> LimbPlantConfig:
    """Return the same limbs, the cable tied directly."""
    return replace(limbs, spring_stiffness=0.0)


def sample_times(samples: int) -> FloatArray:
    """(k,) times of samples from zero [s]."""
    return np.multiply(PERIOD_S, np.arange(samples))


class LimbTrace(NamedTuple):
    """A lone limb's test, k samples of 1 ms.

    Attributes:
        time: (k,) [s].
        command: (k,) desired tension [N].
        tension: (k,) true [N].
        estimate: (k,) k_e times elongation (3.9) [N].
        wound: (k,) cable wound in, by the motor's encoder [m].
        current: (k,) [A].
    """

    time: FloatArray
    command: FloatArray
    tension: FloatArray
    estimate: FloatArray
    wound: FloatArray
    current: FloatArray


class _Settings(NamedTuple):
    stiffness: float
    counts_per_metre: float
    current_limit: float
    substeps: int


@njit(cache=True)
def _drive(
    parameters: Any, current: FloatArray, rest: float, counts: float, substeps: int
) -> FloatArray:
    """Wound length by the encoder for given currents; rest > length: a slack cable."""
    state, tension = np.zeros(1, LIMB_STATE), np.zeros(1)
    length, wound = np.full(1, CABLE_LENGTH_M), np.zeros(current.size)
    ends = np.full(1, rest)
    dt_s = PERIOD_S / substeps
    for k in range(current.size):
        position = state[0]["motor_position"]
        wound[k] = np.floor(position * counts) / counts if counts > 0.0 else position
        for _ in range(substeps):
            limb_step(parameters, state, current[k : k + 1], ends, length, dt_s, tension)
    return wound


def drive_slack_limb(
    limbs: LimbPlantConfig, limb: int, current: FloatArray, counts_per_metre: float, substeps: int
) -> FloatArray:
    """Put currents on a motor whose cable is slack (spring off), as section 3.4.3 identifies.

    Args:
        limbs: true physics.
        limb: index from 0.
        current: (k,) held for 1 ms each [A].
        counts_per_metre: of the encoder; 0 for an ideal one.
        substeps: integration steps in a sample.

    Returns:
        (k,) cable wound in [m].
    """
    lone = limbs.parameters[limb : limb + 1]
    return np.asarray(_drive(lone, current, 1e3, counts_per_metre, substeps))


@njit(cache=True)
def _close_loop(
    parameters: Any,
    limbs: Any,
    command: FloatArray,
    settings: _Settings,
    record: LimbTrace,
) -> None:
    plant, limb, state = parameters[0], limbs[0], np.zeros(1, LIMB_STATE)
    length, tension, current = np.full(1, CABLE_LENGTH_M), np.full(1, command[0]), np.zeros(1)
    cable = plant["cable_compliance_fixed"] + plant["cable_compliance_per_metre"] * length[0]
    stretch = command[0] * cable
    stretch += max(command[0] - plant["spring_initial_tension"], 0.0) * plant["spring_compliance"]
    # The motor has wound in: it stands half the backlash ahead of the pulley.
    state[0]["motor_position"] = 0.5 * plant["backlash"]
    zero = state[0]["motor_position"] - command[0] / settings.stiffness
    rest = length - stretch
    dt_s, counts = PERIOD_S / settings.substeps, settings.counts_per_metre
    for k in range(command.size):
        position = state[0]["motor_position"]
        wound = np.floor(position * counts) / counts if counts > 0.0 else position
        limb["position"] = wound - zero
        if k == 0:
            limb["last_position"] = limb["position"]
        estimate = settings.stiffness * limb["position"]
        limb["reference"] = limb["tension_gain"] * (command[k] - estimate)
        advance_law(limbs, PERIOD_S, settings.current_limit)
        current[0] = limb["law_current"]
        record.tension[k], record.estimate[k] = tension[0], estimate
        record.wound[k], record.current[k] = wound, current[0]
        for _ in range(settings.substeps):
            limb_step(parameters, state, current, rest, length, dt_s, tension)


def control_limb(
    limbs: LimbPlantConfig,
    limb: int,
    gains: LimbGains,
    stiffness: float,
    command: FloatArray,
    ideal_encoder: bool = False,
) -> LimbTrace:
    """Run the limb law (3.10) on a lone limb with a tight cable.

    Args:
        limbs: true physics.
        limb: index from 0.
        gains: of the law.
        stiffness: k_e of the estimate [N/m].
        command: (k,) desired tension; the limb starts at rest with the first one [N].
        ideal_encoder: whether counts need not be whole.

    Returns:
        What happened.
    """
    setup = bench()
    counts = 0.0 if ideal_encoder else setup.card.counts_per_metre
    trace = LimbTrace(
        sample_times(command.size), command, *(np.zeros(command.size) for _ in range(4))
    )
    settings = _Settings(stiffness, counts, setup.rig.control.current_limit, setup.plant.substeps)
    lone = limbs.parameters[limb : limb + 1]
    _close_loop(lone, limb_records([gains]), command, settings, trace)
    return trace
