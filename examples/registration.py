"""Find the platform's pose, with its uncertainty, from three measured reflectors."""

import numpy as np
from scipy.spatial.transform import Rotation

from cabols_control.registration.reflectors import register_pose

REFLECTORS_M = np.array([[0.14, 0.0, 0.05], [-0.07, 0.12, 0.05], [-0.07, -0.12, -0.02]])
RADIAL_M, TRANSVERSE_M = 10e-6, 25e-6  # a laser tracker measures distances better than angles

random = np.random.default_rng(1)
position, rotation = (
    np.array([0.3, 3.2, 0.1]),
    Rotation.from_euler("xyz", [5, -8, 20], degrees=True),
)
true = position + rotation.apply(REFLECTORS_M)
beams = true / np.linalg.norm(true, axis=1, keepdims=True)
along = beams[:, :, None] * beams[:, None, :]
covariances = RADIAL_M**2 * along + TRANSVERSE_M**2 * (np.eye(3) - along)
measured = np.array(
    [random.multivariate_normal(p, c) for p, c in zip(true, covariances, strict=True)]
)

pose = register_pose(REFLECTORS_M, measured, covariances)
sigma = np.sqrt(np.diag(pose.covariance))
error_m = pose.position - position
error_rad = (Rotation.from_matrix(pose.rotation) * rotation.inv()).as_rotvec()
print("position [m]:", pose.position.round(6))
print("  standard deviation [um]:", (1e6 * sigma[:3]).round(1), " error:", (1e6 * error_m).round(1))
print(
    "  rotation's [urad]:      ", (1e6 * sigma[3:]).round(0), " error:", (1e6 * error_rad).round(0)
)
print(
    f"chi-square {pose.chi_square:.2f} with {pose.degrees_of_freedom} degrees of freedom, "
    f"probability {pose.probability:.2f}"
)
