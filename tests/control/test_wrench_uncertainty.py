# SPDX-License-Identifier: Apache-2.0
"""Stated uncertainty of a wrench: 95 % of the errors of rigs drawn by chance are within it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cabols_control.placement import Frame
from cabols_control.wrench_control.frames import WrenchFrame, place_frame, wrench_frames
from cabols_control.wrench_control.uncertainty import (
    UncertaintyConfig,
    WrenchUncertainty,
    uncertainty_sources,
)

DOWN = np.array([0.0, 0.0, -9.80665])
RIGS = 500
SENSOR = Frame([0.02, -0.01, 0.03], [10.0, -20.0, 30.0])
MASS, CENTRE = 2.0, np.array([0.01, 0.03, -0.02])
SCALE = np.array([1.0, 1.0, 1.0, 0.1, 0.1, 0.1])
FRAMES = {
    "tip": WrenchFrame([0.1, 0.02, 0.0], [0.0, 90.0, 0.0]),
    "knee": WrenchFrame([0.4, 1.3, 0.9], [30.0, 0.0, 0.0], parent="base"),
    "upright": WrenchFrame([0.1, 0.0, 0.05], axes="base"),
    "odd": WrenchFrame([0.4, 1.3, 0.9], parent="base", axes="platform"),
}


def adjoint(place, turn):
    """(6, 6) that takes a wrench in a frame to the frame's parent, by its pose there."""
    x, y, z = place
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.block([[turn, np.zeros((3, 3))], [skew @ turn, turn]])


def moved(place, turn, by, about):
    return place + by, Rotation.from_rotvec(about).as_matrix() @ turn


def weight(mass, centre, turn, pull):
    """(6,) of a mass in platform axes; turn: platform to base; pull: its acceleration, base."""
    force = mass * turn.T @ pull
    return np.concatenate([force, np.cross(centre, force)])


def frame_matrix(frame, place, turn, off):
    """(6, 6) from platform axes at the platform to a frame; off: its own errors."""
    own = moved(np.array(frame.position), frame.rotation, *off)
    if frame.parent == "base":
        lever, axes = own[0] - place, own[1]
    else:
        lever, axes = turn @ own[0], turn @ own[1]
    axes = {"own": axes, "base": np.eye(3), "platform": turn}[frame.axes]
    return np.linalg.inv(adjoint(lever, axes)) @ adjoint(np.zeros(3), turn)


def drawn(config, frame, known_tare, random):
    """Error of a rig's measured wrench in a frame, by its physics; and the stated half widths."""
    place, turn = np.array([0.5, 1.2, 0.8]), Rotation.from_rotvec([0.2, -0.3, 0.5]).as_matrix()
    before = Rotation.from_rotvec([-0.3, 0.1, 0.2]).as_matrix()
    acceleration = np.array([1.0, -0.5, 0.8])
    told = np.array([40.0, -30.0, 20.0, 3.0, -4.0, 2.0])  # measured, platform axes

    def even(size, *shape):
        return size * random.uniform(-1.0, 1.0, shape)

    if not known_tare:
        before = Rotation.random(random_state=random).as_matrix()
    # What the rig believes: from the told wrench back to what the sensor said since the tare.
    believed = adjoint(SENSOR.position, SENSOR.rotation)
    carried = weight(MASS, CENTRE, turn, DOWN - acceleration)
    said = np.linalg.solve(believed, told + carried - weight(MASS, CENTRE, before, DOWN))
    # What is true.
    about = even(config.pose_turn, 3)
    true_place, true_turn = moved(place, turn, even(config.pose_position, 3), about)
    sensor = moved(
        np.array(SENSOR.position),
        SENSOR.rotation,
        even(config.sensor_position, 3),
        even(config.sensor_turn, 3),
    )
    share = even(config.cross_talk, 6, 6) * np.outer(SCALE, 1.0 / SCALE)
    np.fill_diagonal(share, even(config.gain, 6))
    noise = even(1.0, 6) * config.bias + random.normal(size=6) * config.noise
    load = adjoint(*sensor) @ np.linalg.solve(np.eye(6) + share, said - noise)
    mass, centre = MASS + even(config.tool_mass), CENTRE + even(config.tool_centre, 3)
    pull = DOWN - (1.0 - even(config.inertia)) * acceleration
    true = load - weight(mass, centre, true_turn, pull) + weight(mass, centre, before, DOWN)
    off = even(config.frame_position, 3), even(config.frame_turn, 3)
    right = frame_matrix(frame, true_place, true_turn, off) @ true
    shown = frame_matrix(frame, place, turn, (np.zeros(3), np.zeros(3))) @ told
    return shown - right, (place, turn, before, acceleration, told)


