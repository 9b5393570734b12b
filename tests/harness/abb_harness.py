# SPDX-License-Identifier: Apache-2.0
"""A robot, its controller and a plant that does nothing but let time pass, in one process."""

from __future__ import annotations

import threading
import time
from contextlib import contextmanager

import numpy as np

from cabols_control.bringup.free_domains import claim_domain
from cabols_hw.abb.configurations import load_configurations
from cabols_sim.bench.run import ports_of
from cabols_sim.devices.abb.controller import AbbController
from cabols_sim.devices.link import DeviceLink, PlantLink
from cabols_sim.devices.robot.coupling import RobotCoupling
from cabols_sim.devices.robot.robot_config import RobotConfig
from cabols_sim.devices.robot.robot_target import RobotTarget
from cabols_sim.devices.ur.controller import UrController

STIFFNESS = [966398.0, 731208.0, 317900.0, 13277.0, 7744.0, 2141.0]
QUICK = RobotConfig(STIFFNESS, speed=0.25, joint_speed=3.0, joint_acceleration=50.0)
PATIENCE_S = 100.0


def wait_until(condition, what: str) -> None:
    give_up = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < give_up, f"{what}: not within {PATIENCE_S:g} s"
        time.sleep(0.002)


class PlantClock(threading.Thread):
    """Steps the robot by milliseconds, quicker than the wall clock."""

    def __init__(self, wrench=None) -> None:
        super().__init__(daemon=True)
        self.robot = RobotTarget(QUICK)
        self.link = PlantLink(0)
        self.coupling = RobotCoupling(self.robot, self.link)
        self.wrench = np.zeros(6) if wrench is None else np.asarray(wrench, dtype=float)
        self.held = threading.Event()
        self._ended = threading.Event()

    def run(self) -> None:
        sequence = 0
        while not self._ended.is_set():
            if not self.held.is_set():
                for _ in range(4):
                    sequence += 1
                    self.robot.step(self.wrench, 0.001)
                    self.coupling.on_sample(1_000_000 * sequence, sequence)
            time.sleep(0.001)

    def end(self) -> None:
        self._ended.set()
        self.join(timeout=2.0)
        self.coupling.close()


@contextmanager
def running_controller(egm_port: int, password: str = "robotics", wrench=None, **options):
    clock = PlantClock(wrench)
    link = DeviceLink(clock.link.port)
    controller = AbbController(
        link, load_configurations(), egm_port, 0, password=password, **options
    )
    clock.start()
    link.start()
    controller.start()
    try:
        yield clock, controller
    finally:
        controller.stop()
        link.stop()
        clock.end()


@contextmanager
def running_ur_controller(wrench=None, silence_s=PATIENCE_S, **options):
    """The same clock with a simulated controller of Universal Robots.

    A client that a busy machine stalls is not silent: its watchdog of 0.1 s is tried by itself.
    """
    clock = PlantClock(wrench)
    link = DeviceLink(clock.link.port)
    controller = UrController(link, load_configurations(), silence_s=silence_s, **options)
    clock.start()
    link.start()
    controller.start()
    try:
        yield clock, controller
    finally:
        controller.stop()
        link.stop()
        clock.end()


def quiet_port() -> int:
    """A UDP port of loopback that no other process is given: in the range of one of our domains.

    One that the kernel finds free is given to the next process that asks, before it is used.
    """
    return ports_of(claim_domain()).egm
