# SPDX-License-Identifier: Apache-2.0
"""Launch the controllers and the bridge to the hardware.

ros2 launch cabols_hw rig.launch.py geometry_file:=/path/to/geometry.yaml
"""

from launch.actions import OpaqueFunction

from cabols_control.bringup.graph import PARTS, rig_graph
from cabols_control.bringup.launching import argument_values, arguments, launch_nodes
from cabols_control.parameters.file import complete
from launch import Action, LaunchContext, LaunchDescription


def start(context: LaunchContext) -> list[Action]:
    """Make the nodes once the arguments are known."""
    values, given = argument_values(context, "rig")
    graph = rig_graph(**{part: values[part] for part in PARTS.values()})
    return launch_nodes(complete(graph, values, given), context)


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments and start the graph."""
    return LaunchDescription([*arguments("rig"), OpaqueFunction(function=start)])
