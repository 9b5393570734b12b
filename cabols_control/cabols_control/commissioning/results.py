# SPDX-License-Identifier: Apache-2.0
"""Models, gains and the limbs' YAML from the records of commissioning programmes."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import ArrayLike

from cabols_control.checks import FloatArray, finite_array, rotation_matrix
from cabols_control.commissioning.programmes import SETTLE_S, CommissioningError
from cabols_control.gains import wrench_gains
from cabols_control.geometry import RigGeometry
from cabols_control.kinematics import structure_matrix
from cabols_control.limb import (
    LimbModel,
    StiffnessFit,
    identify_limb,
    identify_limb_with_friction,
    identify_stiffness,
)
from cabols_control.naming import limb_names, number
from cabols_control.rig import BACKLASH_MAX_M, Rig

TENSION_RANGE_N = (5.0, 145.0)
"""Range of the ramp for the fit [N]: at less tension the spring's coils may touch."""


@dataclass(frozen=True)
class StepResult:
    """Result of a step.

    Attributes:
        model: the model to use: with dry friction taken out, unless that fit is worse.
        friction: current that overcomes dry friction [A].
        plain: (3.11) alone, fitted as the source does; friction makes its gain too small.
    """

    model: LimbModel
    friction: float
    plain: LimbModel


@dataclass(frozen=True, eq=False)
class RampResult:
    """Result of a ramp.

    Attributes:
        line: force/elongation line.
        fit: 1 - |y - y_hat| / |y - mean(y)| of the tension within the fitted range.
        tension: (k,) by the force/torque sensor [N].
        elongation: (k,) [m].
    """

    line: StiffnessFit
    fit: float
    tension: FloatArray
    elongation: FloatArray


def evaluate_step(record: Mapping[str, FloatArray]) -> StepResult:
    """Identify a limb from a StepProgramme's record.

    Raises:
        ShapeError: if the record has no step or no motion.
    """
    data = (record["time"], record["current"], record["wound_length"])
    plain = identify_limb(*data)
    aware = identify_limb_with_friction(*data)
    sound = aware.friction > 0.0 and aware.model.gain > 0.0 and aware.model.fit >= plain.fit
    return StepResult(aware.model if sound else plain, aware.friction if sound else 0.0, plain)


def cable_tension_by_wrench(
    matrix: ArrayLike, limb: int, wrench: ArrayLike, rated: ArrayLike
) -> FloatArray:
    """Least-squares tension of one cable that explains wrenches, the others' shares taken off.

    Args:
        matrix: (6, n) structure matrix.
        limb: index of the cable.
        wrench: (k, 6) on the platform, base axes [N, N m].
        rated: (6,) of the sensor, makes forces and torques comparable [N, N m].

    Returns:
        (k,) [N].

    Raises:
        ShapeError: on other shapes or non-finite data.
    """
    scale = 1.0 / finite_array("rated", rated, (6,))
    column = finite_array("matrix", matrix, (6, None))[:, limb] * scale
    scaled = finite_array("wrench", wrench, (None, 6)) * scale
    return np.asarray(scaled @ column / (column @ column), dtype=np.float64)


