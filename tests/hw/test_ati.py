# SPDX-License-Identifier: Apache-2.0
"""The force/torque sensor: .cal files, frames, tare and the tool's weight."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cabols_control.configuration import load_config
from cabols_control.errors import ConfigError, ShapeError
from cabols_control.rig_folder import rig_file
from cabols_hw.card.config import CardConfig
from cabols_hw.force_torque.ati import (
    AXES,
    parse_calibration,
    read_calibration,
    saturated_axes,
    shift_wrench,
    wrench_transform,
)
from cabols_hw.force_torque.tool_weight import (
    OrientationsError,
    bias_at,
    identify_tool,
    tool_weight,
)

G = 9.80665

# Two published calibrations of ATI sensors, with the rows as measured (Axis, times a scale, about
# the gauges' centre) and as ATI itself has transformed them (UserAxis): ATI is the reference here.
GAMMA = """
<FTSensor Serial="FT0" BodyStyle="Gamma" Family="DAQ" NumGages="6" CalFileVersion="1.1">
<Calibration PartNumber="SI-130-10" ForceUnits="N" TorqueUnits="N-m" DistUnits="m"
 OutputRange="20" HWTempComp="True" GainMultiplier="1" OutputBipolar="True">
<Axis Name="Fx" values="-0.27053 -0.14278 0.35224 -32.30108 -0.22111 32.83006"
 max="130" scale="2.33993181642138"/>
<Axis Name="Fy" values="0.21616 37.46357 0.05722 -18.83819 0.35126 -18.85998"
 max="130" scale="2.33993181642138"/>
<Axis Name="Fz" values="18.48980 -0.25078 18.75502 -0.41293 18.60017 -0.58878"
 max="400" scale="0.747981765296576"/>
<Axis Name="Tx" values="0.05325 0.15667 -32.28492 0.82744 32.26505 -1.25235"
 max="10" scale="44.8196831994584"/>
<Axis Name="Ty" values="37.31421 -0.62445 -18.43472 0.63319 -18.48677 0.60638"
 max="10" scale="44.8196831994584"/>
<Axis Name="Tz" values="-0.13536 -18.46474 0.04406 -18.57097 0.27123 -18.80438"
 max="10" scale="43.1398206760749"/>
<BasicTransform Dx="0" Dy="0" Dz="0.0120142" Rx="0" Ry="0" Rz="0"/>
<UserAxis Name="Fx" values="-0.11562 -0.06102 0.15054 -13.80428 -0.09449 14.03035" max="130"/>
<UserAxis Name="Fy" values="0.09238 16.01054 0.02446 -8.05074 0.15012 -8.06005" max="130"/>
<UserAxis Name="Fz" values="24.71959 -0.33527 25.07417 -0.55206 24.86714 -0.78715" max="400"/>
<UserAxis Name="Tx" values="0.00230 0.19585 -0.72004 -0.07826 0.72169 -0.12478" max="10"/>
<UserAxis Name="Ty" values="0.83393 -0.01320 -0.41312 0.17997 -0.41133 -0.15503" max="10"/>
<UserAxis Name="Tz" values="-0.00314 -0.42802 0.00102 -0.43048 0.00629 -0.43589" max="10"/>
</Calibration></FTSensor>"""
NANO17 = """
<FTSensor Serial="FT0" BodyStyle="Nano17" Family="DAQ" NumGages="6" CalFileVersion="1.1">
<Calibration PartNumber="SI-25-0.25" ForceUnits="N" TorqueUnits="N-mm" DistUnits="mm"
 OutputRange="20" HWTempComp="True" GainMultiplier="1" OutputBipolar="True">
<Axis Name="Fx" values="-0.06744 -0.06253 0.34834 37.34247 1.90538 -37.39899"
 max="25" scale="11.3650042049178"/>
<Axis Name="Fy" values="0.55821 -45.57953 -0.51071 22.00831 -0.39426 21.28868"
 max="25" scale="11.3650042049178"/>
<Axis Name="Fz" values="22.07572 0.66524 22.64229 0.15088 21.81132 -0.64550"
 max="35" scale="5.89341666193018"/>
<Axis Name="Tx" values="0.25495 0.07335 38.61586 0.30585 -38.71584 1.08341"
 max="250" scale="1.82292883446332"/>
