# SPDX-License-Identifier: Apache-2.0
"""Stiffness campaigns simulated at the measurement level, with the simulated rig's own noise.

Truth (stiffness, tracker, sensor, drift) is read from cabols_sim's configuration. What is the same
in all campaigns, the loaded robot, is computed once; each draw adds the noise of one campaign.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cabols_control.kinematics import structure_matrix
from cabols_control.registration.reflectors import register_frame
from cabols_control.rig import load_rig
from cabols_hw.abb.configurations import load_configurations
from cabols_hw.card.config import load_card
from cabols_hw.safety.config import load_safety
from cabols_hw.tracker.beam import beam_axes, predicted_covariance
from cabols_hw.tracker.config import load_tracker_config
from cabols_sim.devices.robot.kinematics import Arm
from cabols_sim.devices.robot.robot_config import load_robot_truth
from cabols_sim.devices.tracker.config import load_tracker_truth
from cabols_sim.devices.tracker.drift import Drift, displaced
from cabols_sim.plant.config import load_plant
from cabols_stiffness import PointSamples, load_robot
from cabols_stiffness.design import Setup, optimal_tensions
from cabols_stiffness.measurements.deflected_arm import loaded_posture, without_tool_weight
from cabols_stiffness.model.screws import turn

REPEATABILITY = 0.02
"""Of the tensions from pass to pass: cable friction lets the wrench differ a little."""
GUESS = np.array([1.1, 0.9, 1.1, 0.9, 1.1, 0.9] * 2)
"""Of the stiffness, before a campaign or after a first, coarse identification."""
REPEATED = np.diag([4e-5] * 3 + [9e-5] * 3) ** 2
"""Weights of the robot's poses in the registration: its repeatability."""
RAMP_STEPS, SETTLING_STEPS = 8, 6
REPETITION_S = 2.0
"""From one load to the next: ramp, settling, measuring."""

WRENCH_LIMIT = 0.95 * np.array(load_safety().wrench_max)
TENSION = (load_rig().holding_tension, 140.0)


def bench_robot():
    """The robot model of the bench, with the platform as its tool."""
    tool = load_configurations()
    return load_robot(tool_position=tool.tool_position, tool_rotation=tool.tool_rotation)


def bench_truth():
    """The simulated rig's robot: stiffness as the means of table 4.3."""
    return load_robot_truth()


@dataclass(frozen=True, eq=False)
class Plan:
    """Tensions of a campaign: rows in the order of measurement, the same for each reflector.

    configuration, load, branch: (n,); joints: (n, 6) [rad]; tension: (n, cables) [N].
    """

    configuration: np.ndarray
    load: np.ndarray
    branch: np.ndarray
    joints: np.ndarray
    tension: np.ndarray


def ramps(configurations, peaks, levels=(1 / 3, 2 / 3, 1.0)):
    """Plan of ramps from the holding tension to each peak and back, a reference after each.

    Args:
        configurations: (c, 6) joints [rad].
        peaks: c arrays (d, cables) of tensions [N].
        levels: shares of the way to a peak at which to measure.
    """
    holding = load_rig().holding_tension
    rows = []
    for index, (joints, tensions) in enumerate(zip(configurations, peaks, strict=True)):
        load = 0
        rows.append((index, load, 0, joints, np.full(tensions.shape[1], holding)))
        for peak in tensions:
            up = [(level, 1) for level in levels]
            down = [(level, -1) for level in reversed(levels[:-1])]
            for level, branch in [*up, *down, (0.0, 0)]:
                load += 1
                tension = holding + level * (peak - holding)
                rows.append((index, load, branch, joints, tension))
    columns = [np.array(column) for column in zip(*rows, strict=True)]
    return Plan(*columns)


