# SPDX-License-Identifier: Apache-2.0
"""What people read of a finding."""

from __future__ import annotations

from cabols_stiffness.model.verdict import Suspect

TEXTS = {
    Suspect.NOISE: "residuals are {:.2f} times the stated noise, and no known cause explains it; "
    "state the noise as it is, or look for an effect that the model leaves out",
    Suspect.CONFIGURATIONS: "stiffness differs between configurations by up to {percent:.1f} % "
    "(standard deviation); pooled intervals and predictions hold this scatter",
    Suspect.SCATTER: "stiffness differs between configurations by up to {percent:.0f} % (standard "
    "deviation), as no robot's does; look for joints in another order, a wrong zero, or loads that "
    "belong to another configuration",
    Suspect.TOOL_POINT: "the tool point seems to be elsewhere than stated",
    Suspect.WRENCH_POINT: "the wrench seems to be measured about another point than the tool's",
    Suspect.BASE_FRAME: "the tracker's frame seems to be turned against the robot's base",
    Suspect.WRENCH_FRAME: "the wrench's axes seem to be turned against those stated",
    Suspect.WRENCH_GAIN: "the sensor's axes seem to have different gains",
    Suspect.WRENCH_BIAS: "the loads' wrench seems to have a bias that the unloaded rows have not",
    Suspect.WEIGHT: "the loads' wrench seems to hold a weight that the unloaded rows have not (a "
    "payload or a tool that was not tared)",
    Suspect.JOINT_ZERO: "the zero of a joint seems to be a little off",
    Suspect.COUPLING: "joints deflect under each other's torque (a parallelogram, a coupled wrist)",
    Suspect.BASE: "the robot's base gives way",
    Suspect.BEARINGS: "bearings or links give way across the joints' axes",
    Suspect.CUBIC: "joints stiffen or soften with their torque; try the cubic model",
    Suspect.PLAY: "joints have play or friction",
    Suspect.VARYING: "stiffness varies with the joint's own angle (a balancer)",
    Suspect.CREEP: "the reflector creeps within each pass (temperature, a base that settles)",
    Suspect.FRICTION: "a joint's friction rises over most of its motion and takes {percent:.0f} % "
    "of its torque, so that nothing tells it from stiffness; load farther, up and down, in more "
    "steps",
    Suspect.MAGNITUDE: "the joints' median stiffness is {:.3g} N m/rad, which no robot has; check "
    "the units of force, torque and position",
}
WITH_A_NUMBER = frozenset(
    {Suspect.NOISE, Suspect.CONFIGURATIONS, Suspect.SCATTER, Suspect.MAGNITUDE}
)
"""Those whose text holds the number itself; the others' is a change of stiffness."""
HARM = "; taken into account, it changes a joint's stiffness by {percent:.1f} %"
BEYOND = "; taken into account, it changes a joint's stiffness more than tenfold"
MOST_PERCENT = 1000.0


def text_of(suspect: Suspect, value: float) -> str:
    """Sentence about a suspect.

    Args:
        suspect: what.
        value: the number that its sentence holds; relative change of stiffness for most.
    """
    percent = 100.0 * value
    text = TEXTS[suspect]
    if suspect not in WITH_A_NUMBER:
        text += HARM if percent <= MOST_PERCENT else BEYOND
    return text.format(value, percent=percent)
