# SPDX-License-Identifier: Apache-2.0
"""Node: joint commands that compensate the robot's deflection; service correct_joints."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
from cabols_msgs.srv import CorrectJoints

from cabols_control.configuration import read_yaml
from cabols_control.errors import CabolsError, ConfigError
from cabols_control.result_code import ResultCode
from cabols_control.ros.node import ControlNode, run_node
from cabols_control.ros.parameters import declare
from cabols_stiffness.model.compensation import correct
from cabols_stiffness.model.result_file import from_mapping, tool_of
from cabols_stiffness.model.robot import load_robot


class CompensationNode(ControlNode):
    """Answers with the model of one result.yaml; the tool is the one it was identified with."""

    def __init__(self) -> None:
        """Read the result.

        Raises:
            ConfigError: if a file cannot be used.
        """
        super().__init__("compensation")
        path = declare(self, "result_file", "", "result.yaml of a stiffness campaign")
        urdf = declare(self, "robot_file", "", "URDF of the robot; empty: the bench's IRB 1600")
        frame = declare(
            self, "tool_frame", "", "link that carries the tool; empty: tool0 or flange"
        )
        if not path:
            raise ConfigError("result_file: expected the result.yaml of a campaign, got none")
        content = read_yaml(path)
        try:
            self._result = from_mapping(content)
            position, rotation = tool_of(content)
        except CabolsError as error:
            raise ConfigError(f"{path}: {error}") from error
        self._robot = load_robot(urdf, frame, position, rotation)
        self._service = self.create_service(CorrectJoints, "correct_joints", self._answer)

    def _answer(self, request: Any, response: Any) -> Any:
        try:
            drives = self._robot.drives(np.asarray(request.joints))
            found = correct(self._result, self._robot, drives, request.wrench)
        except CabolsError as error:
            response.code, response.message = int(ResultCode.BAD_REQUEST), str(error)
            return response
        response.success, response.code = True, int(ResultCode.DONE)
        response.deflection = found.prediction.deflection
        response.covariance = found.prediction.covariance.ravel()
        response.joints = self._robot.joints_of(found.joints)
        return response


def main() -> int:
    """Run the node."""
    return run_node(CompensationNode)


if __name__ == "__main__":
    sys.exit(main())
