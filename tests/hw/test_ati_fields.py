# SPDX-License-Identifier: Apache-2.0
"""What a .cal file says beyond its matrix: done, or refused, or said."""

from __future__ import annotations

import re
import warnings

import numpy as np
import pytest
import yaml

from cabols_control.configuration import load_config
from cabols_control.errors import ConfigError
from cabols_control.rig_folder import rig_file
from cabols_hw.bridge.bridge import Bridge
from cabols_hw.card.config import CardConfig
from cabols_hw.card.daq import CardSample
from cabols_hw.force_torque.ati import CalibrationWarning, parse_calibration

TEXT = rig_file("sensor.cal").read_text("utf-8")


def put(name, value):
    """The bench's file with another value of an attribute; None: without it."""
    new = "" if value is None else f'{name}="{value}"'
    changed, count = re.subn(rf'{name}="[^"]*"', new, TEXT, count=1)
    assert count == 1
    return changed


@pytest.mark.parametrize(
    ("unit", "factor"),
    [
        ("N-m", 1.0),
        ("Nm", 1.0),
        ("N m", 1.0),
        ("Newton-meters", 1.0),
        ("m-N", 1.0),
        ("Nmm", 1e-3),
        ("N-mm", 1e-3),
        ("kNm", 1e3),
        ("lbf-in", 0.11298482902762),
        ("in-lb", 0.11298482902762),
        ("lbin", 0.11298482902762),
        ("inlbf", 0.11298482902762),
        ("ft-lb", 1.3558179483314),
        ("kg-cm", 0.0980665),
        ("kgcm", 0.0980665),
    ],
)
def test_torque_units_in_their_spellings(unit, factor):
    found = parse_calibration(put("TorqueUnits", unit), "a.cal")
    plain = parse_calibration(TEXT, "plain")
    np.testing.assert_allclose(found.matrix[3:], factor * plain.matrix[3:], rtol=1e-12)
    np.testing.assert_allclose(found.limits[3:], factor * plain.limits[3:], rtol=1e-12)


@pytest.mark.parametrize("unit", ["m-m", "N", "Nmmm", "N-m-m", "", "N/m", "nNm"])
def test_no_torque_unit_is_refused(unit):
    with pytest.raises(ConfigError, match="TorqueUnits: expected"):
        parse_calibration(put("TorqueUnits", unit), "a.cal")


@pytest.mark.parametrize(
    ("unit", "factor"), [("Newtons", 1.0), ("lbs", 4.4482216152605), ("klbf", 4448.2216152605)]
)
def test_force_units_in_their_spellings(unit, factor):
    found = parse_calibration(put("ForceUnits", unit), "a.cal")
    np.testing.assert_allclose(found.matrix[:3], factor * parse_calibration(TEXT, "").matrix[:3])


@pytest.mark.parametrize("gauges", ["7", "5", "8", "six", ""])
def test_other_numbers_of_gauges_are_refused(gauges):
    with pytest.raises(ConfigError, match="NumGages: expected a sensor of 6 gauges"):
        parse_calibration(put("NumGages", gauges), "a.cal")


@pytest.mark.parametrize(
    ("span", "volts"), [("20", 9.98), ("10", 4.99), ("5", 2.495), ("40", 9.98), (None, 9.98)]
)
def test_saturation_is_judged_by_the_output_range(span, volts):
    found = parse_calibration(put("OutputRange", span), "a.cal")
    assert found.saturated_volts == pytest.approx(volts)


@pytest.mark.parametrize("span", ["0", "-20", "nan", "inf", "twenty"])
def test_no_range_is_refused(span):
    with pytest.raises(ConfigError, match="OutputRange"):
        parse_calibration(put("OutputRange", span), "a.cal")


def test_unipolar_gauges_are_refused():
    with pytest.raises(ConfigError, match="OutputBipolar: expected True"):
        parse_calibration(put("OutputBipolar", "False"), "a.cal")


