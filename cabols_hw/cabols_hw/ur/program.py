# SPDX-License-Identifier: Apache-2.0
"""The robot's program in URScript, made from the rig's stored configurations."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from cabols_control.command_line import DONE, CommandParser, command, rig_option
from cabols_hw.abb.configurations import RobotConfigurations, load_configurations
from cabols_hw.ur.handshake import FIRST, ProgramError

SPEED, ACCELERATION = 0.3, 0.5
"""Of the joints [rad/s, rad/s^2]; the rig's speed limit is lower or the same."""


def program_text(configurations: RobotConfigurations) -> str:
    """URScript that obeys the registers of handshake.py.

    A thread watches the stop register, and the controller's own RTDE watchdog stops the program
    when the rig is silent for 0.1 s.

    Args:
        configurations: that are stored.
    """
    target, request, stop, beat = (FIRST + k for k in range(4))
    accepted, finished, error, stopped = (FIRST + k for k in range(4))
    rows = []
    for index in range(len(configurations)):
        angles = ", ".join(f"{angle:.9f}" for angle in configurations.joints(index))
        rows.append(f"    if index == {index}: return [{angles}] end")
    lines = [
        "def cabols():",
        f'  rtde_set_watchdog("input_int_register_{beat}", 10, "stop")',
        "  global moving = False",
        "  def place(index):",
        *(row.replace(": return", ":\n      return").replace(" end", "\n    end") for row in rows),
        "    return get_actual_joint_positions()",
        "  end",
        "  thread motion():",
        f"    movej(goal, a={ACCELERATION}, v={SPEED})",
        "    moving = False",
        "  end",
        f"  seen = read_input_integer_register({request})",
        f"  halted = read_input_integer_register({stop})",
        f"  write_output_integer_register({finished}, seen)",
        f"  write_output_integer_register({stopped}, halted)",
        "  while True:",
        f"    wanted = read_input_integer_register({request})",
        f"    halt = read_input_integer_register({stop})",
        "    if halt != halted:",
        "      if moving:",
        "        kill task",
        "        stopj(2.0)",
        "        moving = False",
        f"        write_output_integer_register({error}, {int(ProgramError.STOPPED)})",
        f"        write_output_integer_register({finished}, seen)",
        "      end",
        "      halted = halt",
        f"      write_output_integer_register({stopped}, halted)",
        "    elif wanted != seen and not moving:",
        "      seen = wanted",
        f"      index = read_input_integer_register({target})",
        f"      write_output_integer_register({accepted}, seen)",
        f"      if index < 0 or index >= {len(configurations)}:",
        f"        write_output_integer_register({error}, {int(ProgramError.NO_CONFIGURATION)})",
        f"        write_output_integer_register({finished}, seen)",
        "      else:",
        "        global goal = place(index)",
        "        moving = True",
        "        task = run motion()",
        f"        while moving and read_input_integer_register({stop}) == halted:",
        "          sync()",
        "        end",
        "        if not moving:",
        f"          write_output_integer_register({error}, {int(ProgramError.NONE)})",
        f"          write_output_integer_register({finished}, seen)",
        "        end",
        "      end",
        "    end",
        "    sync()",
        "  end",
        "end",
    ]
    return "\n".join([*lines, ""])


@command
def main(arguments: Sequence[str] | None = None) -> int:
    """Print the program of a rig; returns 0, or 2 for a wrong command line."""
    parser = CommandParser("program", "Print the robot's program, for a controller of UR.")
    rig_option(parser)
    options = parser.parse_args(arguments)
    print(program_text(load_configurations(options.rig)), end="")
    return DONE


if __name__ == "__main__":
    sys.exit(main())
