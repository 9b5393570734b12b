# SPDX-License-Identifier: Apache-2.0
"""Launch the simulated bench: the same table of nodes and the same time-outs as `make demo`.

ros2 launch cabols_sim bench.launch.py program:=steps auto_start:=true output:=bags/my_run
"""

from launch.actions import OpaqueFunction

from cabols_control.bringup.graph import PARTS
from cabols_control.bringup.launching import argument_values, arguments, launch_nodes
from cabols_control.parameters.file import complete
from cabols_sim.bench.run import forgiving, free_ports, launched
from cabols_sim.bringup_nodes import bench_graph
from launch import Action, LaunchContext, LaunchDescription


def start(context: LaunchContext) -> list[Action]:
    """Make the nodes once the arguments are known."""
    values, given = argument_values(context, "bench", forgiving())
    values = launched(values, given)
    graph = bench_graph(
        values["lockstep"],
        robot=values["robot"],
        ports=free_ports(),
        **{part: values[part] for part in PARTS.values()},
    )
    return launch_nodes(complete(graph, values, given), context)


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments and start the graph."""
    return LaunchDescription([*arguments("bench", forgiving()), OpaqueFunction(function=start)])