<Axis Name="Ty" values="-43.12768 -1.34402 23.17737 0.13073 21.67933 -0.58572"
 max="250" scale="1.82292883446332"/>
<Axis Name="Tz" values="0.23141 -23.28809 -0.53681 -22.47927 1.56779 -22.44391"
 max="250" scale="1.57420173377595"/>
<BasicTransform Dx="0" Dy="0" Dz="6.096" Rx="0" Ry="0" Rz="0"/>
<UserAxis Name="Fx" values="-0.00593 -0.00550 0.03065 3.28574 0.16765 -3.29072" max="25"/>
<UserAxis Name="Fy" values="0.04912 -4.01052 -0.04494 1.93650 -0.03469 1.87318" max="25"/>
<UserAxis Name="Fz" values="3.74583 0.11288 3.84196 0.02560 3.70096 -0.10953" max="35"/>
<UserAxis Name="Tx" values="0.43927 -24.40787 20.90948 11.97267 -21.44973 12.01322" max="250"/>
<UserAxis Name="Ty" values="-23.62228 -0.70375 12.52751 -19.95816 10.87057 19.73889" max="250"/>
<UserAxis Name="Tz" values="0.14700 -14.79358 -0.34100 -14.27979 0.99593 -14.25733" max="250"/>
</Calibration></FTSensor>"""


def without_user_axes(text):
    return "\n".join(line for line in text.splitlines() if "UserAxis" not in line)


def turned(*angles_deg):
    return Rotation.from_euler("xyz", angles_deg, degrees=True).as_matrix()


def test_user_axes_are_the_matrix():
    found = parse_calibration(GAMMA, "gamma.cal")
    assert found.part_number == "SI-130-10"
    assert found.serial == "FT0"
    np.testing.assert_allclose(found.matrix[1, 1], 16.01054)
    np.testing.assert_allclose(found.matrix[4, 0], 0.83393)
    np.testing.assert_allclose(found.limits, [130, 130, 400, 10, 10, 10])


def test_units_are_converted():
    found = parse_calibration(NANO17, "nano17.cal")
    np.testing.assert_allclose(found.matrix[3, 1], -0.02440787)
    np.testing.assert_allclose(found.limits, [25, 25, 35, 0.25, 0.25, 0.25])


@pytest.mark.parametrize(("text", "digit"), [(GAMMA, 2e-5), (NANO17, 2e-5)])
def test_scaled_and_transformed_rows_are_atis_own(text, digit):
    """Files of version 1.0 have no UserAxis: what ATI makes of the rest is in the newer ones."""
    made = parse_calibration(without_user_axes(text), "old.cal")
    given = parse_calibration(text, "new.cal")
    # Five decimals in the file; torques of the second one in N mm.
    np.testing.assert_allclose(made.matrix, given.matrix, rtol=3e-5, atol=digit)
    np.testing.assert_allclose(made.limits, given.limits)


@pytest.mark.parametrize(
    ("old", "new", "force", "torque"),
    [
        ('"N-m"', '"N-mm"', 1.0, 1e-3),
        ('"N-m"', '"lbf-in"', 1.0, 0.1129848),
        ('"N-m"', '"in-lb"', 1.0, 0.1129848),
        ('"N-m"', '"ft-lb"', 1.0, 1.3558179),
        ('"N-m"', '"kg-cm"', 1.0, 0.0980665),
        ('ForceUnits="N"', 'ForceUnits="lbf"', 4.4482216, 1.0),
        ('ForceUnits="N"', 'ForceUnits="kN"', 1000.0, 1.0),
    ],
)
def test_units_by_name(old, new, force, torque):
    plain, other = parse_calibration(GAMMA, "a"), parse_calibration(GAMMA.replace(old, new), "b")
    factors = np.repeat([force, torque], 3)
    np.testing.assert_allclose(other.matrix, factors[:, None] * plain.matrix, rtol=1e-6)
    np.testing.assert_allclose(other.limits, factors * plain.limits, rtol=1e-6)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("FTSensor", "Sensor", "FTSensor"),
        ("</Calibration>", "", "XML"),
        ('TorqueUnits="N-m"', 'TorqueUnits="furlong"', "TorqueUnits.*furlong"),
        ('ForceUnits="N"', 'ForceUnits="stone"', "ForceUnits.*stone"),
        ('UserAxis Name="Tz"', 'UserAxis Name="Mz"', r"\['Tz'\] are missing"),
        ("-0.11562 -0.06102", "-0.06102", "Fx: expected 6 values, got 5"),
        ("-0.11562", "x", "singular"),
        ("-0.11562", "nan", "singular"),
        ('max="400"', "", "max: expected positive"),
        ('GainMultiplier="1"', 'GainMultiplier="2"', "GainMultiplier"),
    ],
)
def test_bad_files_are_refused(old, new, message):
    with pytest.raises(ConfigError, match=f"gamma.cal.*{message}"):
        parse_calibration(GAMMA.replace(old, new), "gamma.cal")


def test_rotated_transform_is_refused():
    text = without_user_axes(GAMMA).replace('Rz="0"', 'Rz="30"')
    with pytest.raises(ConfigError, match="sensor_rotation"):
        parse_calibration(text, "gamma.cal")


def test_entities_are_refused():
    bomb = '<!DOCTYPE x [<!ENTITY a "aaaa">]>' + GAMMA.replace('"FT0"', '"&a;"').strip()
    with pytest.raises(ConfigError, match="expected the XML"):
        parse_calibration(bomb, "gamma.cal")


def test_missing_file(tmp_path):
    with pytest.raises(ConfigError, match="cannot be read"):
        read_calibration(tmp_path / "none.cal")


def test_shipped_file_is_the_benchs_calibration(card):
    found = read_calibration(rig_file("sensor.cal"))
    np.testing.assert_allclose(found.matrix, card.ft_matrix)
    np.testing.assert_allclose(found.limits, [165, 165, 495, 15, 15, 15])


# Frames: a wrench is what the same forces do, seen from elsewhere.


def wrench_of(points, forces, about):
    """Moment balance, from the definition."""
    torques = np.cross(points - about, forces)
    return np.concatenate([forces.sum(axis=0), torques.sum(axis=0)])


def test_shift_is_the_moment_balance(random):
    points, forces = random.normal(size=(5, 3)), random.normal(size=(5, 3))
    a, b = random.normal(size=(2, 3))
    shifted = shift_wrench(wrench_of(points, forces, a), b - a)
    np.testing.assert_allclose(shifted, wrench_of(points, forces, b), atol=1e-12)


def test_transform_is_the_moment_balance(random):
    points, forces = random.normal(size=(5, 3)), random.normal(size=(5, 3))
    position, rotation = random.normal(size=3), Rotation.random(rng=7)
    # The same points and forces as the sensor sees them: p = position + R s.
    seen_points = rotation.inv().apply(points - position)
    seen_forces = rotation.inv().apply(forces)
    seen = wrench_of(seen_points, seen_forces, np.zeros(3))
    transform = wrench_transform(position, rotation.as_matrix())
    np.testing.assert_allclose(transform @ seen, wrench_of(points, forces, np.zeros(3)), atol=1e-12)


def test_transform_does_no_work_of_its_own(random):
    """Power is the same in both frames, whatever the motion."""
    position, rotation = random.normal(size=3), Rotation.random(rng=3).as_matrix()
    force, velocity, omega = random.normal(size=6), random.normal(size=3), random.normal(size=3)
    moved = wrench_transform(position, rotation) @ force
    # Motion of the sensor's origin, in its axes, when the platform moves so.
    at_sensor = rotation.T @ (velocity + np.cross(omega, position))
    power = force[:3] @ at_sensor + force[3:] @ (rotation.T @ omega)
    assert moved[:3] @ velocity + moved[3:] @ omega == pytest.approx(power)


def test_hand_made_case():
    """10 N along x, 0.2 m above the origin along z: 2 N m about y."""
    np.testing.assert_allclose(
        wrench_transform([0.0, 0.0, 0.2], np.eye(3)) @ [10, 0, 0, 0, 0, 0], [10, 0, 0, 0, 2, 0]
    )
    np.testing.assert_allclose(shift_wrench([10, 0, 0, 0, 0, 0], [0, 0, -0.2]), [10, 0, 0, 0, 2, 0])


def test_transform_refuses_what_is_no_pose():
    with pytest.raises(ShapeError):
        wrench_transform([0.0, 0.0], np.eye(3))
    with pytest.raises(ShapeError):
        wrench_transform([0.0, 0.0, np.nan], np.eye(3))
    with pytest.raises(ShapeError):
        wrench_transform([0.0, 0.0, 0.0], 2.0 * np.eye(3))


def test_saturated_axes_are_named():
    limits = [165, 165, 495, 15, 15, 15]
    assert saturated_axes([0, 0, 494, 0, -14.9, 0], limits) == ()
    assert saturated_axes([0, -166, 496, 0, -15.1, 0], limits) == ("Fy", "Fz", "Ty")
    assert saturated_axes([np.nan] * 6, limits) == AXES


# The tool's weight.


def test_weight_upright_and_on_its_side():
    np.testing.assert_allclose(tool_weight(2.0, [0, 0, 0.1], np.eye(3)), [0, 0, -2 * G, 0, 0, 0])
    # Turned by 90 degrees about x: the platform's y is up, its weight pulls along -y.
    np.testing.assert_allclose(
        tool_weight(2.0, [0, 0, 0.1], turned(90, 0, 0)), [0, -2 * G, 0, 0.2 * G, 0, 0], atol=1e-12
    )


def test_weight_agrees_with_its_potential_energy(random):
    """Torque is what the potential energy gives when the tool is turned a little."""
    rotation, centre, mass, angle = Rotation.random(rng=5), random.normal(size=3), 1.7, 1e-6
    weight = tool_weight(mass, centre, rotation.as_matrix())

    def energy(turn):
        return mass * G * (rotation * Rotation.from_rotvec(turn)).apply(centre)[2]

    slope = [(energy(angle * axis) - energy(-angle * axis)) / (2.0 * angle) for axis in np.eye(3)]
    np.testing.assert_allclose(weight[3:], -np.array(slope), atol=1e-7)
    assert np.linalg.norm(weight[:3]) == pytest.approx(mass * G)


def gauge_volts(matrix, bias, mass, centre, rotations):
    """What gauges show: from the definition, one point mass, point by point."""
    rows = []
    for rotation in rotations:
        pull = rotation.T @ np.array([0.0, 0.0, -mass * G])
        rows.append(bias + np.linalg.solve(matrix, np.concatenate([pull, np.cross(centre, pull)])))
    return np.array(rows)


THREE = [turned(0, 0, 0), turned(40, 0, 0), turned(0, 40, 0)]


def test_one_orientation_gives_the_bias_of_a_known_tool(card, random):
    bias, centre, rotation = random.uniform(-0.5, 0.5, 6), random.normal(size=3), turned(20, 30, 40)
    volts = gauge_volts(card.ft_matrix, bias, 3.0, centre, [rotation])[0]
    np.testing.assert_allclose(bias_at(card.ft_matrix, volts, rotation, 3.0, centre), bias)


def test_three_orientations_give_bias_mass_and_centre(card, random):
    bias, centre = random.uniform(-0.5, 0.5, 6), np.array([0.01, -0.02, 0.15])
    volts = gauge_volts(card.ft_matrix, bias, 2.5, centre, THREE)
    found = identify_tool(card.ft_matrix, volts, THREE)
    np.testing.assert_allclose(found.bias, bias, atol=1e-9)
    np.testing.assert_allclose(found.centre_of_mass, centre, atol=1e-9)
    assert found.mass == pytest.approx(2.5)
    assert found.residual < 1e-12


def test_identified_tool_predicts_other_orientations(card, random):
    """Noise of the bench's sensor, 200 samples averaged at each of eight orientations."""
    bias, centre, noise = random.uniform(-0.5, 0.5, 6), np.array([0.01, -0.02, 0.15]), 7e-5
    rotations = [turned(*angles) for angles in random.uniform(-45, 45, (8, 3))]
    volts = gauge_volts(card.ft_matrix, bias, 2.5, centre, rotations)
    found = identify_tool(card.ft_matrix, volts + noise * random.normal(size=(8, 6)), rotations)
    assert 0.5 * noise < found.residual < 2.0 * noise
    new = turned(-30, 25, 10)
    predicted = found.bias + np.linalg.solve(
        card.ft_matrix, tool_weight(found.mass, found.centre_of_mass, new)
    )
    truth = gauge_volts(card.ft_matrix, bias, 2.5, centre, [new])[0]
    np.testing.assert_allclose(predicted, truth, atol=4.0 * noise)


