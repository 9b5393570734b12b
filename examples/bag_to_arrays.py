"""Read a recorded run into arrays and judge how the loop followed.

Usage: bag_to_arrays.py [BAG]     (default: what `make demo` recorded)
"""

import sys

import numpy as np

from cabols_control.bags.reader import read_bag

bag = read_bag(sys.argv[1] if len(sys.argv) > 1 else "build/demo/bag")
print(f"{bag.folder}: {', '.join(f'{name} {count}' for name, count in bag.counts.items())}")

wrench, limbs = bag["wrench"], bag["limb_state"]
print("fields of limb_state:", ", ".join(limbs.fields))
force = np.column_stack([wrench[f"wrench.force.{axis}"] for axis in "xyz"])  # (k, 3) [N]
tension = limbs["tension"]  # (k, n) [N], NaN before the limbs are zeroed
print(f"{wrench.stamp[-1] - wrench.stamp[0]:.2f} s, {len(wrench)} samples of the wrench")
print(f"largest force {np.linalg.norm(force, axis=1).max():.1f} N")
print(f"tensions {np.nanmin(tension):.1f} to {np.nanmax(tension):.1f} N")

# Two topics on one time base: the desired force at the times of the measured one.
if "desired_wrench" in bag:
    desired = bag["desired_wrench"]
    wanted = np.interp(wrench.stamp, desired.stamp, desired["wrench.force.z"])
    print(f"rms of force z against the desired one: {np.std(force[:, 2] - wanted):.2f} N")
