"""What the reproductions share: the bench's configuration, the form of a result, the lone limb."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from numba import njit

from cabols_control.checks import FloatArray
from cabols_control.gains import LimbGains
from cabols_control.limb_control.law import advance_law
from cabols_control.limb_control.records import limb_records
from cabols_control.rig import Rig, load_rig
from cabols_control.rig_folder import BENCH
from cabols_hw.card.config import CardConfig, load_card
from cabols_sim.plant.config import LimbPlantConfig, PlantConfig, load_plant
from cabols_sim.plant.limb_physics import limb_step

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


@dataclass(frozen=True, eq=False)
class LimbTrace:
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


@njit(cache=True)
def _drive(
    table: FloatArray, current: FloatArray, rest: float, counts: float, substeps: int
) -> FloatArray:
    """Wound length by the encoder for given currents; rest > length: a slack cable."""
    state, tension = np.zeros((1, 3)), np.zeros(1)
    length, wound = np.full(1, CABLE_LENGTH_M), np.zeros(current.size)
    ends = np.full(1, rest)
    dt_s = PERIOD_S / substeps
    for k in range(current.size):
        wound[k] = np.floor(state[0, 0] * counts) / counts if counts > 0.0 else state[0, 0]
        for _ in range(substeps):
            limb_step(table, state, current[k : k + 1], ends, length, dt_s, tension)
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
    row = limbs.table[limb : limb + 1]
    return np.asarray(_drive(row, current, 1e3, counts_per_metre, substeps))


@njit(cache=True)
def _close_loop(
    table: FloatArray,
    limbs: Any,
    command: FloatArray,
    settings: FloatArray,
    substeps: int,
    record: FloatArray,
) -> None:
    stiffness, counts, limit = settings[0], settings[1], settings[2]
    row = table[0]
    state, limb = np.zeros((1, 3)), limbs[0]
    length, tension = np.full(1, CABLE_LENGTH_M), np.full(1, command[0])
    current = np.zeros(1)
    stretch = command[0] * (row[8] + row[9] * length[0])
    stretch += max(command[0] - row[7], 0.0) * row[6]
    # The motor has wound in: it stands half the backlash ahead of the pulley.
    state[0, 0] = 0.5 * row[5]
    zero = state[0, 0] - command[0] / stiffness
    rest = length - stretch
    dt_s = PERIOD_S / substeps
    for k in range(command.size):
        wound = np.floor(state[0, 0] * counts) / counts if counts > 0.0 else state[0, 0]
        limb["position"] = wound - zero
        if k == 0:
            limb["last_position"] = limb["position"]
        estimate = stiffness * limb["position"]
        limb["reference"] = limb["tension_gain"] * (command[k] - estimate)
        advance_law(limbs, PERIOD_S, limit)
        current[0] = limb["law_current"]
        record[0, k], record[1, k] = tension[0], estimate
        record[2, k], record[3, k] = wound, current[0]
        for _ in range(substeps):
            limb_step(table, state, current, rest, length, dt_s, tension)


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
    record = np.zeros((4, command.size))
    _close_loop(
        limbs.table[limb : limb + 1],
        limb_records([gains]),
        command,
        np.array([stiffness, counts, setup.rig.control.current_limit]),
        setup.plant.substeps,
        record,
    )
    return LimbTrace(sample_times(command.size), command, *record)
