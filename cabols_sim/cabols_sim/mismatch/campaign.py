# SPDX-License-Identifier: Apache-2.0
"""A stiffness campaign of the hidden robot, as a rig would measure it: loads up and down."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cabols_control.checks import FloatArray
from cabols_sim.mismatch.hidden_robot import HiddenRobot

LOADING, UNLOADING, REFERENCE = 1, -1, 0
LOAD_S, MOVE_S = 2.0, 10.0
"""Time of a load and of a move between configurations [s]."""


@dataclass(frozen=True)
class Noise:
    """Standard deviations of the instruments.

    Attributes:
        position_m: of a reflector [m].
        force_n: of a force [N].
        torque_nm: of a torque [N m].
    """

    position_m: float = 15e-6
    force_n: float = 0.2
    torque_nm: float = 0.02


def measure(
    robot: HiddenRobot,
    joints: FloatArray,
    peaks: FloatArray,
    reflectors: FloatArray,
    seed: int,
    noise: Noise | None = None,
    stops: tuple[float, ...] = (0.5, 1.0),
    down: bool = True,
) -> dict[str, FloatArray]:
    """Columns of a campaign; every load of every configuration at every reflector.

    Args:
        robot: hidden.
        joints: (c, n) configurations by the encoders [rad].
        peaks: (c, p, 6) wrenches at the ends of each configuration's ways, tool axes [N, N m].
        reflectors: (r, 3) from the tool's origin, tool axes [m].
        seed: of noise and scatter.
        noise: of the instruments; None: usual.
        stops: shares of the way at which it is measured.
        down: whether also on the way back.
    """
    noise = noise or Noise()
    random = np.random.default_rng([seed, 162])
    factor = robot.factor(joints, seed)
    count = joints.shape[0]
    pose, held = robot.rest(joints, factor)
    begin = np.arange(count) * (MOVE_S + LOAD_S * reflectors.shape[0] * peaks.shape[1] * 4.0)
    rows: dict[str, list[Any]] = {name: [] for name in COLUMNS}
    clock = begin.copy()
    for r, reflector in enumerate(reflectors):
        for load, branch, share in _sequence(peaks.shape[1], stops, down):
            wanted = np.zeros((count, 6)) if branch == REFERENCE else share * peaks[:, load]
            pose, held = robot.load(joints, wanted, factor, held)
            clock = clock + LOAD_S
            seen = np.einsum("cij,j->ci", pose[:, :3, :3], reflector) + pose[:, :3, -1]
            seen = seen + _warmth(robot, seen, clock)
            rows["configuration"].append(np.arange(count))
            rows["load"].append(np.full(count, _number(load, branch, share, stops)))
            rows["branch"].append(np.full(count, branch))
            rows["reflector"].append(np.full(count, r))
            rows["group"].append(np.arange(count) * len(reflectors) + r)
            rows["time"].append(clock)
            rows["joints"].append(joints)
            deviation = np.repeat([noise.force_n, noise.torque_nm], 3)
            rows["wrench"].append(held.wrench + random.normal(size=(count, 6)) * deviation)
            rows["offset"].append(np.tile(reflector, (count, 1)))
            error = random.normal(size=(count, 3)) * noise.position_m
            rows["position"].append(seen + error)
    found = {name: np.concatenate(parts) for name, parts in rows.items()}
    order = np.argsort(found["time"], kind="stable")
    return {name: column[order] for name, column in found.items()}


COLUMNS = (
    *("configuration", "load", "branch", "reflector", "group", "time"),
    *("joints", "wrench", "offset", "position"),
)


def _sequence(peaks: int, stops: tuple[float, ...], down: bool) -> list[tuple[int, int, float]]:
    """Loads of a pass: up, back down, and an unloaded reference after each way."""
    found = [(0, REFERENCE, 0.0)]
    for load in range(peaks):
        found += [(load, LOADING, share) for share in stops]
        if down:
            found += [(load, UNLOADING, share) for share in stops[-2::-1]]
        found.append((load, REFERENCE, 0.0))
    return found


def _number(load: int, branch: int, share: float, stops: tuple[float, ...]) -> int:
    """Number of a load: the same on both branches; references have one of their own."""
    if branch == REFERENCE:
        return 1000
    return load * len(stops) + stops.index(share)


def _warmth(robot: HiddenRobot, point: FloatArray, time: FloatArray) -> FloatArray:
    """(c, 3) shift of points (c, 3) by the warming up of foot and arm, at times (c,) [m]."""
    truth = robot.settings
    warm = 1.0 - np.exp(-time / truth.warm_up_s)
    return np.asarray(warm[:, None] * (truth.warming_m + truth.growth * point))
