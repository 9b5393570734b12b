"""Identify a robot's joint stiffness from deflections under known wrenches."""

import numpy as np
from scipy.spatial.transform import Rotation

from cabols_stiffness import Samples, identify, load_robot

TRUE = np.array([9.7e5, 7.3e5, 3.2e5, 1.3e4, 7.7e3, 2.1e3])  # [N m/rad]
NOISE = np.array([5e-6] * 3 + [20e-6] * 3)  # of a measured deflection [m, rad]
POSTURE_RAD = np.radians([90.0, 20.0, 10.0, 15.0, -40.0, 10.0])
LARGEST = np.array([100.0] * 3 + [10.0] * 3)  # wrench [N, N m]


def measured(robot, count=100, seed=1):
    """Deflections of a robot whose joints give way, as a tracker measures them, with noise."""
    random = np.random.default_rng(seed)
    joints = POSTURE_RAD + random.uniform(-0.4, 0.4, (count, 6))
    wrench = LARGEST * random.uniform(-1.0, 1.0, (count, 6))
    deflection = np.empty((count, 6))
    for k in range(count):
        turn = np.zeros(6)
        for _ in range(20):  # balance: the torque counts at the deflected joints
            turn = robot.jacobian(joints[k] + turn).T @ wrench[k] / TRUE
        (p, R), (p_loaded, R_loaded) = robot.forward(joints[k]), robot.forward(joints[k] + turn)
        deflection[k] = *(p_loaded - p), *Rotation.from_matrix(R_loaded @ R.T).as_rotvec()
    deflection += NOISE * random.standard_normal((count, 6))
    numbers, loading = np.arange(count), np.ones(count, dtype=int)
    noise = np.tile(np.diag(NOISE**2), (count, 1, 1))
    sensor = np.tile(np.diag((1e-4 * LARGEST) ** 2), (count, 1, 1))
    return Samples(numbers, numbers, loading, joints, wrench, sensor, deflection, noise)


if __name__ == "__main__":
    robot = load_robot()
    result = identify(measured(robot), robot)
    print("joint, true and found stiffness [N m/rad] with the half of its 95 % interval, error")
    for number, (true, found) in enumerate(zip(TRUE, result.stiffness, strict=True), start=1):
        half = np.ptp(result.interval[number - 1]) / 2.0
        error = 100.0 * (found / true - 1.0)
        print(f"{number} {true:10.0f} {found:10.0f} +- {half:6.0f}  {error:+.2f} %")
