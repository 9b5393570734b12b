"""Command a robot so that it stands where it should although a load bends it."""

import numpy as np
from identify import POSTURE_RAD, TRUE, measured

from cabols_stiffness import identify, load_robot
from cabols_stiffness.model.compensation import correct
from cabols_stiffness.model.prediction import predict

robot = load_robot()
result = identify(measured(robot), robot)
wrench = np.array([80.0, -40.0, -100.0, 4.0, 0.0, 2.0])  # on the tool, base axes [N, N m]


def place(command):
    """Where the loaded robot's tool really is [m], by the true stiffness."""
    turn = np.zeros(6)
    for _ in range(20):
        turn = robot.jacobian(command + turn).T @ wrench / TRUE
    return robot.forward(command + turn)[0]


wanted = robot.forward(POSTURE_RAD)[0]
expected = predict(result, robot, POSTURE_RAD, wrench)
correction = correct(result, robot, POSTURE_RAD, wrench)
before = 1e6 * np.linalg.norm(place(POSTURE_RAD) - wanted)
after = 1e6 * np.linalg.norm(place(correction.joints) - wanted)
sigma = 1e6 * np.sqrt(np.trace(expected.covariance[:3, :3]))
moves = 1e6 * np.linalg.norm(expected.deflection[:3])
print(f"predicted deflection: {moves:.0f} um +- {sigma:.1f} um")
print(f"off without correction: {before:.0f} um")
print(f"off with it:            {after:.1f} um")
print("command changes by [mrad]:", np.round(1e3 * (correction.joints - POSTURE_RAD), 3))