@pytest.mark.parametrize("known_tare", [True, False])
@pytest.mark.parametrize("name", list(FRAMES))
def test_95_of_100_errors_are_within(name, known_tare):
    """By the physics of 500 rigs, each wrong in everything; no derivative of ours is used."""
    random = np.random.default_rng(len(name) + 10 * known_tare)
    config = UncertaintyConfig(frame_position=0.001, frame_turn=0.004)
    frame = FRAMES[name]
    trials = [drawn(config, frame, known_tare, random) for _ in range(RIGS)]
    errors = np.array([error for error, _ in trials])
    place, turn, before, acceleration, told = trials[0][1]
    frames = wrench_frames("base", "platform", Frame([0.0] * 3), SENSOR, FRAMES)
    record = frames.record(name)
    place_frame(record, place, turn)
    known = WrenchUncertainty(uncertainty_sources(config, MASS, CENTRE, SENSOR), frames)
    if known_tare:
        known.tell_tare(before.T @ DOWN * MASS)
    base = np.concatenate([turn @ told[:3], turn @ told[3:]])
    stated = known.of(name, record, turn, acceleration, base)
    share = np.mean(np.abs(errors) <= stated, axis=0)
    # Of 500, three standard deviations are 3 %.
    assert (share >= 0.92).all(), share
    # And not by being too careful: by known tares the widths are those that were drawn.
    spread = 1.96 * np.sqrt(np.mean(errors**2, axis=0))
    assert (stated <= (1.12 if known_tare else 1.3) * spread).all(), stated / spread


SOURCES = tuple(UncertaintyConfig.__dataclass_fields__)


@pytest.mark.parametrize("source", SOURCES)
@pytest.mark.parametrize("name", ["base", *FRAMES])
def test_each_source_alone(name, source):
    """One source at a time: the standard deviation is that of rigs wrong in it alone."""
    none = UncertaintyConfig(
        **{key: [0.0] * 6 if key in ("bias", "noise") else 0.0 for key in SOURCES}
    )
    size = [0.2] * 6 if source in ("bias", "noise") else 0.01
    config = replace(none, **{source: size})
    random = np.random.default_rng(5)
    frame = FRAMES.get(name, WrenchFrame([0.0, 0.0, 0.0], axes="base"))
    if name == "base" and source.startswith("frame_"):
        frame = WrenchFrame([0.0, 0.0, 0.0], axes="base")
        config = none  # its place and axes are exact
    rigs = [drawn(config, frame, True, random) for _ in range(100)]
    place, turn, before, acceleration, told = rigs[0][1]
    frames = wrench_frames("base", "platform", Frame([0.0] * 3), SENSOR, FRAMES)
    record = frames.record(name)
    place_frame(record, place, turn)
    known = WrenchUncertainty(uncertainty_sources(config, MASS, CENTRE, SENSOR), frames)
    known.tell_tare(before.T @ DOWN * MASS)
    base = np.concatenate([turn @ told[:3], turn @ told[3:]])
    stated = known.of(name, record, turn, acceleration, base)
    spread = 1.96 * np.sqrt(np.mean(np.square([error for error, _ in rigs]), axis=0))
    assert stated == pytest.approx(spread, rel=0.25, abs=1e-6)


def test_wrong_configurations_are_refused():
    for key, value in (("bias", [0.1] * 5), ("noise", [-1.0] * 6), ("noise", [np.nan] * 6)):
        with pytest.raises(ValueError, match=key):
            UncertaintyConfig(**{key: value})
    with pytest.raises(ValueError, match="gain"):
        UncertaintyConfig(gain=float("nan"))
