# SPDX-License-Identifier: Apache-2.0
"""Press the stop many times, also beside a supervisor that is killed: is any press lost?

Each trial lets currents flow (PRETIGHTENING), presses the page's emergency stop, and waits for zero
currents on limb_state and for the latched FAULT. In every third one the supervisor is killed (-9)
up to a second before; it starts again 0.3 s after its end. Modes are requested 400 times a
second, and 1100 connections to the page never complete their request. Trials are appended to a
file; another call goes on where it was.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import socket
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import Any
from urllib.request import Request, urlopen

import numpy as np
from cabols_msgs.msg import LimbState, Mode

from cabols_control.ros.messages.qos import topic_qos
from cabols_control.ros.rig_client.client import RigClient
from cabols_control.ros.rig_client.errors import RigError
from cabols_control.supervision.modes import OperatingMode
from cabols_sim.bench.run import forgiving, isolated_environment, run_bench

HALF_OPEN = 1100
REQUESTS_PER_S = 400
RESPAWN_S = 0.3
LIFTED_S, LOOK_S, SEEN_S = 60.0, 5.0, 1.0
"""Longest wait until all nodes run again, for each look at them, and what a person needs [s]."""
LATEST_S = 10.0


class Currents:
    """When the newest current flowed."""

    def __init__(self, rig: RigClient) -> None:
        self.flowing = False
        self.changed_s = 0.0
        rig.node.create_subscription(LimbState, "limb_state", self._hear, topic_qos("limb_state"))

    def _hear(self, message: LimbState) -> None:
        flowing = any(message.current)
        if flowing != self.flowing:
            self.flowing, self.changed_s = flowing, time.monotonic()


def flood_requests(rig: RigClient, end: threading.Event) -> None:
    """Request a mode that is refused, again and again."""
    while not end.wait(1.0 / REQUESTS_PER_S):
        with suppress(Exception):
            future = rig.calls.call("set_mode", mode=int(Mode.UNLOADING))
            rig.calls.forget("set_mode", future)


def hold_half_open(port: int, count: int, end: threading.Event) -> None:
    """Keep connections whose request is never complete; the server closes, this opens again."""
    wires: list[socket.socket] = []
    while not end.is_set():
        while len(wires) < count and not end.is_set():
            with suppress(OSError):
                wire = socket.create_connection(("127.0.0.1", port), 1.0)
                wire.sendall(b"GET / HTTP/1.1\r\nHost: x\r\nX: ")
                wires.append(wire)
        end.wait(2.0)
        for wire in wires[: count // 2]:
            wire.close()
        wires = wires[count // 2 :]
    for wire in wires:
        wire.close()


def press(port: int) -> bool:
    """Press the page's button."""
    address = f"http://127.0.0.1:{port}/api/emergency_stop"
    with urlopen(Request(address, method="POST"), timeout=LATEST_S) as answer:
        return bool(json.load(answer)["success"])


def trial(
    rig: RigClient, currents: Currents, port: int, pids: dict[str, int], kill_s: float
) -> Any:
    """One press; `kill_s` before it the supervisor is killed, negative: it is not."""
    rig.bring_to(OperatingMode.PRETIGHTENING)
    rig.wait(lambda: currents.flowing, "currents", 10.0)
    if kill_s >= 0.0:
        os.kill(pids["supervisor"], signal.SIGKILL)
        time.sleep(kill_s)
    flowed, pressed_s = currents.flowing, time.monotonic()
    answered = False
    with suppress(OSError, ValueError):
        answered = press(port)
    answered_s = time.monotonic() - pressed_s

    def latched() -> bool:
        message = rig.mode_message
        return message is not None and message.cause == Mode.CAUSE_EMERGENCY_STOP

    latched_in = True
    try:
        rig.wait(latched, "FAULT", LATEST_S, even_in_fault=True)
    except RigError:
        latched_in = False
    # A motor that winds in is braked before it is cut, which may last after FAULT is told.
    with suppress(RigError):
        rig.wait(lambda: not currents.flowing, "zero currents", LATEST_S, even_in_fault=True)
    zero_s = max(currents.changed_s - pressed_s, 0.0) if flowed else 0.0
    return {
        "kill_s": kill_s,
        "flowed": flowed,
        "zero_s": zero_s,
        "answered": answered,
        "answered_s": answered_s,
        "latched": latched_in,
        "lost": not latched_in or currents.flowing,
    }


