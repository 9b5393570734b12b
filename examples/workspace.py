"""Where the bench can give a box of wrenches, and how much is left there."""

import numpy as np

from cabols_control.geometry import load_geometry
from cabols_control.workspace.capacity import capacity_along
from cabols_control.workspace.grid import box_grid
from cabols_control.workspace.wrench_set import wrench_box

FORCE_N, TORQUE_NM = 60.0, 6.0

geometry = load_geometry()
grid = box_grid(geometry.reference_position, (0.5, 0.5, 0.5), (11, 11, 11))
upright = np.broadcast_to(geometry.reference_rotation, (grid.poses, 3, 3))
box = wrench_box([FORCE_N] * 3 + [TORQUE_NM] * 3)
found = capacity_along(geometry, grid.positions, upright, 1.0, 150.0, box)

best = int(np.argmax(found.margin))
litres = 1000.0 * grid.cell_volume * found.feasible.sum()
print(f"box of +-{FORCE_N:.0f} N, +-{TORQUE_NM:.0f} N m at {grid.poses} positions, upright")
print(f"feasible at {found.feasible.sum()} of them: about {litres:.0f} l")
print(f"largest margin {found.margin[best]:.1f} N at {grid.positions[best].round(3)} m,")
print(f"where the box could be {found.factor[best]:.2f} times as large")
