"""Joint stiffness of robots from the deflections under measured wrenches."""

from cabols_stiffness.identification.identify import identify
from cabols_stiffness.measurements.samples import PointSamples, Samples
from cabols_stiffness.model.result import StiffnessResult
from cabols_stiffness.model.robot import RobotModel, load_robot

__all__ = ["PointSamples", "RobotModel", "Samples", "StiffnessResult", "identify", "load_robot"]