class Bench:
    """Simulates campaigns of one plan."""

    def __init__(self, robot, plan, truth=None, averaging_s=0.2):
        """Load the simulated robot, truth, a RobotConfig (None: the bench's), as planned."""
        self.robot, self.averaging_s = robot, averaging_s
        self.truth = truth or bench_truth()
        self.parameters = np.array([*self.truth.stiffness, *self.truth.cubic])
        self.tracker = load_tracker_truth()
        self.nominal = load_tracker_config()
        self.card = load_card()
        self.sensors = load_plant().sensors
        count = len(self.tracker.reflectors)
        n = plan.load.size
        stays = np.unique(plan.configuration)
        # Reflector by reflector at each configuration.
        self.order = np.concatenate(
            [np.flatnonzero(plan.configuration == c) for c in stays for _ in range(count)]
        )
        self.reflector = np.concatenate(
            [np.full((plan.configuration == c).sum(), r) for c in stays for r in range(count)]
        )
        self.plan = Plan(*(getattr(plan, name)[self.order] for name in plan.__dataclass_fields__))
        random = np.random.default_rng(20)
        k = n * count
        scatter = 1.0 + REPEATABILITY * random.standard_normal((k, plan.tension.shape[1]))
        tension = self.plan.tension * scatter
        geometry = load_rig().geometry
        posture = robot.posture(self.plan.joints)
        matrices = [
            structure_matrix(geometry, p, r)
            for p, r in zip(posture.position, posture.rotation, strict=True)
        ]
        self.wrench = np.einsum("kij,kj->ki", matrices, tension)
        self.deflection = self._deflected()
        where = robot.posture(self.plan.joints + self.deflection)
        self.time = REPETITION_S * np.arange(k)
        self.points = where.position + np.einsum(
            "kij,kj->ki", where.rotation, self.tracker.reflector_points[self.reflector]
        )
        base, turned = np.array(self.tracker.base_position), self.tracker.base_rotation
        self.seen = (self.points - base) @ turned
        self.sensed = turn(where.rotation.swapaxes(1, 2), self.wrench)
        self.axes = np.array([beam_axes(p) for p in self.seen])
        distance = np.linalg.norm(self.seen, axis=1)
        samples = max(1, round(averaging_s * self.tracker.rate))
        floor = self.tracker.averaging_floor**2
        self.share = floor + (1.0 - floor) / samples
        self.sigmas = np.array([self.tracker.noise.sigmas(d) for d in distance])
        # Converter steps are dithered by the gauges' noise.
        volts = np.hypot(self.sensors.gauge_noise, self.sensors.adc_step / np.sqrt(12.0))
        matrix = self.card.platform_matrix
        self.wrench_root = volts / np.sqrt(samples) * matrix
        self.tare_root = volts / np.sqrt(self.card.tare_samples) * matrix
        weight = np.zeros((k, 6))
        weight[:, 2] = -self.sensors.tool_weight
        # The bridge takes the weight off with the encoders' orientation, not the deflected one.
        self.weight = turn(where.rotation.swapaxes(1, 2), weight) - turn(
            posture.rotation.swapaxes(1, 2), weight
        )
        self.posture = posture

    def _deflected(self):
        """(k, 6) deflections by cabols_sim's flexible joints, wrench after wrench, quasi-static."""
        arm = Arm(tool_position=self.robot.tool_position, tool_rotation=self.robot.tool_rotation)
        flexible, found = self.truth.joints(), np.empty_like(self.plan.joints)
        steps = RAMP_STEPS if np.any(self.truth.hysteresis_torque) else 1
        before = np.zeros(6)
        for k, (joints, wrench) in enumerate(zip(self.plan.joints, self.wrench, strict=True)):
            for step in range(1, steps + 1):
                now = before + step / steps * (wrench - before)
                for _ in range(SETTLING_STEPS):
                    _, _, jacobian = arm.solve(joints + flexible.deflection)
                    flexible.step(jacobian, now, 1.0)
            before, found[k] = wrench, flexible.deflection
        return found

    def draw(self, seed, register=True):
        """One campaign's samples, (3 n) of them."""
        random = np.random.default_rng([seed, 7])
        k = self.time.size
        noise = np.sqrt(self.share) * self.sigmas * random.standard_normal((k, 3))
        measured = self.seen + np.einsum("kij,kj->ki", self.axes, noise)
        drift = Drift(self.tracker.drift, seed)
        measured = measured + np.array(
            [displaced(p, drift.at(t)) - p for p, t in zip(self.seen, self.time, strict=True)]
        )
        covariance = self.share * np.einsum("kij,kj,klj->kil", self.axes, self.sigmas**2, self.axes)
        tare = self.tare_root @ random.standard_normal(6)
        wrench = self.sensed + self.weight + random.standard_normal((k, 6)) @ self.wrench_root.T
        wrench = wrench + tare
        rotation, offsets = self._registered(measured, covariance) if register else self._true()
        plan = self.plan
        samples = PointSamples(
            configuration=plan.configuration,
            load=plan.load,
            branch=plan.branch,
            reflector=self.reflector,
            group=3 * plan.configuration + self.reflector,
            time=self.time,
            joints=plan.joints,
            wrench=wrench,
            wrench_covariance=np.broadcast_to(self.wrench_root @ self.wrench_root.T, (k, 6, 6)),
            offset=offsets[self.reflector],
            position=measured @ rotation.T,
            position_covariance=rotation @ covariance @ rotation.T,
        )
        return without_tool_weight(
            samples, self.robot, GUESS * self.parameters, self.sensors.tool_weight
        )

    def _true(self):
        return self.tracker.base_rotation, self.tracker.reflector_points

    def _registered(self, measured, covariance):
        """Tracker's rotation and reflectors from the unloaded references of the campaign."""
        plan, count = self.plan, len(self.tracker.reflectors)
        stays = np.unique(plan.configuration)
        points, weights, where = [], [], []
        for c in stays:
            here = (plan.configuration == c) & (plan.branch == 0)
            each = [np.flatnonzero(here & (self.reflector == r)) for r in range(count)]
            points.append([measured[i].mean(axis=0) for i in each])
            weights.append([covariance[i].mean(axis=0) / i.size for i in each])
            where.append(each[0][0])
        posture = loaded_posture(
            self.robot, plan.joints[where], self.sensed[where], GUESS * self.parameters
        )
        frame = register_frame(
            posture.position,
            posture.rotation,
            self.nominal.reflector_points,
            points,
            weights,
            pose_covariance=REPEATED,
            solve_reflectors=True,
            least_probability=0.0,  # as frames_of: the robot gives way, the fit is judged later
        )
        return frame.rotation, frame.reflectors


