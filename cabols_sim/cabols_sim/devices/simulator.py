# SPDX-License-Identifier: Apache-2.0
"""Executable device_simulator: ABB controller and laser tracker, in a process of their own.

Their Python threads would disturb the plant's loop; they get its truth over a loopback link.
"""

from __future__ import annotations

import argparse
import json
import sys
import threading
from collections.abc import Sequence
from dataclasses import replace

from cabols_control import end_signals
from cabols_control.bringup.launcher_watch import LauncherWatch
from cabols_control.command_line import CommandParser, command, existing_file, rig_option
from cabols_control.errors import CabolsError
from cabols_control.realtime.scheduling import Scheduling, apply_scheduling, freeze_garbage
from cabols_hw.abb.configurations import load_configurations
from cabols_hw.abb.heartbeat import SILENCE_S
from cabols_sim.devices.abb.controller import PASSWORD, USER, AbbController
from cabols_sim.devices.abb.egm_server import DEFAULT_EGM_PORT
from cabols_sim.devices.link import DEFAULT_LINK_PORT, DeviceLink
from cabols_sim.devices.robot.kinematics import load_arm
from cabols_sim.devices.tracker.config import TrackerTruthConfig, load_tracker_truth
from cabols_sim.devices.tracker.server import TrackerServer
from cabols_sim.devices.ur.controller import UrController

DEFAULT_RWS_PORT = 6580
DEFAULT_WATCH_PORT = 6512
DEFAULT_TRACKER_PORT = 6590
LOOK_S = 0.5
"""How often it looks after its launcher [s]."""
LAST_S = 5.0
"""Time that nodes have to unload when their launcher has died [s]."""


def _arguments(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = CommandParser("device_simulator", __doc__)
    add = parser.add_argument
    add("--link-port", type=int, default=DEFAULT_LINK_PORT, help="UDP port of the plant")
    add("--egm-port", type=int, default=DEFAULT_EGM_PORT, help="UDP port that EGM is sent to")
    add("--robot_maker", choices=("abb", "ur"), default="abb", help="ur: RTDE on the RWS port")
    add("--rws-port", type=int, default=DEFAULT_RWS_PORT, help="TCP port of RWS; 0: any")
    add(
        "--rws-version",
        "--rws_version",
        type=int,
        choices=(1, 2),
        default=1,
        help="1: IRC5, 2: OmniCore",
    )
    add(
        "--rws-certificate",
        type=existing_file,
        default="",
        help="PEM file with certificate and key, for https; empty: http",
    )
    add("--watch-port", type=int, default=DEFAULT_WATCH_PORT, help="of the heartbeat; 0: any")
    add("--robot_watch", type=float, default=SILENCE_S, help="s, silence that stops the robot")
    add("--tracker-port", type=int, default=DEFAULT_TRACKER_PORT, help="0: any")
    add("--no-tracker", action="store_true", help="robot only")
    rig_option(parser)
    add(
        "--configurations",
        type=existing_file,
        default="",
        help="YAML of the stored configurations",
    )
    add(
        "--tracker-file",
        type=existing_file,
        default="",
        help="YAML of the simulated tracker",
    )
    add("--user", default=USER, help="of RWS")
    add("--password", default=PASSWORD, help="of RWS")
    add("--cpu", type=int, default=-1, help="core to run on; -1: any")
    add("--fifo_priority", type=int, default=0, help="SCHED_FIFO priority; 0: none")
    add("--seed", type=int, default=0, help="of lost packets; added to that of the tracker's file")
    given = list(sys.argv[1:] if arguments is None else arguments)
    # `ros2 launch` adds arguments for a node, which this is not.
    return parser.parse_args(given[: given.index("--ros-args")] if "--ros-args" in given else given)


def _tracker(link: DeviceLink, options: argparse.Namespace) -> TrackerServer | None:
    """Return the tracker's server, or None where it is not wanted."""
    if options.no_tracker:
        return None
    return TrackerServer(link, tracker_truth(options), options.tracker_port)


def tracker_truth(options: argparse.Namespace) -> TrackerTruthConfig:
    """The simulated tracker; the seed of the command line is added to that of its file."""
    truth = load_tracker_truth(options.rig, options.tracker_file)
    return replace(truth, seed=truth.seed + int(options.seed))


def _controller(link: DeviceLink, options: argparse.Namespace) -> AbbController | UrController:
    """The robot's controller, of the maker that is named."""
    stored = load_configurations(options.rig, options.configurations)
    if options.robot_maker == "ur":
        return UrController(link, stored, options.rws_port, load_arm(options.rig))
    return AbbController(
        link,
        stored,
        options.egm_port,
        options.rws_port,
        options.user,
        options.password,
        options.seed,
        load_arm(options.rig),
        options.rws_version,
        str(options.rws_certificate),
        options.watch_port,
        options.robot_watch,
    )


def _ports(controller: AbbController | UrController, options: argparse.Namespace) -> dict[str, int]:
    """Ports on which the controller is reached."""
    if isinstance(controller, UrController):
        return {"rtde": controller.rtde.port}
    found = {"egm": options.egm_port, "rws": controller.rws.port}
    if controller.watch is not None:
        found["watch"] = controller.watch.port
    return found


def _wait_for_end(ended: threading.Event) -> None:
    """Serve until a signal comes, or the launcher is dead and the nodes have had time to unload."""
    launcher = LauncherWatch()
    while not ended.wait(LOOK_S):
        if launcher.is_dead:
            ended.wait(LAST_S)
            return


@command
def main(arguments: Sequence[str] | None = None) -> int:
    """Serve until SIGINT or SIGTERM."""
    options = _arguments(arguments)
    ended = threading.Event()
    end_signals.handle(lambda *_: ended.set())
    link = DeviceLink(options.link_port)
    try:
        controller = _controller(link, options)
        tracker = _tracker(link, options)
    except CabolsError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    link.start()
    controller.start()
    ports = {"link": options.link_port, **_ports(controller, options)}
    if tracker is not None:
        ports["tracker"] = tracker.start()
    freeze_garbage(goes_on=True)
    # Not before: the start takes a second of a core, which nodes that run already need.
    scheduling = Scheduling(fifo_priority=options.fifo_priority, cpu=options.cpu)
    apply_scheduling(scheduling, lambda text: print(f"warning: {text}", file=sys.stderr))
    print("ready " + json.dumps(ports), flush=True)
    _wait_for_end(ended)
    if tracker is not None:
        tracker.stop()
    controller.stop()
    link.stop()
    end_signals.ignore()
    return 0


if __name__ == "__main__":
    sys.exit(main())
