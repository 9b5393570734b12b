# SPDX-License-Identifier: Apache-2.0
"""Variants of the bench's own .cal file.

Source: NavidFeizi/ATI-FTsensor_NI-DAQ (lib_ati: ftconfig.c, ftrt.c). What a file says and is not
done must be refused or said; units that ATI's own library takes must be taken.
"""

from __future__ import annotations

import re
import warnings

import numpy as np
import pytest

from cabols_control.errors import CabolsError
from cabols_control.rig_folder import rig_file
from cabols_hw.force_torque.ati import parse_calibration
from cases import outcome

TEXT = rig_file("sensor.cal").read_text("utf-8")
SLOPES = (
    '<BiasSlope values="0.0012 -0.0007 0.0003 0.0011 -0.0004 0.0009"/>\n'
    '<GainSlope values="3e-4 3e-4 3e-4 3e-4 3e-4 3e-4"/>\n<Thermistor value="2.8"/>\n'
)


def with_attribute(name, value):
    changed = re.sub(rf'{name}="[^"]*"', f'{name}="{value}"', TEXT)
    assert changed != TEXT
    return changed


def read(text):
    """The calibration or the error, and the warnings beside it."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        return outcome(lambda: parse_calibration(text, "variant")), said


def test_file_as_it_is_reads_without_a_word():
    found, said = read(TEXT)
    assert found.matrix.shape == (6, 6)
    assert not said


@pytest.mark.parametrize(
    "text",
    [
        with_attribute("HWTempComp", "False").replace(
            "<BasicTransform", SLOPES + "<BasicTransform"
        ),
        with_attribute("NumGages", "7"),
    ],
    ids=["temperature compensation in software", "seven gauges"],
)
def test_what_is_not_done_is_refused_or_said(text):
    found, said = read(text)
    assert isinstance(found, CabolsError) or said


@pytest.mark.parametrize(("unit", "factor"), [("Nm", 1.0), ("Nmm", 1e-3), ("kNm", 1e3)])
def test_units_of_torque_are_taken(unit, factor):
    found, _ = read(with_attribute("TorqueUnits", unit))
    assert not isinstance(found, Exception), found
    as_it_is = parse_calibration(TEXT, "in N-m")
    np.testing.assert_allclose(found.matrix[:3], as_it_is.matrix[:3])
    np.testing.assert_allclose(found.matrix[3:], factor * as_it_is.matrix[3:])
