# SPDX-License-Identifier: Apache-2.0
"""The simulated rig between amplifiers and sensors; pure, advanced by the owner of the clock."""

from __future__ import annotations

from typing import Any

import numpy as np

from cabols_control.cable_kernels import cable_lengths_into, structure_matrix_into
from cabols_control.checks import BoolArray, FloatArray, IntArray
from cabols_control.compiling import njit
from cabols_control.rig import Rig
from cabols_hw.bridge.scaling import quantise
from cabols_hw.card.config import ENCODER_MODULUS, CardConfig
from cabols_hw.force_torque.ati import STANDARD_GRAVITY
from cabols_sim.faults import PlantFaults
from cabols_sim.plant.config import PlantConfig
from cabols_sim.plant.free_platform import FreePlatform
from cabols_sim.plant.limb_physics import LIMB_STATE, advance_limbs, cable_wrench
from cabols_sim.plant.miswiring import Miswiring
from cabols_sim.plant.target import RigidTarget, Target

AMPLIFIER_LIMIT_A = 3.82
PARTED_M = 10.0
"""Length added to a parted cable [m]."""


@njit(cache=True)
def _amplify_into(volts: FloatArray, step: float, gain: float, current: FloatArray) -> None:
    """DAC steps, then the amplifiers' gain and limit."""
    for i in range(current.shape[0]):
        setpoint = quantise(volts[i], step, 10.0) * gain
        current[i] = min(max(setpoint, -AMPLIFIER_LIMIT_A), AMPLIFIER_LIMIT_A)


SENSORS = np.dtype(
    [
        ("counts_per_metre", np.float64),
        ("switch_tension", np.float64),  # where a limit switch closes [N]
        ("switch_hysteresis", np.float64),  # tension below switch_tension at which it opens [N]
        ("switch_active_low", np.int64),  # whether a closed switch pulls its line low
        ("weight", np.float64, (3,)),  # of platform and tool, base axes [N]
        ("centre", np.float64, (3,)),  # where it pulls, platform axes [m]
        ("gauges", np.float64, (6, 6)),  # from wrench to gauge voltages [V/N, V/(N m)]
        ("bias", np.float64, (6,)),  # of the gauges [V]
        ("gauge_noise", np.float64),  # standard deviation [V]
        ("adc_step", np.float64),  # [V]
    ],
    align=True,
)
"""True behaviour of encoders, limit switches and force/torque sensor."""


@njit(cache=True)
def _sense_limbs(
    sensors: Any,
    state: Any,
    tension: FloatArray,
    closed: BoolArray,
    counts: IntArray,
    lines: BoolArray,
) -> None:
    """Encoder counts (n,) and levels of the switches' lines (n,) of the present state."""
    own, half = sensors[0], ENCODER_MODULUS // 2
    for i in range(tension.shape[0]):
        whole = int(np.floor(state[i]["motor_position"] * own["counts_per_metre"]))
        counts[i] = (whole + half) % ENCODER_MODULUS - half
        closed[i] = tension[i] >= own["switch_tension"] - (
            own["switch_hysteresis"] if closed[i] else 0.0
        )
        lines[i] = closed[i] != (own["switch_active_low"] != 0)


@njit(cache=True)
def _sense_wrench(
    sensors: Any,
    wrench: FloatArray,
    pose: tuple[FloatArray, FloatArray],
    noise: FloatArray,
    volts: FloatArray,
) -> None:
    """Gauge voltages (6,) of the cables' wrench (6,), base axes, and of the tool.

    Args:
        sensors: (1,) record of SENSORS.
        wrench: (6,) of the cables, base axes [N, N m].
        pose: (3, 3) rotation from platform to base axes; (3,) what the tool's inertia adds to its
            weight, base axes [N].
        noise: (6,) normal numbers.
        volts: (6,), filled [V].
    """
    own = sensors[0]
    rotation, inertia = pose
    weight, centre, gauges, bias = own["weight"], own["centre"], own["gauges"], own["bias"]
    turned, pull = np.zeros(6), np.zeros(3)
    for axis in range(3):
        for k in range(3):
            turned[axis] += rotation[k, axis] * (wrench[k] + weight[k] + inertia[k])
            turned[3 + axis] += rotation[k, axis] * wrench[3 + k]
            pull[axis] += rotation[k, axis] * (weight[k] + inertia[k])
    turned[3] += centre[1] * pull[2] - centre[2] * pull[1]
    turned[4] += centre[2] * pull[0] - centre[0] * pull[2]
    turned[5] += centre[0] * pull[1] - centre[1] * pull[0]
    for row in range(6):
        volt = bias[row] + own["gauge_noise"] * noise[row]
        for k in range(6):
            volt += gauges[row, k] * turned[k]
        volts[row] = quantise(volt, own["adc_step"], 10.0)