@pytest.mark.parametrize(
    "rotations",
    [
        [],
        THREE[:1],
        THREE[:2],
        [turned(0, 0, angle) for angle in (0, 30, 60, 90)],
        [turned(0, 0, 0), turned(0.001, 0, 0), turned(0, 0.001, 0)],
    ],
)
def test_orientations_with_too_little_information_are_refused(card, rotations):
    volts = gauge_volts(card.ft_matrix, np.zeros(6), 2.5, np.array([0, 0, 0.1]), rotations)
    with pytest.raises(OrientationsError, match="at least 3"):
        identify_tool(card.ft_matrix, volts.reshape(-1, 6), np.reshape(rotations, (-1, 3, 3)))


# Configuration.


def card_file(folder, **changes):
    import yaml

    content = yaml.safe_load(rig_file("card.yaml").read_text())
    content.update(changes)
    path = folder / "card.yaml"
    path.write_text(yaml.safe_dump({k: v for k, v in content.items() if v is not None}))
    return path


def test_calibration_file_is_found_beside_the_yaml(tmp_path, monkeypatch, card):
    (tmp_path / "sensors").mkdir()
    (tmp_path / "sensors" / "mine.cal").write_text(GAMMA.strip())
    path = card_file(
        tmp_path, ft_calibration=None, ft_calibration_file="sensors/mine.cal", wrench_limit=None
    )
    found = load_config(CardConfig, path)
    np.testing.assert_allclose(found.ft_matrix, parse_calibration(GAMMA, "").matrix)
    np.testing.assert_allclose(found.sensor_limits, [130, 130, 400, 10, 10, 10])
    # A copy with another value needs the file no more than the original: its path is absolute.
    monkeypatch.chdir("/")
    np.testing.assert_allclose(replace(found, tool_mass=1.0).ft_matrix, found.ft_matrix)
    np.testing.assert_allclose(replace(found, wrench_limit=[1.0] * 6).sensor_limits, 1.0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"ft_calibration_file": "x.cal"}, "exactly one of the two, got both"),
        ({"ft_calibration": None}, "exactly one of the two, got none"),
        ({"ft_calibration": None, "ft_calibration_file": "x.cal"}, r"x\.cal: cannot be read"),
        ({"wrench_limit": [1.0] * 5}, r"wrench_limit: expected shape \(6\)"),
        ({"wrench_limit": [1.0] * 5 + [float("nan")]}, "wrench_limit"),
        ({"wrench_limit": [1.0] * 5 + [-1.0]}, "wrench_limit"),
        ({"sensor_rotation": [[1.0, 0, 0], [0, 1, 0], [0, 0, 2]]}, "sensor_rotation"),
        ({"sensor_position": [0.0, 0.0]}, "sensor_position"),
        ({"tool_mass": -1.0}, "tool_mass"),
        ({"tool_mass": float("nan")}, "tool_mass"),
        ({"tool_centre_of_mass": [0.0]}, "tool_centre_of_mass"),
        ({"current_rate_limit": -1.0}, "current_rate_limit"),
        ({"current_rate_limit": float("nan")}, "current_rate_limit"),
        ({"wiring": {"gauges": [0, 1, 2]}}, "gauges: expected 6 channels, got 3"),
        ({"wiring": {"gauges": [0, 1, 2, 3, 4, 9]}}, "gauges: expected channels 0 to 7"),
        ({"wiring": {"motors": [0, 0, 1, 2, 3, 4, 5, 6]}}, "motors: expected each channel once"),
        ({"wiring": {"encoders": [0, 1]}}, "encoders: expected 8 channels as motors has, got 2"),
        ({"wiring": {"enables": [3]}}, r"enables: lines \[3\] are switches"),
        ({"wiring": {"enables": []}}, "enables: expected at least one line"),
        ({"wiring": {"quadrature": 3}}, "quadrature"),
        ({"wiring": {"enable": [8]}}, "enable"),
    ],
)
def test_mistakes_in_the_card_file(tmp_path, changes, message):
    with pytest.raises(ConfigError, match=message):
        load_config(CardConfig, card_file(tmp_path, **changes))
