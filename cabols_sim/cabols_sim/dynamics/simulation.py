# SPDX-License-Identifier: Apache-2.0
"""Forward dynamics: the motion under given tensions, the power balance integrated beside it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from cabols_control.checks import FloatArray, in_range
from cabols_control.errors import CabolsError
from cabols_sim.dynamics.body import BodyState, acceleration
from cabols_sim.dynamics.cables import cross
from cabols_sim.dynamics.energy import kinetic_energy, potential_energy, power
from cabols_sim.dynamics.robot import CableRobot

TensionLaw = Callable[[float, BodyState], FloatArray]
"""(n,) tensions [N] at a time [s] and state."""
WrenchLaw = Callable[[float, BodyState], FloatArray]
"""(6,) wrench on the platform at its origin, base axes [N, N m]."""

_NO_WRENCH = np.zeros(6)


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A simulated motion at k times.

    Attributes:
        time: (k,) [s].
        states: k states of the platform.
        tension: (k, n) [N].
        acceleration: (k, m) of the degrees of freedom.
        kinetic: (k,) [J].
        potential: (k,) [J].
        work: (k, 3) done since the start by tensions, wrench and mass stream [J].
    """

    time: FloatArray
    states: tuple[BodyState, ...]
    tension: FloatArray
    acceleration: FloatArray
    kinetic: FloatArray
    potential: FloatArray
    work: FloatArray

    @property
    def imbalance(self) -> FloatArray:
        """(k,) energy minus what has fed it since the start [J]; zero but for integration."""
        energy = self.kinetic + self.potential
        return np.asarray(energy - energy[0] - self.work.sum(axis=1))

    @property
    def relative_imbalance(self) -> float:
        """Largest imbalance over the largest kinetic energy."""
        return float(np.abs(self.imbalance).max() / self.kinetic.max())


def simulate(
    robot: CableRobot,
    start: BodyState,
    tension_law: TensionLaw,
    duration_s: float,
    wrench_law: WrenchLaw | None = None,
    samples: int = 601,
    tolerance: float = 1e-9,
) -> Trajectory:
    """Integrate (2.29) by Dormand and Prince's method of order 8; orientation as a quaternion.

    Args:
        robot: model.
        start: pose and twist of the platform; a planar robot's lies in z = 0.
        tension_law: tensions that the winches hold.
        duration_s: [s].
        wrench_law: what else acts on the platform; None: nothing.
        samples: of the result, evenly spaced.
        tolerance: relative, of the integration.

    Returns:
        The motion.

    Raises:
        OutOfRangeError: if the duration, the samples or the tolerance make no sense.
        CabolsError: if the integration cannot continue.
    """
    in_range("duration_s", duration_s, 1e-9, 1e7)
    in_range("samples", samples, 2, 1_000_000)
    in_range("tolerance", tolerance, 1e-13, 1e-2)
    keep = list(robot.freedom)
    wrench_of = wrench_law or (lambda _time, _state: _NO_WRENCH)
    scale = max(float(np.abs(start.position - robot.base_points).max()), 1.0)

    def rates(time: float, y: FloatArray) -> FloatArray:
        state = _unpack(robot, y)
        tension, wrench = tension_law(time, state), wrench_of(time, state)
        nu_dot = acceleration(robot, state, tension, wrench)
        spin = 0.5 * _quaternion_rate(state.twist[3:], y[3:7])
        fed = power(robot, state, tension, wrench)
        return np.concatenate([state.twist[:3], spin, nu_dot, fed])

    first = _pack(start, keep)
    absolute = np.full(first.size, tolerance)
    absolute[:3] *= scale
    # The works only watch: they must not set the step, but be as good as the motion.
    absolute[-3:] *= max(kinetic_energy(robot, start), robot.mass * scale)
    times = np.linspace(0.0, duration_s, samples)
    found = solve_ivp(
        rates,
        (0.0, duration_s),
        first,
        method="DOP853",
        t_eval=times,
        rtol=tolerance,
        atol=absolute,
    )
    if not found.success:
        raise CabolsError(f"simulate: expected to reach {duration_s:g} s, got {found.message}")
    states = tuple(_unpack(robot, column) for column in found.y.T)
    tension = np.array([tension_law(t, s) for t, s in zip(times, states, strict=True)])
    nu_dot = [
        acceleration(robot, state, pull, wrench_of(time, state))
        for time, state, pull in zip(times, states, tension, strict=True)
    ]
    return Trajectory(
        time=times,
        states=states,
        tension=tension,
        acceleration=np.array(nu_dot),
        kinetic=np.array([kinetic_energy(robot, state) for state in states]),
        potential=np.array([potential_energy(robot, state) for state in states]),
        work=found.y[-3:].T.copy(),
    )


def winch_springs(
    stiffness: float, damping: float, rest: FloatArray, tension: FloatArray, robot: CableRobot
) -> TensionLaw:
    """Return a law by which every winch acts as a spring and damper about a length; never pushes.

    Args:
        stiffness: [N/m].
        damping: [N s/m].
        rest: (n,) lengths at which the tensions are `tension` [m].
        tension: (n,) [N].
        robot: whose cables they are.
    """

    def law(_time: float, state: BodyState) -> FloatArray:
        cables = state.cables(robot)
        pull = tension + stiffness * (cables.length - rest) + damping * cables.rate
        return np.asarray(np.maximum(pull, 0.0))

    return law


def _pack(state: BodyState, keep: list[int]) -> FloatArray:
    quaternion = Rotation.from_matrix(state.rotation).as_quat()
    return np.concatenate([state.position, quaternion, state.twist[keep], np.zeros(3)])


def _unpack(robot: CableRobot, y: FloatArray) -> BodyState:
    twist = np.zeros(6)
    twist[list(robot.freedom)] = y[7:-3]
    return BodyState(y[:3], _rotation(y[3:7]), twist)


def _rotation(quaternion: FloatArray) -> FloatArray:
    """(3, 3) of a quaternion (x, y, z, w) of any length: the integration may stretch it."""
    x, y, z, w = quaternion / np.sqrt(quaternion @ quaternion)
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
            [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
            [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


def _quaternion_rate(omega: FloatArray, q: FloatArray) -> FloatArray:
    """(omega, 0) times q, omega in base axes."""
    vector = omega * q[3] + cross(omega, q[:3])
    return np.append(vector, -omega @ q[:3])
