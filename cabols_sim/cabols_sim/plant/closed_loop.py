# SPDX-License-Identifier: Apache-2.0
"""The whole closed loop in one process, compiled: the same laws and physics as the nodes run.

It starts where pre-tightening ends and does what bridge, limb controller and wrench controller do
with each sample, without messages between them. Used for reproductions, design and Monte Carlo.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from cabols_control.checks import FloatArray, IntArray, finite_array
from cabols_control.compiling import njit
from cabols_control.geometry import RigGeometry
from cabols_control.kinematics import cable_lengths, structure_matrix
from cabols_control.limb_control.law import advance_law
from cabols_control.limb_control.records import limb_records
from cabols_control.limb_control.references import follow_backlash
from cabols_control.rig import Rig
from cabols_control.tension import DEFAULT_WEIGHTS, prepare_pose, set_method, work_size
from cabols_control.tension.kernels.work_array import SHARE
from cabols_control.wrench_control.law import wrench_law_into, wrench_law_work
from cabols_hw.bridge.scaling import quantise, wrench_into
from cabols_hw.card.config import CardConfig
from cabols_sim.dynamics.vibration import VibrationModel
from cabols_sim.plant.config import PlantConfig
from cabols_sim.plant.limb_physics import LIMB_STATE, cable_wrench, limb_step
from cabols_sim.plant.vibrating_platform import (
    Platform,
    make_platform,
    move_platform,
    subtract_inertia,
)

PERIOD_S = 0.001


@dataclass(frozen=True, eq=False)
class Trace:
    """Record of k samples.

    Attributes:
        time: (k,) [s].
        desired: (k, 6) [N, N m].
        wrench: (k, 6) true at the sensor, base axes at the platform's origin [N, N m].
        measured: (k, 6) by the force/torque sensor [N, N m].
        tension: (k, n) true [N].
        tension_estimate: (k, n) as the limb law sees it [N].
        tension_command: (k, n) [N].
        current: (k, n) [A].
        status: (k,) of redundancy resolution, 0 feasible.
    """

    time: FloatArray
    desired: FloatArray
    wrench: FloatArray
    measured: FloatArray
    tension: FloatArray
    tension_estimate: FloatArray
    tension_command: FloatArray
    current: FloatArray
    status: IntArray


@dataclass(frozen=True, eq=False)
class Mismatch:
    """What is not as the rig's files say, beside the plant's parameters.

    Attributes:
        geometry: true attachment points.
        sensor: (6, 6) what the sensor makes of a true wrench: gains on the diagonal, cross-talk off
            it; identity for an exact sensor.
    """

    geometry: RigGeometry
    sensor: FloatArray


class _Limbs(NamedTuple):
    matrix: FloatArray
    parameters: Any
    state: Any
    rest: FloatArray
    length: FloatArray
    tension: FloatArray
    substeps: int


class _Sensors(NamedTuple):
    calibration: FloatArray
    gauges: FloatArray
    bias: FloatArray
    noise: FloatArray
    counts_per_metre: float
    adc_step: float
    dac_step: float
    amperes_per_volt: float


class _Control(NamedTuple):
    matrix: FloatArray
    work: FloatArray
    law: Any
    limbs: Any
    stiffness: FloatArray
    zero: FloatArray
    current_limit: float
    fade: float


class _Record(NamedTuple):
    wrench: FloatArray
    measured: FloatArray
    tension: FloatArray
    estimate: FloatArray
    command: FloatArray
    current: FloatArray
    status: IntArray


@njit(cache=True)
def _run(
    limbs: _Limbs,
    sensors: _Sensors,
    control: _Control,
    platform: Platform,
    desired: FloatArray,
    record: _Record,
) -> None:
    n = limbs.parameters.shape[0]
    true, measured = np.zeros(6), np.zeros(6)
    volts, tared = np.zeros(6), np.zeros(6)
    law, elongation, current = control.law[0], np.zeros(n), np.zeros(n)
    accumulated, command = law["accumulated"][:], law["tension"][:]
    first, change, swing, at_rest = np.zeros(6), np.zeros(6), np.zeros(12), limbs.length.copy()
    cable_wrench(limbs.matrix, limbs.tension, first)
    dt_s = PERIOD_S / limbs.substeps
    for k in range(desired.shape[0]):
        # The bridge: encoders to elongation, gauges to wrench.
        for i in range(n):
            counts = limbs.state[i]["motor_position"] * sensors.counts_per_metre
            if sensors.adc_step > 0.0:
                counts = np.floor(counts)
            elongation[i] = counts / sensors.counts_per_metre - control.zero[i]
        cable_wrench(limbs.matrix, limbs.tension, true)
        if platform.active:
            change[:] = true - first
            subtract_inertia(platform, change, swing, true)
        for row in range(6):
            volt = sensors.bias[row] + sensors.noise[k, row]
            for column in range(6):
                volt += sensors.gauges[row, column] * true[column]
            volts[row] = quantise(volt, sensors.adc_step, 10.0)
        wrench_into(sensors.calibration, volts, sensors.bias, 10.0, measured)
        if k == 0:
            for i in range(n):
                control.limbs[i]["last_position"] = elongation[i]
            for row in range(6):
                tared[row] = measured[row] - law["proportional"] * (desired[0, row] - measured[row])
            accumulated[:] = tared
        # The controllers.
        control.work[SHARE] = min((k + 1) * PERIOD_S / control.fade, 1.0)
        record.status[k] = wrench_law_into(
            control.law, desired[k], measured, PERIOD_S, control.work
        )
        for i in range(n):
            limb = control.limbs[i]
            elongation[i] += follow_backlash(limb, elongation[i])
            estimate = control.stiffness[i] * elongation[i]
            record.estimate[k, i] = estimate
            limb["reference"] = limb["tension_gain"] * (command[i] - estimate)
            limb["position"] = elongation[i]
        advance_law(control.limbs, PERIOD_S, control.current_limit)
        for i in range(n):
            current[i] = control.limbs[i]["law_current"]
        record.wrench[k], record.measured[k] = true, measured
        record.tension[k], record.command[k], record.current[k] = limbs.tension, command, current
        # Amplifiers and limbs until the next sample.
        for i in range(n):
            volt = quantise(current[i] / sensors.amperes_per_volt, sensors.dac_step, 10.0)
            current[i] = volt * sensors.amperes_per_volt
        for _ in range(limbs.substeps):
            limb_step(
                limbs.parameters,
                limbs.state,
                current,
                limbs.rest,
                limbs.length,
                dt_s,
                limbs.tension,
            )
            if platform.active:
                cable_wrench(limbs.matrix, limbs.tension, change)
                change -= first
                move_platform(platform, change, limbs.matrix, at_rest, swing, limbs.length)


def simulate(
    rig: Rig,
    card: CardConfig,
    plant: PlantConfig,
    desired: FloatArray,
    seed: int = 0,
    start_tension: float = 6.0,
    vibration: VibrationModel | None = None,
    mismatch: Mismatch | None = None,
) -> Trace:
    """Run the closed loop at the reference pose.

    Args:
        rig: geometry, limbs as identified, control design.
        card: scaling of the card.
        plant: true physics.
        desired: (k, 6) wrench on the platform at its origin, base axes, one row per millisecond.
        seed: of the sensor's noise and bias.
        start_tension: of every limb at the first sample [N].
        vibration: platform and target as a vibrating body; None: a rigid target.
        mismatch: what the rig believes wrongly; None: nothing but the plant's own parameters.

    Returns:
        What happened.
    """
    wanted = finite_array("desired", desired, (None, 6))
    samples, n = wanted.shape[0], rig.geometry.cables
    pose = (rig.geometry.reference_position, rig.geometry.reference_rotation)
    record = _Record(
        wrench=np.zeros((samples, 6)),
        measured=np.zeros((samples, 6)),
        tension=np.zeros((samples, n)),
        estimate=np.zeros((samples, n)),
        command=np.zeros((samples, n)),
        current=np.zeros((samples, n)),
        status=np.zeros(samples, dtype=np.int64),
    )
    wrong = mismatch or Mismatch(plant.geometry(rig.geometry), np.eye(6))
    limbs = _limbs_at(rig, plant, start_tension, structure_matrix(wrong.geometry, *pose))
    zero = limbs.state["motor_position"] - start_tension / rig.springs.nominal
    control = _control(rig, structure_matrix(rig.geometry, *pose), zero)
    platform = make_platform(vibration, PERIOD_S / plant.substeps)
    sensors = _sensors(card, plant, samples, seed, wrong.sensor)
    _run(limbs, sensors, control, platform, wanted, record)
    return Trace(np.arange(samples, dtype=np.float64) * PERIOD_S, wanted, *record)


def _limbs_at(rig: Rig, plant: PlantConfig, tension: float, matrix: FloatArray) -> _Limbs:
    """Limbs at rest with a tension; (6, n) true structure matrix."""
    pose = (rig.geometry.reference_position, rig.geometry.reference_rotation)
    length = cable_lengths(rig.geometry, *pose)
    parameters, state = plant.limbs.parameters, np.zeros(length.size, LIMB_STATE)
    fixed, per_metre = (parameters[f"cable_compliance_{kind}"] for kind in ("fixed", "per_metre"))
    beyond = np.maximum(tension - parameters["spring_initial_tension"], 0.0)
    stretch = tension * (fixed + per_metre * length) + beyond * parameters["spring_compliance"]
    # In pre-tightening the motor winds in, so it stands half the backlash ahead of the pulley.
    state["motor_position"] = 0.5 * parameters["backlash"]
    return _Limbs(
        matrix=matrix,
        parameters=parameters,
        state=state,
        rest=length - stretch,
        length=length,
        tension=np.full(length.size, tension),
        substeps=plant.substeps,
    )


def _sensors(
    card: CardConfig, plant: PlantConfig, samples: int, seed: int, error: FloatArray
) -> _Sensors:
    random = np.random.default_rng(seed)
    config = plant.sensors
    noise = config.gauge_noise * random.standard_normal((samples, 6))
    bias = random.uniform(-config.gauge_bias, config.gauge_bias, 6)
    return _Sensors(
        card.platform_matrix,
        np.asarray(np.linalg.solve(card.platform_matrix, error), dtype=np.float64),
        bias,
        noise,
        card.counts_per_metre,
        config.adc_step,
        config.dac_step,
        card.amperes_per_volt,
    )


def _control(rig: Rig, matrix: FloatArray, zero: FloatArray) -> _Control:
    n = rig.geometry.cables
    work = np.zeros(work_size(n))
    limits = (np.full(n, rig.control.tension_min), np.full(n, rig.control.tension_max))
    prepare_pose(matrix, *limits, np.array(DEFAULT_WEIGHTS), work)
    set_method(work, n, rig.control.tension_method, rig.control.tension_exponent, share=0.0)
    limbs = limb_records(rig.gains.limbs)
    limbs["backlash"] = rig.limbs.backlash
    return _Control(
        matrix,
        work,
        wrench_law_work(rig.gains.proportional, rig.gains.integral, n),
        limbs,
        rig.springs.nominal,
        zero,
        rig.control.current_limit,
        rig.control.tension_fade,
    )
