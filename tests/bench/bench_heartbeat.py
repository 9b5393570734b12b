# SPDX-License-Identifier: Apache-2.0
"""How long the robot needs to hear of a fault, through the real nodes: until it begins to brake.

The robot moves in FREE_MOVING; a gauge fails, and the bridge reports it. The report ends the
heartbeat, and with it the motion (docs/safety.md). What passes from the report's arrival at an
observer until the robot begins to brake is HEARTBEAT_S of the generated fault campaign. Trials are
appended to build/bench/heartbeat.jsonl; another call goes on where it was.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import threading
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
from cabols_msgs.msg import LoopStatus
from geometry_msgs.msg import PoseStamped

from cabols_control.checks import FloatArray
from cabols_control.ros.messages.qos import topic_qos
from cabols_control.ros.rig_client import RigError
from cabols_control.supervision.modes import OperatingMode
from cabols_sim.bench.run import forgiving, isolated_environment, run_bench
from cabols_sim.devices.robot.robot_config import load_robot_truth
from cabols_sim.fault_campaign.in_process.rig import HEARTBEAT_S
from cabols_sim.fault_campaign.table import read_trials
from cabols_sim.ros.rig_watch import RigWatch

FAST_M_S = 0.02
"""The robot counts as moving from there on."""
STANDS_M = 2e-6
"""Largest change of a pose at rest between two packets."""
WATCHED_S = 0.8
ATTEMPTS = 20
"""Most trials of a call that a busy computer may disturb before the fault."""


class Arrivals:
    """When poses and the first report of a fault arrived, on this computer's clock."""

    def __init__(self, watch: RigWatch) -> None:
        self.poses: list[tuple[float, FloatArray]] = []
        self.fault_s = np.nan
        subscribe = watch.node.create_subscription
        subscribe(PoseStamped, "platform_pose", self._hear_pose, topic_qos("platform_pose"))
        subscribe(LoopStatus, "loop_status", self._hear_report, topic_qos("loop_status"))

    def _hear_pose(self, message: PoseStamped) -> None:
        at = message.pose.position
        self.poses.append((time.monotonic(), np.array([at.x, at.y, at.z])))
        del self.poses[:-2000]

    def _hear_report(self, message: LoopStatus) -> None:
        if message.state == LoopStatus.FAULT and message.node == "plant" and np.isnan(self.fault_s):
            self.fault_s = time.monotonic()

    def speed(self) -> float:
        """Of the platform, over the newest poses [m/s]."""
        if len(self.poses) < 20:
            return 0.0
        (began_s, where), (now_s, here) = self.poses[-10], self.poses[-1]
        return float(np.linalg.norm(here - where)) / max(now_s - began_s, 1e-3)

    def stood_s(self) -> float:
        """When the platform moved last, on this computer's clock [s]."""
        times = np.array([row[0] for row in self.poses])
        places = np.array([row[1] for row in self.poses])
        moved = np.linalg.norm(np.diff(places, axis=0), axis=1) > STANDS_M
        return float(times[1:][moved][-1])


def trial(watch: RigWatch, heard: Arrivals, number: int, brake_s: float) -> dict[str, float]:
    """Stop the robot by a fault once; times in seconds."""
    chance = random.Random(number)
    watch.inject("none")
    # FREE_MOVING takes off what a trial before has left; LOADING is granted with zeros alone.
    free = OperatingMode.FREE_MOVING
    for mode in (free, OperatingMode.LOADING, OperatingMode.STOPPED, free):
        watch.bring_to(mode)
    action = watch.start("move_to_configuration", accept_s=10.0, index=1 + number % 2)
    watch.wait(lambda: heard.speed() > FAST_M_S, "a robot that moves", 20.0)
    time.sleep(chance.uniform(0.0, 0.3))
    speed, heard.fault_s = heard.speed(), np.nan
    watch.inject("gauge_nan", value=float(chance.randrange(1, 6)))
    time.sleep(WATCHED_S)
    with suppress(RigError):
        action.cancel()
    return {
        "number": number,
        "speed_m_s": speed,
        "begins_to_brake_s": heard.stood_s() - brake_s - heard.fault_s,
    }


def main() -> None:
    """Make the trials that are left, and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=30)
    parser.add_argument("--output", type=Path, default=Path("build/bench/heartbeat.jsonl"))
    arguments = parser.parse_args()
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    rows = read_trials(arguments.output)
    environment = isolated_environment()
    failure: list[BaseException] = []

    def play(pids: dict[str, int]) -> None:
        del pids

        def body() -> None:
            watch = RigWatch(int(environment["ROS_DOMAIN_ID"]))
            try:
                watch.wait_running()
                heard, brake_s = Arrivals(watch), load_robot_truth().brake
                attempts = 0
                while len(rows) < arguments.trials:
                    try:
                        rows.append(trial(watch, heard, len(rows), brake_s))
                    except RigError as error:
                        attempts += 1
                        print(f"disturbed: {error}", flush=True)
                        if attempts > ATTEMPTS:
                            raise
                        continue
                    with arguments.output.open("a", encoding="utf-8") as log:
                        log.write(json.dumps(rows[-1]) + "\n")
                    print(rows[-1], flush=True)
            except BaseException as error:
                failure.append(error)
            finally:
                watch.close()
                os.kill(os.getpid(), signal.SIGTERM)

        threading.Thread(target=body, daemon=True).start()

    values = {"robot": True, "record": False, "truth": True, **forgiving()}
    run_bench(values, lambda *_: None, environment=environment, on_start=play)
    times = [row["begins_to_brake_s"] for row in rows]
    figures = {
        "trials": len(rows),
        "median_s": float(np.median(times)) if times else None,
        "worst_s": max(times, default=None),
        "campaign_assumes_s": HEARTBEAT_S,
        "beyond": sum(t > HEARTBEAT_S for t in times),
    }
    arguments.output.with_suffix(".json").write_text(json.dumps(figures, indent=2) + "\n")
    print(json.dumps(figures, indent=2))
    if failure:
        raise failure[0]


if __name__ == "__main__":
    main()
