"""Drive a running rig from a script: pre-tighten, load, read, stop.

Usage: rig_client.py [SPEED]     beside `make console`, for example, or any other running rig;
                                 SPEED below 1 for a simulated rig in slow motion
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

from cabols_control.ros.rig_client import RefusedError, RigClient
from cabols_control.supervision.modes import OperatingMode

PROGRAMME = """\
time_s,fx_n,fy_n,fz_n,mx_nm,my_nm,mz_nm
0,0,0,0,0,0,0
1,0,0,30,0,0,2
2,0,0,0,0,0,0
"""

with RigClient(speed=float(sys.argv[1]) if len(sys.argv) > 1 else 1.0) as rig:
    rig.wait_running()
    try:
        rig.enter(OperatingMode.LOADING, timeout_s=1.0)
    except RefusedError as error:
        print(f"refused, as the limbs have no zero yet: {error}")
    rig.pretighten()
    print("pre-tightened, tensions [N]:", np.round(rig.newest("limb_state").tension, 1))
    rig.enter(OperatingMode.LOADING)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "up_and_down.csv"
        file.write_text(PROGRAMME)
        rig.run_program(str(file))
    force = rig.newest("wrench").wrench.force
    print(f"after the programme: {np.hypot(np.hypot(force.x, force.y), force.z):.2f} N left")
    rig.enter(OperatingMode.STOPPED)
    print(f"mode: {rig.mode.name}")
