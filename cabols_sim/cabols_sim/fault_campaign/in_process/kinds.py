"""Kinds of the generated campaign: each state of the rig, broken in every way that it has; pure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from cabols_control.checks import BoolArray, FloatArray, IntArray
from cabols_sim.fault_campaign.in_process.rig import LockstepRig

Strike = Callable[[LockstepRig, np.random.Generator], None]
Senses = tuple[IntArray, FloatArray, BoolArray]
"""Counts, gauges' voltages, switches' lines: see Plant.sense."""

SOON_S, SENSOR_S, LATE_S, SEARCH_S = 0.05, 0.25, 2.0, 4.0
"""Bounds of detection [s]: at once, within a flat gauge's time and more, once it matters, and
within a search for the switches."""


@dataclass(frozen=True)
class Disturbance:
    """One way in which a rig breaks.

    Attributes:
        name: for the table.
        strike: does it.
        within_s: longest time to a report of a fault [s].
        latent: states in which nothing depends on it: there only the bounds hold.
        amplifier: whether an amplifier itself drives: then no current stops the motor.
    """

    name: str
    strike: Strike
    within_s: float
    latent: frozenset[str] = frozenset()
    amplifier: bool = False


def _any(random: np.random.Generator, rig: LockstepRig) -> int:
    return int(random.integers(rig.plant.tension.size))


def _highest(rig: LockstepRig) -> int:
    return int(np.argmax(rig.plant.tension))


def _sign(random: np.random.Generator) -> float:
    return float(random.choice([-1.0, 1.0]))


def _injected(fault: str, low: float = 0.0, high: float = 0.0, signed: bool = False) -> Strike:
    """Return a strike by a fault of the plant, at any limb, of a size drawn."""

    def strike(rig: LockstepRig, random: np.random.Generator) -> None:
        size = random.uniform(low, high) * (_sign(random) if signed else 1.0)
        rig.plant.inject(fault, _any(random, rig), size)

    return strike


def _at_highest(fault: str) -> Strike:
    def strike(rig: LockstepRig, random: np.random.Generator) -> None:
        del random
        rig.plant.inject(fault, _highest(rig))

    return strike


def _gauge(fault: str) -> Strike:
    def strike(rig: LockstepRig, random: np.random.Generator) -> None:
        rig.plant.inject(fault, value=float(random.integers(1, 6)))

    return strike


def _several(fault: str, limbs: Callable[[np.random.Generator, int], IntArray]) -> Strike:
    """Return a strike at several limbs at once, by one cause."""

    def strike(rig: LockstepRig, random: np.random.Generator) -> None:
        for i in limbs(random, rig.plant.tension.size):
            rig.plant.inject(fault, int(i))

    return strike


def _all(random: np.random.Generator, n: int) -> IntArray:
    del random
    return np.arange(n)


def _two(random: np.random.Generator, n: int) -> IntArray:
    return random.choice(n, 2, replace=False)


def _half(random: np.random.Generator, n: int) -> IntArray:
    first = int(random.integers(2)) * (n // 2)
    return np.arange(first, first + n // 2)


def _gauges(volts: float | None) -> Strike:
    """Return a strike that fixes all gauges: at a voltage, or (None) where they are."""

    def strike(rig: LockstepRig, random: np.random.Generator) -> None:
        del random
        if volts is None:
            for k in range(6):
                rig.plant.inject("gauge_flat", value=float(k))
            return
        sense = rig.plant.sense

        def unplugged() -> Senses:
            counts, gauges, lines = sense()
            gauges[:] = volts
            return counts, gauges, lines

        rig.plant.sense = unplugged  # type: ignore[method-assign]

    return strike


def _count_loss(rig: LockstepRig, random: np.random.Generator) -> None:
    limb, rate, sense = (
        _any(random, rig),
        _sign(random) * random.uniform(0.02, 0.3),
        rig.plant.sense,
    )
    began_s = rig.now_s

    def drifting() -> Senses:
        counts, gauges, lines = sense()
        counts[limb] += int(1e6 * rate * (rig.now_s - began_s))
        return counts, gauges, lines

    rig.plant.sense = drifting  # type: ignore[method-assign]


def _pose(kind: str) -> Strike:
    """Return a strike at the pose on its way."""

    def strike(rig: LockstepRig, random: np.random.Generator) -> None:
        sign = _sign(random)
        offset = sign * random.uniform(0.02, 0.3) * np.eye(3)[random.integers(3)]
        axis = np.eye(3)[random.integers(3)] * sign * random.uniform(0.05, 0.6)
        turn = Rotation.from_rotvec(axis).as_matrix()
        kept = rig.robot.position.copy(), rig.robot.rotation.copy()
        began_s = rig.now_s

        def change(
            position: FloatArray, rotation: FloatArray
        ) -> tuple[FloatArray, FloatArray] | None:
            passed_s = rig.now_s - began_s
            if kind == "silent":
                return None
            if kind == "frozen":
                return kept
            if kind == "jumps":
                return position + offset, rotation
            if kind == "turns":
                return position, turn @ rotation
            if kind == "drifts":
                return position + offset * min(passed_s, 1.0), rotation
            return position * np.nan, rotation

        rig.change_pose = change

    return strike


def _current(kind: str) -> Strike:
    """Return a limb controller that commands wrongly."""

    def strike(rig: LockstepRig, random: np.random.Generator) -> None:
        limb, sign = _any(random, rig), _sign(random)
        size = random.uniform(1.0, 3.0)

        def change(current: FloatArray) -> FloatArray:
            wrong = current.copy()
            if kind == "one":
                wrong[limb] = sign * size
            elif kind == "all":
                wrong[:] = size
            elif kind == "reversed":
                wrong *= -1.0
            elif kind == "no number":
                wrong[limb] = np.nan
            return wrong

        rig.change_current = change

    return strike


def _tension(size: float, all_limbs: bool) -> Strike:
    """Return a wrench controller that commands wrongly."""

    def strike(rig: LockstepRig, random: np.random.Generator) -> None:
        limb = _any(random, rig)

        def change(tension: FloatArray) -> FloatArray:
            wrong = np.array(tension)
            wrong[slice(None) if all_limbs else limb] = size
            return wrong

        rig.change_tension = change

    return strike


def _limbs_dead(rig: LockstepRig, random: np.random.Generator) -> None:
    del random
    rig.limb_controller_runs = False


def _wrench_dead(rig: LockstepRig, random: np.random.Generator) -> None:
    del random
    rig.wrench_controller_runs = False


def _pose_and_sensor(rig: LockstepRig, random: np.random.Generator) -> None:
    _pose("frozen")(rig, random)
    _gauges(None)(rig, random)


def _no_samples(rig: LockstepRig, random: np.random.Generator) -> None:
    """Let the bridge miss samples: nothing is read, judged or written meanwhile."""
    for _ in range(int(random.integers(25, 60))):
        rig.card.read()


RESTS = frozenset({"loading", "free", "second fault"})
SLACK = frozenset({"started", "pretightening"})
FREE = frozenset({"free", "robot moves"})
"""States in which nothing depends on a fault: at rest a frozen count is a right one, without zeros
no limb goes by pose or counts, only LOADING goes by tension commands. And 140 N on all limbs are
within the envelope: whether a load is the one that was asked for, the bridge does not know."""

DISTURBANCES = (
    Disturbance("cable breaks", _at_highest("cable_break"), SENSOR_S, FREE | SLACK),
    Disturbance("switch stuck open", _at_highest("switch_open"), SENSOR_S, FREE | SLACK),
    Disturbance("switch stuck closed", _injected("switch_closed"), LATE_S, RESTS | FREE | SLACK),
    Disturbance("all switches read open", _several("switch_open", _all), SEARCH_S, FREE),
    Disturbance(
        "all switches read closed", _several("switch_closed", _all), LATE_S, RESTS | FREE | SLACK
    ),
    Disturbance("encoder jumps", _injected("encoder_jump", 0.003, 0.02, True), SOON_S),
    Disturbance("encoder frozen", _injected("encoder_frozen"), LATE_S, RESTS),
    Disturbance("encoder loses counts", _count_loss, SEARCH_S, frozenset({"started"})),
    Disturbance("encoders of a connector frozen", _several("encoder_frozen", _half), LATE_S, RESTS),
    Disturbance("motor jams", _injected("motor_jam"), LATE_S, RESTS),
    Disturbance("two motors jam", _several("motor_jam", _two), LATE_S, RESTS),
    Disturbance("amplifiers' supply lost", _several("motor_jam", _all), LATE_S, RESTS),
    Disturbance(
        "amplifier offset", _injected("amplifier_offset", 0.5, 2.0, True), SOON_S, amplifier=True
    ),
    Disturbance(
        "amplifier delivers all", _injected("amplifier_offset", 6.0, 7.0), SOON_S, amplifier=True
    ),
    Disturbance(
        "two amplifiers offset", _several("amplifier_offset", _two), SOON_S, amplifier=True
    ),
    Disturbance("gauge flat", _gauge("gauge_flat"), SENSOR_S),
    Disturbance("gauge not a number", _gauge("gauge_nan"), SOON_S),
    Disturbance("gauge saturated", _gauge("gauge_saturated"), SOON_S),
    Disturbance("gauge drifts", _injected("gauge_drift", 2.0, 10.0, True), SEARCH_S),
    Disturbance("all gauges flat", _gauges(None), SENSOR_S),
    Disturbance("sensor unplugged, reads 0 V", _gauges(0.0), SENSOR_S),
    Disturbance("sensor unplugged, reads 10 V", _gauges(10.0), SOON_S),
    Disturbance("pose silent", _pose("silent"), SENSOR_S),
    Disturbance("pose frozen", _pose("frozen"), LATE_S, RESTS | SLACK),
    Disturbance("pose jumps", _pose("jumps"), SOON_S),
    Disturbance("pose turns", _pose("turns"), SOON_S),
    Disturbance("pose drifts", _pose("drifts"), LATE_S, frozenset({"started"})),
    Disturbance("pose not a number", _pose("no number"), SENSOR_S),
    Disturbance("pose and sensor frozen", _pose_and_sensor, SENSOR_S),
    Disturbance("wrong current, one limb", _current("one"), LATE_S),
    Disturbance("wrong current, all limbs", _current("all"), LATE_S),
    Disturbance("currents reversed", _current("reversed"), LATE_S),
    Disturbance("current not a number", _current("no number"), SOON_S),
    Disturbance("wrong tension, one limb", _tension(145.0, False), LATE_S, FREE | SLACK),
    Disturbance("wrong tension, all limbs", _tension(140.0, True), LATE_S, FREE | SLACK | RESTS),
    Disturbance("limb controller dead", _limbs_dead, SOON_S),
    Disturbance("wrench controller dead", _wrench_dead, LATE_S, FREE | SLACK | RESTS),
    Disturbance("samples missing", _no_samples, SOON_S + 0.06),
)
"""Every way; each meets each state below."""

STATES = ("started", "pretightening", "loading", "free", "robot moves", "second fault")
"""FREE_MOVING without zeros; the search for zeros; 100 N; FREE_MOVING at rest; FREE_MOVING while
the robot moves at 60 mm/s; 100 N while the bridge unloads, because the pose is silent."""


@dataclass(frozen=True)
class GeneratedKind:
    """A state and what breaks in it.

    Attributes:
        state: one of STATES.
        disturbance: what breaks.
    """

    state: str
    disturbance: Disturbance

    @property
    def name(self) -> str:
        """For the table."""
        return f"{self.state}: {self.disturbance.name}"

    @property
    def latent(self) -> bool:
        """Whether only the bounds hold, as nothing depends on it yet."""
        return self.state == "second fault" or self.state in self.disturbance.latent


def generated_kinds() -> list[GeneratedKind]:
    """Return every state with every disturbance."""
    return [GeneratedKind(state, way) for state in STATES for way in DISTURBANCES]
