"""Choose the tensions of eight cables that give a wrench, and see when no tensions do."""

import numpy as np

from cabols_control.geometry import load_geometry
from cabols_control.kinematics import cable_lengths, structure_matrix
from cabols_control.tension import distribute

TENSION_MIN_N, TENSION_MAX_N = 1.0, 150.0

geometry = load_geometry()
pose = (geometry.reference_position, geometry.reference_rotation)
print("cable lengths [m]:", np.round(cable_lengths(geometry, *pose), 3))

# Rows of A: force x, y, z, torque x, y, z, on the platform at its origin, in base axes.
A = structure_matrix(geometry, *pose)
for force_z_n in (40.0, 400.0):
    wrench = np.array([0.0, 0.0, force_z_n, 0.0, 0.0, 3.0])
    solution = distribute(A, wrench, TENSION_MIN_N, TENSION_MAX_N)
    print(f"\n{force_z_n:.0f} N up and 3 N m about z: feasible {solution.feasible}")
    print("  tensions [N]:", np.round(solution.tension, 2))
    print("  missing [N, N m]:", np.round(wrench - A @ solution.tension, 2))