@pytest.mark.parametrize("mode", ["Digital RS-485", "EtherCAT", "4-20 mA"])
def test_unknown_output_mode_is_said(mode):
    with pytest.warns(CalibrationWarning, match="OutputMode"):
        assert parse_calibration(put("OutputMode", mode), "a.cal").notes


@pytest.mark.parametrize(
    "mode", ["Differential", "Single Ended", "Ground Referenced Differential", None, ""]
)
def test_analog_outputs_are_read_without_a_word(mode):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert not parse_calibration(put("OutputMode", mode), "a.cal").notes


def with_slopes(value, text):
    slopes = f'<BiasSlope values="{value}"/><GainSlope values="0 0 0 0 0 0"/>'
    return text.replace("<BasicTransform", slopes + "<BasicTransform")


def test_temperature_that_nobody_compensates_is_said():
    for text in (
        put("HWTempComp", "False"),
        with_slopes("0 0 0 1e-3 0 0", put("HWTempComp", "False")),
        with_slopes("0 0 0 1e-3 0 0", put("HWTempComp", None)),
    ):
        with pytest.warns(CalibrationWarning, match="tare often"):
            parse_calibration(text, "a.cal")


def test_slopes_beside_compensation_by_hardware_are_not_needed():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        parse_calibration(with_slopes("0 0 0 1e-3 0 0", TEXT), "a.cal")
        parse_calibration(with_slopes("0 0 0 0 0 0", put("HWTempComp", None)), "a.cal")


def test_axis_that_stands_twice_is_refused():
    row = re.search(r'<UserAxis Name="Fx"[^>]*/>', TEXT).group()
    with pytest.raises(ConfigError, match="UserAxis Fx: expected it once"):
        parse_calibration(TEXT.replace(row, row + row.replace("16.5", "33.0")), "a.cal")


@pytest.fixture
def two():
    """A file with two calibrations of one sensor: SI-165-15 and a range of a tenth."""
    block = TEXT[TEXT.index("<Calibration") : TEXT.index("</FTSensor>")]
    other = block.replace("SI-165-15", "SI-16-1.5").replace(" 16.50000 ", " 1.65000 ")
    return TEXT.replace("</FTSensor>", other + "</FTSensor>")


def test_two_calibrations_need_a_choice(two, tmp_path):
    with pytest.raises(ConfigError, match=r"SI-165-15, SI-16-1.5\); choose by ft_calibration_part"):
        parse_calibration(two, "a.cal")
    assert parse_calibration(two, "a.cal", "SI-165-15").matrix[0, 0] == 16.5
    assert parse_calibration(two, "a.cal", "SI-16-1.5").matrix[0, 0] == 1.65
    with pytest.raises(ConfigError, match="correct ft_calibration_part"):
        parse_calibration(two, "a.cal", "SI-330-30")
    (tmp_path / "two.cal").write_text(two)
    content = yaml.safe_load(rig_file("card.yaml").read_text())
    del content["ft_calibration"]
    content |= {"ft_calibration_file": "two.cal", "ft_calibration_part": "SI-16-1.5"}
    (tmp_path / "card.yaml").write_text(yaml.safe_dump(content))
    assert load_config(CardConfig, tmp_path / "card.yaml").ft_matrix[0, 0] == 1.65


def test_bridge_judges_the_gauges_by_the_files_range(rig, tmp_path):
    (tmp_path / "half.cal").write_text(put("OutputRange", "10"))
    content = yaml.safe_load(rig_file("card.yaml").read_text())
    del content["ft_calibration"]
    (tmp_path / "card.yaml").write_text(
        yaml.safe_dump(content | {"ft_calibration_file": "half.cal"})
    )
    card = load_config(CardConfig, tmp_path / "card.yaml")
    bridge = Bridge(rig, card)
    assert bridge.saturated_volts == pytest.approx(4.99)
    for volts, saturated in ((4.9, False), (5.0, True)):
        gauges = np.array([0.0, 0.1, 0.0, 0.0, volts, 0.0])
        sample = CardSample(0, np.zeros(8, np.int64), gauges, np.full(8, True))
        bridge.take(sample, 0)
        assert ("gauge" in bridge.saturation) == saturated