def evaluate_ramp(
    record: Mapping[str, FloatArray],
    wrench_time: FloatArray,
    wrench: FloatArray,
    geometry: RigGeometry,
    limb: int,
    position: ArrayLike,
    rotation: ArrayLike,
    rated: FloatArray,
) -> RampResult:
    """Fit k_e to a RampProgramme's record: elongation against the force sensor's tension.

    The wrench at the holding tension is subtracted: it contains the other cables' tensions, which
    stay constant, so that the ramp's share is left. The slope therefore does not depend on the
    assumed stiffness; the line's offset does.

    Args:
        record: of the programme.
        wrench_time: (k,) from the record's start [s].
        wrench: (k, 6) on the platform, platform axes [N, N m].
        geometry: of the rig.
        limb: index from 0.
        position: (3,) of the platform [m].
        rotation: (3, 3) from platform to base axes.
        rated: (6,) of the sensor [N, N m].

    Raises:
        CommissioningError: if the wrench did not arrive throughout.
        ShapeError: if the ramp was not long enough.
    """
    time = record["time"]
    missing = wrench_time.size < 20 or not (
        wrench_time[0] < 0.5 * SETTLE_S and wrench_time[-1] > time[-1] - SETTLE_S
    )
    if missing:
        raise CommissioningError(
            f"wrench: expected samples throughout the ramp of {time[-1]:.1f} s, got "
            f"{wrench_time.size}: does the bridge publish it?"
        )
    turn = rotation_matrix("rotation", rotation)
    turned = np.hstack([wrench[:, :3] @ turn.T, wrench[:, 3:] @ turn.T])
    resting = wrench_time < SETTLE_S
    matrix = structure_matrix(geometry, position, rotation)
    change = cable_tension_by_wrench(matrix, limb, turned - turned[resting].mean(axis=0), rated)
    start = float(record["tension"][time < SETTLE_S].mean())
    tension = start + np.interp(time, wrench_time, change)
    elongation = record["elongation"]
    line = identify_stiffness(tension, elongation, TENSION_RANGE_N)
    used = (tension >= TENSION_RANGE_N[0]) & (tension <= TENSION_RANGE_N[1])
    spread = float(tension[used].std())
    return RampResult(line, 1.0 - line.linearity_rms / spread, tension, elongation)


@dataclass(frozen=True)
class LimbResult:
    """One commissioned limb; NaN for what was not identified.

    Attributes:
        limb: index from 0.
        gain: k [m/s/A].
        time_constant: T [s].
        fit: of the wound length.
        stiffness: k_e [N/m].
        stiffness_fit: of the tension.
        message: further findings.
        backlash: of the gear, at the cable [m].
    """

    limb: int
    gain: float = np.nan
    time_constant: float = np.nan
    fit: float = np.nan
    stiffness: float = np.nan
    stiffness_fit: float = np.nan
    message: str = ""
    backlash: float = np.nan


def commissioned_rig(
    rig: Rig, results: Mapping[int, LimbResult], know_backlash: bool = False
) -> Rig:
    """Return the rig with what was identified in place of what was configured.

    Where the configuration has one k_e for all limbs (thesis section 3.4.1), it is the mean of
    those identified; where it has one for each, each limb gets its own.

    Args:
        rig: as configured.
        results: identified, by the limb's index from 0.
        know_backlash: whether control is to know the gears' play: the least of those identified,
            as more than a gear has rings. The loop's delay is then that of its design alone.
    """
    gain, constant = list(rig.limbs.gain), list(rig.limbs.time_constant)
    for limb, result in results.items():
        if np.isfinite(result.gain) and np.isfinite(result.time_constant):
            gain[limb], constant[limb] = float(result.gain), float(result.time_constant)
    found = {i: float(r.stiffness) for i, r in results.items() if np.isfinite(r.stiffness)}
    stiffness = rig.limbs.stiffness
    if isinstance(stiffness, list):
        stiffness = [found.get(i, before) for i, before in enumerate(stiffness)]
    elif found:
        stiffness = float(np.mean(list(found.values())))
    limbs = replace(rig.limbs, stiffness=stiffness, gain=gain, time_constant=constant)
    plays = [float(r.backlash) for r in results.values() if np.isfinite(r.backlash)]
    if not (know_backlash and plays):
        return Rig(rig.geometry, limbs, rig.control)
    limbs = replace(limbs, backlash=min(*plays, BACKLASH_MAX_M))
    return Rig(rig.geometry, limbs, replace(rig.control, preview_delay=0.0))


