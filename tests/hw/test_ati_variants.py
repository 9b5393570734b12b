# SPDX-License-Identifier: Apache-2.0
"""Two hundred variants of a .cal file: read as it says, refused, or said; nothing else escapes."""

from __future__ import annotations

import re
import warnings

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from cabols_control.errors import ConfigError
from cabols_control.rig_folder import rig_file
from cabols_hw.force_torque.ati import parse_calibration
from cases import outcome

TEXT = rig_file("sensor.cal").read_text("utf-8")
PLAIN = parse_calibration(TEXT, "plain")
WORDS = st.text("NmkglbfincftT- 0123456789.eE+", max_size=8)
GIVEN = {
    "NumGages": st.sampled_from(["6", "6.0", "7", "5", ""]) | WORDS,
    "ForceUnits": st.sampled_from(["N", "kN", "lbf", "lb", "kg", "Newtons"]) | WORDS,
    "TorqueUnits": st.sampled_from(["Nm", "N-mm", "kNm", "in-lb", "lbfft", "kg-cm"]) | WORDS,
    "OutputRange": st.sampled_from(["20", "10", "5"]) | WORDS,
    "OutputBipolar": st.sampled_from(["True", "False", "true"]) | WORDS,
    "OutputMode": st.sampled_from(["Differential", "Single Ended", "EtherCAT"]) | WORDS,
    "HWTempComp": st.sampled_from(["True", "False"]) | WORDS,
    "GainMultiplier": st.sampled_from(["1", "1.0", "2"]) | WORDS,
}


@settings(max_examples=200, derandomize=True)
@given(changes=st.fixed_dictionaries({}, optional=GIVEN))
def test_attributes_of_any_text(changes):
    text = TEXT
    for name, value in changes.items():
        text = re.sub(rf'{name}="[^"]*"', f'{name}="{value}"', text, count=1)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        try:
            found = parse_calibration(text, "variant.cal")
        except ConfigError:
            return
    force = found.matrix[:3] / PLAIN.matrix[:3]
    torque = found.matrix[3:] / PLAIN.matrix[3:]
    np.testing.assert_allclose(force, force[0, 0])
    np.testing.assert_allclose(torque, torque[0, 0])
    if "ForceUnits" not in changes:
        assert force[0, 0] == 1.0
    if "TorqueUnits" not in changes:
        assert torque[0, 0] == 1.0
    assert 0.0 < found.saturated_volts <= 9.98
    for name, value in changes.items():
        plain = {"True", "true", "1", "yes", "", "Differential", "Single Ended"}
        if name in ("HWTempComp", "OutputMode") and value.strip() not in plain:
            assert said, (name, value)


@settings(max_examples=200, derandomize=True)
@given(start=st.integers(0, len(TEXT)), size=st.integers(0, 40), new=st.binary(max_size=20))
def test_damage_anywhere(start, size, new):
    raw = TEXT.encode()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = outcome(
            lambda: parse_calibration(raw[:start] + new + raw[start + size :], "variant.cal")
        )
    if isinstance(found, Exception):
        assert isinstance(found, ConfigError)
        assert "variant.cal" in str(found)