def lift(rig: RigClient) -> int:
    """Reset the stop until all nodes run again; returns how many resets that took: one."""
    give_up, resets = time.monotonic() + LIFTED_S, 0
    while not lifted(rig):
        if time.monotonic() > give_up:
            raise RigError(f"after {resets} resets the rig is still in {rig.mode}")
        if rig.mode == OperatingMode.FAULT:
            with suppress(RigError):
                rig.reset(timeout_s=LOOK_S)
                resets += 1
    return resets


def lifted(rig: RigClient) -> bool:
    """Whether all nodes run, and go on running for as long as a person needs to see it."""
    if rig.mode == OperatingMode.FAULT:
        return False
    try:
        rig.wait_running(timeout_s=LOOK_S)
    except RigError:
        return False
    time.sleep(SEEN_S)
    return rig.mode != OperatingMode.FAULT


def report(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Figures of all trials so far."""
    zero = [row["zero_s"] for row in rows if row["flowed"]]
    return {
        "presses": len(rows),
        "beside_a_restart": sum(row["kill_s"] >= 0.0 for row in rows),
        "lost": sum(row["lost"] for row in rows),
        "reset_more_than_once": sum(row.get("resets", 1) > 1 for row in rows),
        "unanswered": sum(not row["answered"] for row in rows),
        "median_time_to_zero_current_s": float(np.median(zero)) if zero else None,
        "worst_time_to_zero_current_s": max(zero, default=None),
    }


def main() -> None:
    """Run what is missing of the trials."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--presses", type=int, default=1000)
    parser.add_argument("--output", type=Path, default=Path("build/bench/stop_trials.jsonl"))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--quiet", action="store_true", help="no floods")
    arguments = parser.parse_args()
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    rows = []
    if arguments.output.exists():
        rows = [json.loads(line) for line in arguments.output.read_text().splitlines()]
    environment = isolated_environment()
    os.environ.update(environment)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    values = {"console": True, "console_port": port, "record": False, **forgiving()}
    failure: list[BaseException] = []

    def play(pids: dict[str, int]) -> None:
        def body() -> None:
            end = threading.Event()
            try:
                with RigClient(domain=int(environment["ROS_DOMAIN_ID"])) as rig:
                    rig.wait_running()
                    currents = Currents(rig)
                    rig.wait(lambda: _serves(port), "the page", 120.0)
                    if not arguments.quiet:
                        for job in (
                            (flood_requests, (rig, end)),
                            (hold_half_open, (port, HALF_OPEN, end)),
                        ):
                            threading.Thread(target=job[0], args=job[1], daemon=True).start()
                    while len(rows) < arguments.presses:
                        chance = random.Random(f"{arguments.seed} {len(rows)}")
                        kill_s = chance.uniform(0.0, 1.0) if len(rows) % 3 == 2 else -1.0
                        rows.append(trial(rig, currents, port, pids, kill_s))
                        rows[-1]["resets"] = lift(rig)
                        with arguments.output.open("a") as log:
                            log.write(json.dumps(rows[-1]) + "\n")
                        print(len(rows), rows[-1], flush=True)
                    end.set()
            except BaseException as error:
                failure.append(error)
            finally:
                end.set()
                os.kill(os.getpid(), signal.SIGTERM)

        threading.Thread(target=body, daemon=True).start()

    run_bench(values, lambda *_: None, environment=environment, on_start=play, respawn_s=RESPAWN_S)
    figures = report(rows)
    arguments.output.with_suffix(".json").write_text(json.dumps(figures, indent=2) + "\n")
    print(json.dumps(figures, indent=2))
    if failure:
        raise failure[0]


def _serves(port: int) -> bool:
    with socket.socket() as wire:
        return wire.connect_ex(("127.0.0.1", port)) == 0


if __name__ == "__main__":
    main()
