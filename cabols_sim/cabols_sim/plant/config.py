# SPDX-License-Identifier: Apache-2.0
"""Parameters of the simulated rig."""

from __future__ import annotations

from dataclasses import field, replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic.dataclasses import dataclass

from cabols_control.checks import finite_array, in_range, one_or_each
from cabols_control.configuration import STRICT, beside, load_config
from cabols_control.errors import ConfigError
from cabols_control.frames import load_frames
from cabols_control.geometry import RigGeometry, load_geometry
from cabols_control.kinematics import cable_lengths
from cabols_control.rig import LimbsConfig
from cabols_control.rig_folder import RigFolder, find_rig
from cabols_hw.force_torque.ati import STANDARD_GRAVITY
from cabols_sim.plant.limb_physics import LIMB_PARAMETERS


@dataclass(frozen=True, config=STRICT)
class LimbPlantConfig:
    """True physics of the limbs, the same for all but gain and time constant.

    Attributes:
        gain: k of (3.11), one for each limb [m/s/A].
        time_constant: T of (3.11), one for each limb [s].
        coulomb_current: current that overcomes dry friction [A].
        viscous_current: current per speed beyond what k already contains [A s/m].
        load_current: current that holds 1 N of cable tension through the gear [A/N].
        backlash: gear backlash, at the cable [m].
        spring_stiffness: one for all limbs or one for each [N/m]; 0 stands for a limb without a
            spring.
        spring_initial_tension: below it the spring's coils touch [N].
        spring_end_tension: at which the spring ends; beyond it only the cable stretches [N]. 0: it
            never ends.
        break_tension: at which a cable parts [N]; 0: it never does.
        self_locking: whether the gear lets no pull turn the motor.
        cable_compliance_fixed: of knots and pulley mounts [m/N].
        cable_compliance_per_metre: of the cable itself, one for all or one for each [1/N].
        initial_slack: of every cable at power-up [m].
        slack_spread: uniformly drawn addition to it [m].
    """

    gain: list[float]
    time_constant: list[float]
    coulomb_current: float = 0.03
    viscous_current: float = 0.02
    load_current: float = 0.0002
    backlash: float = 0.0002
    spring_stiffness: float | list[float] = 2768.0
    spring_initial_tension: float = 0.5
    spring_end_tension: float = 0.0
    break_tension: float = 0.0
    self_locking: bool = False
    cable_compliance_fixed: float = 0.0
    cable_compliance_per_metre: float | list[float] = 6.55e-5
    initial_slack: float = 0.004
    slack_spread: float = 0.003

    def __post_init__(self) -> None:
        """Check signs and lengths."""
        if len(self.gain) != len(self.time_constant):
            raise ConfigError(
                f"time_constant: expected {len(self.gain)} values as in gain, "
                f"got {len(self.time_constant)}"
            )
        for name in ("gain", "time_constant"):
            for value in getattr(self, name):
                in_range(name, value, 1e-6, 1e3)
        for name in (
            "coulomb_current",
            "viscous_current",
            "load_current",
            "backlash",
            "spring_stiffness",
            "spring_initial_tension",
            "spring_end_tension",
            "break_tension",
            "cable_compliance_fixed",
            "cable_compliance_per_metre",
            "initial_slack",
            "slack_spread",
        ):
            for value in one_or_each(name, getattr(self, name), len(self.gain)):
                in_range(name, float(value), 0.0, 1e7)
        for value in one_or_each("", self.cable_compliance_per_metre, len(self.gain)):
            in_range(
                "cable_compliance_fixed + cable_compliance_per_metre",
                self.cable_compliance_fixed + float(value),
                1e-9,
                1.0,
            )

    def require_limbs(self, cables: int) -> None:
        """Refuse parameters of another number of limbs than a rig has cables.

        Raises:
            ConfigError: if the numbers differ.
        """
        if len(self.gain) != cables:
            raise ConfigError(
                f"plant: limbs.gain: expected {cables} values as the geometry has cables, got "
                f"{len(self.gain)}; leave gain and time_constant out to take those of limbs.yaml"
            )

    @property
    def parameters(self) -> Any:
        """(n,) records of LIMB_PARAMETERS for the compiled physics."""
        records = np.zeros(len(self.gain), LIMB_PARAMETERS)
        for name in (
            "gain",
            "time_constant",
            "coulomb_current",
            "viscous_current",
            "load_current",
            "backlash",
            "cable_compliance_fixed",
            "cable_compliance_per_metre",
        ):
            records[name] = getattr(self, name)
        springs = one_or_each("spring_stiffness", self.spring_stiffness, len(self.gain))
        fitted = springs > 0.0
        records["spring_compliance"][fitted] = 1.0 / springs[fitted]
        records["spring_initial_tension"][fitted] = self.spring_initial_tension
        records["spring_end_tension"] = self.spring_end_tension or np.inf
        records["self_locking"] = self.self_locking
        return records


