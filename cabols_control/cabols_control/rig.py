# SPDX-License-Identifier: Apache-2.0
"""Parameters of a rig for the control laws, read from its configuration files."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from pydantic.dataclasses import dataclass as config_dataclass
from scipy import constants

from cabols_control.checks import FloatArray, finite_array, in_range, one_or_each
from cabols_control.configuration import STRICT, load_config, read_yaml
from cabols_control.errors import CabolsError, ConfigError
from cabols_control.gains import WrenchGains, wrench_gains
from cabols_control.geometry import MIN_CABLES, RigGeometry, load_geometry
from cabols_control.kinematics import cable_lengths
from cabols_control.limb import LimbModel
from cabols_control.limb_springs import LimbSprings, limb_springs
from cabols_control.motion import Motion
from cabols_control.naming import limb_name
from cabols_control.rig_checks import check_limbs
from cabols_control.rig_folder import RigFolder, find_rig, rig_file
from cabols_control.tension import check_method

MOTOR_CURRENT_MAX_A = 3.82
"""Largest current of the source's motors (section 3.5) [A]; no configured limit may exceed it."""
PLANNED_SHARE = 0.97
"""Share of the envelope's limits that a load may use: steps overshoot by 1 to 2 %."""


BACKLASH_MAX_M = 1e-3
"""More is a worn gear, not a play to allow for [m]."""


@config_dataclass(frozen=True, config=STRICT)
class GearConfig:
    """What the gears do with the amplifiers off.

    Attributes:
        self_locking: whether no pull turns a motor through its gear.
        friction_current: least current that overcomes dry friction, one or one for each [A].
        load_current: most current that 1 N of pull takes through the gear, one or one for each
            [A/N].
    """

    self_locking: bool = False
    friction_current: float | list[float] = 0.0
    load_current: float | list[float] = 0.0

    def __post_init__(self) -> None:
        """Check signs, and that a gear that does not lock says what a pull does."""
        for name, most in (("friction_current", 100.0), ("load_current", 10.0)):
            for value in np.ravel(getattr(self, name)):
                in_range(name, float(value), 0.0, most)
        if not self.self_locking and not np.min(self.load_current) > 0.0:
            raise ConfigError(
                "gear: expected self_locking: true, or a load_current above 0 for each limb, got "
                f"{self.load_current}"
            )


@config_dataclass(frozen=True, config=STRICT)
class LimbsConfig:
    """Identified limbs of a rig.

    Attributes:
        stiffness: k_e at the reference pose, one for all limbs or one for each [N/m].
        switch_tension: where a limit switch closes [N].
        gain: k of (3.11), one for each limb [m/s/A].
        time_constant: T of (3.11), one for each limb [s].
        backlash: play between a motor's encoder and its cable that the limb law allows for, at the
            cable [m]; 0: none. Rather too small than too large.
        axial_stiffness: EA of the cables, one for all or one for each [N]: k_e falls as a cable
            grows longer. None: not known, k_e is taken as constant.
        gear: what the gears do with the amplifiers off, which matters where the platform hangs on
            its cables; None: not known.
    """

    stiffness: float | list[float]
    switch_tension: float
    gain: list[float]
    time_constant: list[float]
    backlash: float = 0.0
    axial_stiffness: float | list[float] | None = None
    gear: GearConfig | None = None

    def __post_init__(self) -> None:
        """Check signs and lengths."""
        in_range("switch_tension", self.switch_tension, 0.0, 1000.0)
        in_range("backlash", self.backlash, 0.0, BACKLASH_MAX_M)
        if len(self.gain) != len(self.time_constant):
            raise ConfigError(
                f"time_constant: expected {len(self.gain)} values as in gain, "
                f"got {len(self.time_constant)}"
            )
        for i, (gain, time_constant) in enumerate(zip(self.gain, self.time_constant, strict=True)):
            in_range(f"gain of {limb_name(i)}", gain, 1e-6, 1e3)
            in_range(f"time_constant of {limb_name(i)}", time_constant, 1e-4, 100.0)
        for name, value, least, most in (
            ("stiffness", self.stiffness, 1.0, 1e7),
            ("axial_stiffness", self.axial_stiffness, 100.0, 1e9),
        ):
            if isinstance(value, list):
                if len(value) != len(self.gain):
                    raise ConfigError(
                        f"{name}: expected one number, or {len(self.gain)} as in gain, got "
                        f"{len(value)}"
                    )
                for i, each in enumerate(value):
                    in_range(f"{name} of {limb_name(i)}", each, least, most)
            elif value is not None:
                in_range(name, value, least, most)
        for name in ("friction_current", "load_current"):
            given = None if self.gear is None else getattr(self.gear, name)
            if isinstance(given, list) and len(given) != len(self.gain):
                raise ConfigError(
                    f"gear: {name}: expected one number, or {len(self.gain)} as in gain, got "
                    f"{len(given)}"
                )

    def springs(self, length: FloatArray) -> LimbSprings:
        """k_e of each limb.

        Args:
            length: (n,) of the cables at the reference pose [m].

        Raises:
            ConfigError: if a cable alone would give way more than the whole limb.
        """
        count = len(self.gain)
        axial = self.axial_stiffness
        return limb_springs(
            one_or_each("stiffness", self.stiffness, count),
            None if axial is None else one_or_each("axial_stiffness", axial, count),
            length,
        )

    @property
    def models(self) -> tuple[LimbModel, ...]:
        """Model (3.11) of each limb."""
        return tuple(
            LimbModel(gain, time_constant)
            for gain, time_constant in zip(self.gain, self.time_constant, strict=True)
        )