def write_results(
    folder: str | Path,
    rig: Rig,
    results: Mapping[int, LimbResult],
    know_backlash: bool = False,
    control_text: str = "",
) -> list[Path]:
    """Write limbs.yaml (loads with load_rig), gains.yaml and table.txt.

    Where control is to know the gears' play, control.yaml is written, too, if its text is given.

    Args:
        folder: made if it is missing.
        rig: as configured; its values stay for limbs that were not commissioned.
        results: by limb.
        know_backlash: whether limbs.yaml tells the gears' play, too.
        control_text: of the rig's control.yaml; all but its preview_delay stays as it is.

    Returns:
        The paths.
    """
    target = Path(folder)
    target.mkdir(parents=True, exist_ok=True)
    new = commissioned_rig(rig, results, know_backlash)
    texts = {
        "limbs.yaml": _limbs_text(new, results),
        "gains.yaml": _gains_text(new),
        "table.txt": table(rig, results) + "\n",
    }
    if control_text and new.control.preview_delay != rig.control.preview_delay:
        texts["control.yaml"] = _with_delay(control_text, new.control.preview_delay)
    for name, text in texts.items():
        (target / name).write_text(text, encoding="utf-8")
    return [target / name for name in texts]


def _limbs_text(rig: Rig, results: Mapping[int, LimbResult]) -> str:
    limbs = rig.limbs
    left = [i for i in range(len(limbs.gain)) if i not in results]
    note = f"# As configured, not commissioned: {limb_names(left)}.\n" if left else ""
    values: dict[str, Any] = {
        "stiffness": _rounded(limbs.stiffness),
        "switch_tension": limbs.switch_tension,
        "gain": [round(value, 8) for value in limbs.gain],
        "time_constant": [round(value, 8) for value in limbs.time_constant],
    }
    if limbs.backlash > 0.0:
        values["backlash"] = round(limbs.backlash, 6)
    if limbs.axial_stiffness is not None:
        values["axial_stiffness"] = limbs.axial_stiffness
    if limbs.gear is not None:
        values["gear"] = asdict(limbs.gear)
    head = "# Limbs by commissioning, limb 1 first: N/m, N, m/s/A, s.\n"
    return head + note + yaml.safe_dump(values, sort_keys=False, default_flow_style=None)


def _with_delay(text: str, delay: float) -> str:
    """Return the text of a control.yaml with another preview_delay [s], comments kept."""
    line = f"preview_delay: {delay}"
    changed, count = re.subn(r"^preview_delay:[^#\n]*?(?=[ \t]*(#|$))", line, text, flags=re.M)
    return changed if count else f"{text.rstrip()}\n{line}\n"


def _rounded(value: float | list[float]) -> float | list[float]:
    """Hundredths of one number or of each."""
    return [round(each, 2) for each in value] if isinstance(value, list) else round(value, 2)


def _gains_text(rig: Rig) -> str:
    control = rig.control
    gains = wrench_gains(rig.limbs.models, rig.springs.nominal, control.poles, control.zero)
    values: dict[str, Any] = {
        "k_I": [round(float(g.integral), 4) for g in gains.limbs],
        "k_P1": [round(float(g.velocity), 5) for g in gains.limbs],
        "k_P2": [round(float(g.tension), 8) for g in gains.limbs],
        "k_Po": round(float(gains.proportional), 6),
        "k_Io": round(float(gains.integral), 6),
    }
    head = (
        "# What (3.24), (3.25) make of limbs.yaml, limb 1 first: k_I A/m, k_P1 A s/m, "
        "k_P2 m/s/N, k_Po -, k_Io 1/s.\n"
        "# For reading: the controllers compute them from limbs.yaml.\n"
    )
    return head + yaml.safe_dump(values, sort_keys=False, default_flow_style=None)


def table(rig: Rig, results: Mapping[int, LimbResult]) -> str:
    """Return identified values beside the configured ones, as text.

    Args:
        rig: with the configured values.
        results: identified, by the limb's index from 0.
    """
    lines = [
        "limb   k [m/s/A]  configured    T [s]  configured    fit [%]  k_e [N/m]  configured"
        "   fit [%]  play [mm]"
    ]
    limbs, springs = rig.limbs, rig.springs.nominal
    for i, r in sorted(results.items()):
        lines.append(
            f"{number(i):4d} {r.gain:11.4f} {limbs.gain[i]:11.4f} {r.time_constant:8.4f} "
            f"{limbs.time_constant[i]:11.4f} {100 * r.fit:10.2f} {r.stiffness:10.1f} "
            f"{springs[i]:11.1f} {100 * r.stiffness_fit:9.2f} {1e3 * r.backlash:10.3f}"
        )
    return "\n".join(lines)