def _sensor_record(card: CardConfig, config: PlantConfig) -> Any:
    """Build the (1,) record of SENSORS, without bias."""
    sensors, record = config.sensors, np.zeros(1, SENSORS)
    for name in ("switch_tension", "switch_hysteresis", "gauge_noise", "adc_step"):
        record[name] = getattr(sensors, name)
    record["counts_per_metre"] = card.counts_per_metre
    record["switch_active_low"] = card.switch_active_low
    record["weight"] = [0.0, 0.0, -sensors.tool_weight]
    record["centre"] = sensors.tool_centre_of_mass
    record["gauges"] = np.linalg.inv(card.platform_matrix)
    return record


class Plant:
    """The limbs of n cables, a target, a force/torque sensor and limit switches.

    Attributes:
        tension: (n,) true tensions [N].
        wrench: (6,) true wrench of the cables on the platform, base axes [N, N m].
        target: what holds the platform.
        faults: what is made to go wrong.
        enabled: whether the amplifiers are on.
        wiring: where the card's channels really end; None: where the configuration says.
    """

    def __init__(
        self,
        rig: Rig,
        card: CardConfig,
        config: PlantConfig,
        seed: int = 0,
        target: Target | None = None,
    ) -> None:
        """Start at rest with slack cables.

        Args:
            rig: geometry (and switch positions).
            card: wiring, to turn physics into volts and counts.
            config: true parameters.
            seed: of slack, sensor bias and noise.
            target: what holds the platform; None for a rigid one.
        """
        self._cables = config.geometry(rig.geometry).records()
        self._card = card
        self._config = config
        self._random = np.random.default_rng(seed)
        n = rig.geometry.cables
        config.limbs.require_limbs(n)
        self._parameters = config.limbs.parameters
        self._state = np.zeros(n, LIMB_STATE)
        self._current = np.zeros(n)
        self._motor_current = self._current
        self._length = np.zeros(n)
        self._matrix = np.zeros((6, n))
        self._closed: BoolArray = np.zeros(n, dtype=np.bool_)
        self._sensors = _sensor_record(card, config)
        self.tension = np.zeros(n)
        self.wrench = np.zeros(6)
        self.faults = PlantFaults(n)
        self.enabled = True
        self.wiring: Miswiring | None = None
        self._parted = np.zeros(n, dtype=np.bool_)
        self._slipped = np.zeros(n)
        self._torn = np.zeros(n, dtype=np.bool_)
        self._time = 0.0
        self.target: Target = target if target is not None else RigidTarget(rig.geometry)
        self._twist, self._inertia, self._moving = np.zeros(6), np.zeros(3), False
        self._place()
        slack = config.limbs.initial_slack + config.limbs.slack_spread * self._random.random(n)
        self._rest = self._length + slack
        bias = config.sensors.gauge_bias
        self._bias[:] = self._random.uniform(-bias, bias, 6) if bias > 0.0 else 0.0
        self._noise = np.zeros(6)

    @property
    def _bias(self) -> FloatArray:
        """(6,) bias of the gauges [V]; a view."""
        bias: FloatArray = self._sensors["bias"][0]
        return bias

    @property
    def cable_length(self) -> FloatArray:
        """(n,) from point to point, where the target is [m]; a view."""
        return self._length

    def _place(self) -> None:
        pose = (self.target.position, self.target.rotation)
        cable_lengths_into(self._cables, *pose, self._length)
        structure_matrix_into(self._cables, *pose, self._matrix)

    def drive(self, volts: FloatArray) -> None:
        """Set the (n,) amplifier inputs [V], through the DAC's steps."""
        step, gain = self._config.sensors.dac_step, self._card.amperes_per_volt
        if self.wiring is not None:
            volts = self.wiring.volts(volts)
        _amplify_into(volts, step, gain, self._current)

    def advance(self, duration_s: float) -> None:
        """Advance the time with the present currents."""
        if not duration_s > 0.0:
            return
        self._time += duration_s
        steps = max(1, round(1000.0 * self._config.substeps * duration_s))
        dt_s = duration_s / steps
        ordinary = self.enabled and not self.faults.any
        self._motor_current = self._current if ordinary else self._distorted_current()
        advance_limbs(
            self._parameters,
            self._state,
            self._motor_current,
            self._rest,
            self._length,
            dt_s,
            steps,
            self.tension,
        )
        if 0.0 < self._config.limbs.break_tension < self.tension.max():
            self._tear()
        cable_wrench(self._matrix, self.tension, self.wrench)
        moved = self.target.step(self.wrench, duration_s)
        self._feel_motion(duration_s)
        rigid = isinstance(self.target, RigidTarget)
        if rigid and self.faults.any and self.faults.has("platform_runs"):
            self.target.position[0] += self.faults.value("platform_runs") * duration_s
            moved = True
        if moved:
            self._place()

    def _feel_motion(self, dt_s: float) -> None:
        """Set what the tool's inertia adds to its weight, by the target's motion in a step [s]."""
        twist = getattr(self.target, "twist", None)
        if twist is None or isinstance(self.target, FreePlatform):
            return
        if not (self._moving or twist.any()):
            self._inertia[:] = 0.0
            return
        change = (twist - self._twist) / dt_s
        self._moving, self._twist = bool(twist.any()), twist.copy()
        centre = self.target.rotation @ self._sensors["centre"][0]
        spin = twist[3:]
        mass = -self._sensors["weight"][0, 2] / STANDARD_GRAVITY
        turning = np.cross(change[3:], centre) + np.cross(spin, np.cross(spin, centre))
        self._inertia[:] = -mass * (change[:3] + turning)

    def inject(self, kind: str, limb: int = -1, value: float = 0.0, duration_s: float = 0.0) -> str:
        """Cause a fault from now on, or mend all; see PlantFaults.inject.

        Args:
            kind: name of the fault, or none to mend all.
            limb: from 0; -1: none.
            value: size in the fault's unit; 0: its default.
            duration_s: 0: until mended [s].
        """
        said = self.faults.inject(kind, limb, value, duration_s, self._time)
        self._part(self.faults.limbs_with("cable_break"))
        self._slip()
        return said

    def _tear(self) -> None:
        """Part the cables that are pulled beyond what they bear; none of them is ever spliced."""
        torn = self.tension > self._config.limbs.break_tension
        self._rest[torn & ~self._torn] += PARTED_M
        self._torn |= torn
        self.tension[torn] = 0.0

    def _slip(self) -> None:
        """Let cables that slip on their winches become longer, or mend them."""
        slipped = self.faults.slipped()
        self._rest += slipped - self._slipped
        self._slipped = slipped

    def _part(self, limbs: list[int]) -> None:
        """Part the cables of some limbs; splice the others that had parted."""
        for i in range(self.tension.size):
            if (i in limbs) != self._parted[i]:
                self._rest[i] += PARTED_M if i in limbs else -PARTED_M
                self._parted[i] = i in limbs

    def _distorted_current(self) -> FloatArray:
        self.faults.pass_time(self._time)
        self._part(self.faults.limbs_with("cable_break"))
        self._slip()
        current = self._current.copy()
        self.faults.distort_current(current)
        if not self.enabled:
            current[:] = 0.0
        for i in self.faults.limbs_with("motor_jam"):
            current[i] = self._state["motor_speed"][i] = 0.0
        return current

    def sense(self) -> tuple[IntArray, FloatArray, BoolArray]:
        """Read all sensors once.

        Returns:
            (n,) raw 24-bit counts of the motors, (6,) gauge voltages (calibration, weight, bias,
            noise, ADC steps), (n,) levels of the limit switches' lines.
        """
        card, n = self._card, self.tension.size
        counts, volts = np.empty(n, dtype=np.int64), np.empty(6)
        lines = np.empty(n, dtype=np.bool_)
        self._random.standard_normal(out=self._noise)
        _sense_limbs(self._sensors, self._state, self.tension, self._closed, counts, lines)
        wrench, inertia = self.wrench, self._inertia
        if isinstance(self.target, FreePlatform):
            # No robot is behind the sensor: it feels nothing.
            wrench, inertia = np.zeros(6), -self._sensors["weight"][0]
        pose = (self.target.rotation, inertia)
        _sense_wrench(self._sensors, wrench, pose, self._noise, volts)
        if self.faults.any:
            args = (self._time, card.counts_per_metre, counts, volts, lines)
            self.faults.distort_senses(*args, card.switch_active_low)
        if self.wiring is not None:
            return self.wiring.senses(counts, volts, lines)
        return counts, volts, lines

    @property
    def motor_current(self) -> FloatArray:
        """(n,) currents that the motors really get [A]."""
        return self._motor_current

    @property
    def current(self) -> FloatArray:
        """(n,) currents commanded to the motors [A]."""
        return self._current.copy()