@config_dataclass(frozen=True, config=STRICT)
class ControlConfig:
    """Design of both loops and their limits; units in rigs/bench/control.yaml."""

    poles: list[float]
    zero: float
    current_limit: float
    tension_min: float
    tension_max: float
    force_rated: list[float]
    torque_rated: list[float]
    pretension_speed: float = 0.02
    command_timeout: float = 0.015
    desired_timeout: float = 0.25
    unload_rate: list[float] | None = None
    unload_tension_rate: float = 300.0
    free_tension: float = 7.0
    free_speed: float = 0.1
    tension_method: str = "min_norm"
    tension_exponent: float = 4.0
    tension_fade: float = 0.5
    preview_bandwidth: float = 5.0
    preview_delay: float = 0.002
    pose_lag: float = 0.0
    pose_horizon: float = 0.04

    def __post_init__(self) -> None:
        """Check limits against each other and against what the hardware bears."""
        in_range("current_limit", self.current_limit, 1e-3, MOTOR_CURRENT_MAX_A)
        in_range("tension_min", self.tension_min, 0.0, 1000.0)
        in_range("tension_max", self.tension_max, self.tension_min + 1e-3, 10000.0)
        in_range("pretension_speed", self.pretension_speed, 1e-4, 1.0)
        in_range("unload_tension_rate", self.unload_tension_rate, 1.0, 1e5)
        in_range("free_tension", self.free_tension, 0.1, self.tension_max)
        in_range("free_speed", self.free_speed, 1e-3, 1.0)
        in_range("tension_fade", self.tension_fade, 1e-3, 60.0)
        in_range("preview_bandwidth", self.preview_bandwidth, 1.0, 50.0)
        in_range("preview_delay", self.preview_delay, 0.0, 0.05)
        in_range("pose_horizon", self.pose_horizon, 0.0, 0.1)
        in_range("pose_lag", self.pose_lag, 0.0, 0.05)
        check_method(MIN_CABLES, self.tension_method, self.tension_exponent)
        in_range("command_timeout", self.command_timeout, 1e-3, 1.0)
        in_range("desired_timeout", self.desired_timeout, 1e-3, 60.0)
        for name, values in (
            ("force_rated", self.force_rated),
            ("torque_rated", self.torque_rated),
        ):
            if len(values) != 3:
                raise ConfigError(f"{name}: expected 3 values, got {len(values)}")
            for value in values:
                in_range(name, value, 1e-6, 1e6)
        rates = self.unload_rates
        if len(rates) != 2:
            raise ConfigError(f"unload_rate: expected [N/s, N m/s], got {rates!r}")
        for rate in rates:
            in_range("unload_rate", rate, 1e-3, 1e6)

    @property
    def unload_rates(self) -> list[float]:
        """Rate of the ramp to zero, [N/s, N m/s]."""
        return self.unload_rate if self.unload_rate is not None else [100.0, 10.0]

    @property
    def rated(self) -> FloatArray:
        """(6,) rated force and torque [N, N m]."""
        return np.array([*self.force_rated, *self.torque_rated])


@dataclass(frozen=True, eq=False)
class EnvelopeLimits:
    """Limits at which the bridge takes over, for those who plan a load; see docs/safety.md.

    Attributes:
        tension_max: of a cable [N].
        wrench_max: (6,) of the sensor, platform axes [N, N m].
    """

    tension_max: float
    wrench_max: FloatArray


@dataclass(frozen=True, eq=False)
class HangingLoad:
    """What hangs on the cables of a rig whose platform nothing else holds.

    Attributes:
        mass: of platform and tool [kg].
        centre: (3,) of mass, platform axes [m].
        proof_pull: at which each gear is proven at a start, on the stand [N].
    """

    mass: float
    centre: FloatArray
    proof_pull: float

    def weight(self, rotation: FloatArray) -> FloatArray:
        """(6,) about the platform's origin, base axes [N, N m].

        Args:
            rotation: (3, 3) from platform to base axes.
        """
        pull = np.array([0.0, 0.0, -constants.g * self.mass])
        return np.concatenate([pull, np.cross(rotation @ self.centre, pull)])