@dataclass(frozen=True, config=STRICT)
class SensorPlantConfig:
    """True behaviour of converters, sensor and switches.

    Attributes:
        encoder_quantised: whether counts are whole.
        adc_step: of the card's inputs [V]; 0 for ideal ones.
        dac_step: of the card's outputs [V]; 0 for ideal ones.
        gauge_noise: standard deviation of each gauge [V].
        gauge_bias: bound of each gauge's uniformly drawn bias [V].
        tool_weight: of platform and tool on the sensor, along -z of the base [N].
        tool_centre_of_mass: (3,) where it pulls, from the platform's origin, platform axes [m].
        switch_tension: where a limit switch closes [N].
        switch_hysteresis: it opens below switch_tension by this [N].
    """

    encoder_quantised: bool = True
    adc_step: float = 20.0 / 2**14
    dac_step: float = 20.0 / 2**12
    gauge_noise: float = 0.001
    gauge_bias: float = 0.2
    tool_weight: float = 20.0
    tool_centre_of_mass: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    switch_tension: float = 4.7
    switch_hysteresis: float = 0.3

    def __post_init__(self) -> None:
        """Check signs."""
        for name in (
            "adc_step",
            "dac_step",
            "gauge_noise",
            "gauge_bias",
            "tool_weight",
            "switch_tension",
            "switch_hysteresis",
        ):
            in_range(name, getattr(self, name), 0.0, 1e4)
        finite_array("tool_centre_of_mass", self.tool_centre_of_mass, (3,))


@dataclass(frozen=True, config=STRICT)
class PlantConfig:
    """The simulated rig.

    Attributes:
        limbs: physics of the limbs.
        sensors: converters, force/torque sensor, switches.
        substeps: integration steps in a millisecond.
        geometry_file: YAML of the true attachment points and pulleys, beside this file; empty:
            those that control believes in.
    """

    limbs: LimbPlantConfig
    sensors: SensorPlantConfig
    substeps: int = 4
    geometry_file: str = ""

    def __post_init__(self) -> None:
        """Check ranges; read the true geometry."""
        in_range("substeps", self.substeps, 1, 100)
        if self.geometry_file:
            path = beside(self.geometry_file).resolve()
            object.__setattr__(self, "geometry_file", str(path))
            self.__dict__["_geometry"] = load_geometry(path)

    def geometry(self, believed: RigGeometry) -> RigGeometry:
        """Return the true geometry.

        Args:
            believed: of the rig's folder, which holds where no other is given.

        Raises:
            ConfigError: if the true one has another number of cables.
        """
        true: RigGeometry = self.__dict__.get("_geometry", believed)
        if true.cables != believed.cables:
            raise ConfigError(
                f"{self.geometry_file}: expected {believed.cables} cables as control has, got "
                f"{true.cables}"
            )
        return true

    def linear(self) -> PlantConfig:
        """Return the linear plant (3.12) with the same motors.

        No friction, load, backlash, converter steps or noise; the spring never closes, the cable's
        compliance does not depend on its length (10.72 N/mm, so that k_e is 2.20 N/mm).
        """
        limbs = replace(
            self.limbs,
            coulomb_current=0.0,
            viscous_current=0.0,
            load_current=0.0,
            backlash=0.0,
            spring_stiffness=1.0 / (1.0 / 2200.0 - 1.0 / 10720.0),
            spring_initial_tension=0.0,
            cable_compliance_fixed=1.0 / 10720.0,
            cable_compliance_per_metre=0.0,
        )
        sensors = replace(
            self.sensors,
            encoder_quantised=False,
            adc_step=0.0,
            dac_step=0.0,
            gauge_noise=0.0,
        )
        return replace(self, limbs=limbs, sensors=sensors)

    def without_springs(self) -> PlantConfig:
        """Return the same rig with the springs taken out (figure 3.8)."""
        return replace(self, limbs=replace(self.limbs, spring_stiffness=0.0))


def _springs(limbs: LimbsConfig, geometry: RigGeometry) -> dict[str, list[float]]:
    """Springs and cables that have the k_e of limbs.yaml at the reference pose."""
    pose = geometry.reference_position, geometry.reference_rotation
    length = cable_lengths(geometry, *pose)
    springs = limbs.springs(length)
    per_metre = springs.per_metre
    if limbs.axial_stiffness is None:
        usual = LimbPlantConfig(limbs.gain, limbs.time_constant).cable_compliance_per_metre
        per_metre = np.minimum(np.asarray(usual), 0.5 / (springs.nominal * length))
    spring = 1.0 / np.maximum(1.0 / springs.nominal - per_metre * length, 1e-9)
    return {"spring_stiffness": spring.tolist(), "cable_compliance_per_metre": per_metre.tolist()}


def load_plant(rig: str | Path | RigFolder = "", path: str | Path | None = None) -> PlantConfig:
    """Read the physics of a simulated rig.

    Motors, switches and tool are as the rig's limbs.yaml and frames.yaml say, unless the file gives
    other, true numbers. So are springs and cables where limbs.yaml tells them apart: a k_e of each
    limb, or the cables' axial stiffness.

    Args:
        rig: name or folder, see find_rig; empty: the reference bench.
        path: YAML in place of the folder's plant.yaml; None or empty: the folder's.

    Raises:
        ConfigError: naming the file, the key, what was expected and what came.
    """
    folder = find_rig(rig)
    limbs, frames = load_config(LimbsConfig, folder.file("limbs.yaml")), load_frames(folder)
    defaults: dict[str, dict[str, Any]] = {
        "limbs": {"gain": limbs.gain, "time_constant": limbs.time_constant},
        "sensors": {
            "tool_weight": STANDARD_GRAVITY * frames.tool_mass,
            "tool_centre_of_mass": frames.tool_centre_of_mass,
            "switch_tension": limbs.switch_tension,
        },
    }
    if isinstance(limbs.stiffness, list) or limbs.axial_stiffness is not None:
        defaults["limbs"] |= _springs(limbs, load_geometry(folder.file("geometry.yaml")))
    file = Path(path) if path else folder.optional("plant.yaml")
    if file is None:
        return PlantConfig(**defaults)  # type: ignore[arg-type]
    return load_config(PlantConfig, file, defaults=defaults)