def random_peaks(robot, configurations, count, seed):
    """Arbitrary tensions that the wrench limits allow: uniform between 6 and 140 N, scaled down."""
    random = np.random.default_rng(seed)
    rig = load_rig()
    peaks = []
    for joints in configurations:
        position, rotation = robot.forward(joints)
        matrix = structure_matrix(rig.geometry, position, rotation)
        holding = np.full(rig.geometry.cables, rig.holding_tension)
        rows = []
        for _ in range(count):
            wanted = random.uniform(rig.holding_tension, 140.0, rig.geometry.cables)
            load = turn(rotation.T, matrix @ wanted)
            share = min(1.0, 1.0 / np.abs(load / WRENCH_LIMIT).max())
            rows.append(holding + share * (wanted - holding))
        peaks.append(np.array(rows))
    return peaks


def bench_setup(averaging_s=0.2, cubic=False):
    """What a design of experiments knows of the bench; the stiffness is guessed 10 % wrong."""
    config, geometry = load_tracker_config(), load_rig().geometry
    floor = config.averaging_floor**2
    share = floor + (1.0 - floor) / max(1.0, averaging_s * load_tracker_truth().rate)
    turned = config.base_rotation
    points = (
        geometry.reference_position
        + config.reflector_points @ geometry.reference_rotation.T
        - config.base_position
    ) @ turned
    noise = [turned @ predicted_covariance(p, config.noise, share) @ turned.T for p in points]
    guess = GUESS[:6] * np.array(bench_truth().stiffness)
    return Setup(bench_robot(), guess, config.reflector_points, np.array(noise), cubic)


def optimal_peaks(configurations, peaks, criterion="D"):
    """Optimal tensions for configurations, and the design."""
    return optimal_tensions(
        bench_setup(),
        load_rig().geometry,
        configurations,
        peaks,
        tension=TENSION,
        wrench_limit=WRENCH_LIMIT,
        criterion=criterion,
    )


def bench_configurations():
    """(13, 6) stored configurations of the bench [rad]."""
    stored = load_configurations()
    return np.array([stored.joints(i) for i in range(len(stored))])
