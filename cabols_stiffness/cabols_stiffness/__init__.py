"""Joint stiffness of robots from the deflections under measured wrenches."""

from cabols_stiffness.identification import identify
from cabols_stiffness.result import StiffnessResult
from cabols_stiffness.robot import RobotModel, load_robot
from cabols_stiffness.samples import PointSamples, Samples

__all__ = ["PointSamples", "RobotModel", "Samples", "StiffnessResult", "identify", "load_robot"]
