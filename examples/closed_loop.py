"""Run the control loop on the simulated rig, without ROS, hundreds of times faster than real time.

Usage: closed_loop.py [FIGURE.png]
"""

import sys

import numpy as np

from cabols_control.rig import load_rig
from cabols_hw.card.config import load_card
from cabols_sim.plant.closed_loop import simulate
from cabols_sim.plant.config import load_plant

rig, card, plant = load_rig(), load_card(), load_plant()
setpoint = np.zeros((3000, 6))  # one row for each millisecond
setpoint[500:, 2], setpoint[500:, 5] = 40.0, 3.0  # 40 N up, 3 N m about z
trace = simulate(rig, card, plant, setpoint, seed=1)

force = trace.wrench[:, 2]
rise_s = np.interp([4.0, 36.0], force[500:1500], trace.time[500:1500])
print(f"rise time of the force (10 to 90 %): {np.diff(rise_s)[0]:.3f} s")
print(
    f"steady: {force[-500:].mean():.2f} N of 40 N, {trace.wrench[-500:, 5].mean():.3f} N m of 3 N m"
)
print(f"tensions: {trace.tension[500:].min():.1f} to {trace.tension.max():.1f} N")
print(f"largest current: {np.abs(trace.current).max():.2f} A")

if len(sys.argv) > 1:
    import matplotlib.pyplot as plt

    plt.plot(trace.time, setpoint[:, 2], "--", trace.time, force)
    plt.xlabel("time [s]"), plt.ylabel("force along z [N]")
    plt.savefig(sys.argv[1], dpi=100)
