# SPDX-License-Identifier: Apache-2.0
"""What ROS cannot obey is one sentence, and no traceback out of rclpy."""

from __future__ import annotations

import pytest
from rclpy.context import Context

from cabols_control.errors import ConfigError
from cabols_control.ros.messages import transport


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["-r", "__ns:=/2rig"], "__ns:=/2rig"),
        (["-r", "__ns:=rig"], "__ns:=rig"),
        (["-r", "__node:=2nd"], "__node:=2nd"),
        (["-r", "a:="], "a:="),
        (["-p", "scale"], "scale"),
        (["--log-level", "loud"], "loud"),
        (["--params-file", "none.yaml"], "none.yaml"),
    ],
)
def test_wrong_words_for_ros(words, said, monkeypatch):
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    with pytest.raises(ConfigError, match=f"Couldn't parse.*{said}") as caught:
        transport.init(args=["node", "--ros-args", *words], context=Context())
    assert "/src/rcl" not in str(caught.value)


@pytest.mark.parametrize("text", ["300", "-1", "abc"])
def test_wrong_domain(text, monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", text)
    with pytest.raises(ConfigError, match="ROS_DOMAIN_ID: expected a whole number"):
        transport.init(args=[], context=Context())
