# SPDX-License-Identifier: Apache-2.0
"""A simulated UR controller as a process; it ends with its standard input.

Argument: TCP port of RTDE. Prints the encoders [rad] once, when they have a value.
"""

from __future__ import annotations

import json
import sys

from abb_harness import running_ur_controller


def main():
    with running_ur_controller(rtde_port=int(sys.argv[1])) as (clock, controller):
        print(json.dumps(clock.robot.encoders.tolist()), flush=True)
        for line in sys.stdin:
            if line.strip() == "registers":
                program = controller.program
                answer = [list(program.inputs.values()), list(program.outputs.values())]
            else:
                answer = clock.robot.encoders.tolist()
            print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    main()