@dataclass(frozen=True, eq=False)
class Rig:
    """Geometry, limbs and control design of one rig; with its safety envelope where it has one.

    `hanging` is None where a robot or a stand holds the platform.
    """

    geometry: RigGeometry
    limbs: LimbsConfig
    control: ControlConfig
    envelope: EnvelopeLimits | None = None
    hanging: HangingLoad | None = None

    def __post_init__(self) -> None:
        """Check that all files describe the same number of cables."""
        if len(self.limbs.gain) != self.geometry.cables:
            raise ConfigError(
                f"limbs: expected {self.geometry.cables} limbs as the geometry has cables, "
                f"got {len(self.limbs.gain)}"
            )
        check_method(self.geometry.cables, self.control.tension_method)

    @cached_property
    def springs(self) -> LimbSprings:
        """k_e of each limb."""
        shape = self.geometry
        return self.limbs.springs(
            cable_lengths(shape, shape.reference_position, shape.reference_rotation)
        )

    @property
    def holding_tension(self) -> float:
        """Tension of a pre-tightened or unloaded limb: safely above its switch's [N]."""
        return 1.3 * self.limbs.switch_tension

    @property
    def plannable(self) -> EnvelopeLimits:
        """What a load may ask for, so that neither overshoot nor noise meets the envelope."""
        tension, wrench = self.control.tension_max, self.control.rated
        if self.hanging is not None:
            tension = min(tension, self.hanging.proof_pull)
        if self.envelope is not None:
            tension = min(tension, PLANNED_SHARE * self.envelope.tension_max)
            wrench = np.minimum(wrench, PLANNED_SHARE * self.envelope.wrench_max)
        return EnvelopeLimits(tension, wrench)

    def borne(self, rotation: FloatArray) -> FloatArray:
        """(6,) that cables exert beyond what is asked of them, base axes [N, N m]: the weight.

        Args:
            rotation: (3, 3) from platform to base axes.
        """
        return np.zeros(6) if self.hanging is None else -self.hanging.weight(rotation)

    @cached_property
    def gains(self) -> WrenchGains:
        """Gains of both loops by (3.24), (3.25)."""
        return wrench_gains(
            self.limbs.models, self.springs.nominal, self.control.poles, self.control.zero
        )


def _envelope(folder: RigFolder) -> EnvelopeLimits | None:
    """Read from safety.yaml what a load must respect; its other keys are the bridge's."""
    if not folder.has("safety.yaml"):
        return None
    content = read_yaml(folder.file("safety.yaml"))
    tension, wrench = content.get("tension_max", 145.0), content.get("wrench_max", [])
    try:
        return EnvelopeLimits(
            in_range("tension_max", tension, 1e-3, 1e6),
            finite_array("wrench_max", wrench, (6,)),
        )
    except (CabolsError, TypeError, ValueError) as error:
        raise ConfigError(f"{folder.file('safety.yaml')}: {error}") from error


def _hanging(folder: RigFolder) -> HangingLoad | None:
    """Read from safety.yaml and frames.yaml what hangs on the cables alone."""
    if not folder.has("safety.yaml"):
        return None
    content = read_yaml(folder.file("safety.yaml"))
    declared = content.get("suspension")
    if content.get("platform_held", True) or not isinstance(declared, dict):
        return None
    tool = read_yaml(folder.file("frames.yaml"))
    try:
        return HangingLoad(
            in_range("tool_mass", tool.get("tool_mass", 0.0), 1e-3, 1e6),
            finite_array("tool_centre_of_mass", tool.get("tool_centre_of_mass", [0.0] * 3), (3,)),
            in_range("proof_pull", declared.get("proof_pull", np.nan), 1e-3, 1e6),
        )
    except (CabolsError, TypeError, ValueError) as error:
        raise ConfigError(
            f"{folder.path}: of a platform that hangs on its cables (frames.yaml, suspension of "
            f"safety.yaml): {error}"
        ) from error


def load_rig(
    rig: str | Path | RigFolder = "",
    geometry: str | Path | None = None,
    limbs: str | Path | None = None,
    control: str | Path | None = None,
) -> Rig:
    """Read a rig's parameters for the control laws.

    Args:
        rig: name or folder, see find_rig; empty: the reference bench.
        geometry: YAML in place of the folder's geometry.yaml; None or empty: the folder's.
        limbs: likewise, of limbs.yaml.
        control: likewise, of control.yaml.

    Raises:
        ConfigError: naming the file, the key, what was expected and what came.
    """
    folder = find_rig(rig)
    shape = load_geometry(rig_file("geometry.yaml", geometry, folder))
    if shape.motion is not Motion.SPATIAL:
        raise ConfigError(
            f"{rig_file('geometry.yaml', geometry, folder)}: expected a platform that moves in "
            f"space, which alone can be controlled, got the motion {shape.motion.value}; "
            "`workspace map --geometry FILE` analyses it"
        )
    found = Rig(
        shape,
        load_config(LimbsConfig, rig_file("limbs.yaml", limbs, folder)),
        load_config(ControlConfig, rig_file("control.yaml", control, folder)),
        _envelope(folder),
        _hanging(folder),
    )
    control_design = found.control
    check_limbs(
        found.springs.nominal,
        found.limbs.gain,
        cable_lengths(shape, shape.reference_position, shape.reference_rotation),
        control_design.tension_max,
        control_design.current_limit,
    ).settle(folder.path)
    return found
