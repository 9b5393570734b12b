# SPDX-License-Identifier: Apache-2.0
"""How long a stop takes to reach the robot if requests are lost, refused or hang.

Each trial has a seed of its own, moves (RAPID runs, session and mastership held), then loses a
share of all requests and asks for a stop. Trials that stand in build/bench/robot_stop.jsonl are
not made again: a run that was cut goes on where it was.
"""

from __future__ import annotations

import argparse
import json
import random
import sys
import threading
import time
from pathlib import Path

from record import write_figures

from cabols_hw.abb.errors import RobotError
from cabols_hw.abb.rws.motions import RobotMover
from cabols_hw.abb.rws.stop import EVERY_S
from cabols_sim.devices.abb.rapid import RapidProgram
from cabols_sim.devices.abb.rws_server import RwsServer, Trouble

USER, PASSWORD = "Default User", "robotics"
TARGET_S = 1.0
PATIENCE_S = 10.0
KINDS = (Trouble.LOST, Trouble.BUSY, Trouble.HANGS)


class _StandingRobot:
    """A robot that takes commands."""

    def move(self, index: int, speed_scale: float = 1.0) -> int:
        del index, speed_scale
        return 1

    def halt(self) -> int:
        return 2


def trial(seed: int, share: float, version: int) -> dict:
    """Return what one stop needed."""
    draw, lock = random.Random(seed), threading.Lock()
    program = RapidProgram(_StandingRobot(), 13)
    server = RwsServer(program, USER, PASSWORD, version=version)
    server.start()
    attempts = 0

    def troubled(method: str, path: str) -> Trouble:
        nonlocal attempts
        with lock:
            attempts += method == "POST" and "stop" in path and program.running
            return draw.choice(KINDS) if draw.random() < share else Trouble.NONE

    mover = RobotMover(server.url, USER, PASSWORD)
    try:
        mover.start_move(1)
        server.troubles = troubled
        said: list[str] = []

        def stop() -> None:
            try:
                mover.abort()
            except RobotError as error:
                said.append(str(error))

        began = time.monotonic()
        thread = threading.Thread(target=stop, daemon=True)
        thread.start()
        looked, stall_s = began, 0.0
        while program.running and time.monotonic() - began < PATIENCE_S:
            time.sleep(0.001)
            stall_s = max(stall_s, time.monotonic() - looked)
            looked = time.monotonic()
        took_s = time.monotonic() - began
        thread.join(PATIENCE_S)
    finally:
        server.troubles = lambda *_: Trouble.NONE
        mover.close()
        server.stop()
    stopped = not program.running
    row = {"seed": seed, "share": share, "version": version, "took_s": took_s, "stall_s": stall_s}
    return {**row, "stopped": stopped, "attempts": attempts, "said": said[0] if said else ""}


def main() -> int:
    """Run the trials that are missing; 1 if a stop took longer than a second."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=300)
    parser.add_argument("--share", type=float, default=0.3, help="of the requests that fail")
    parser.add_argument("--out", type=Path, default=Path("build/bench/robot_stop.jsonl"))
    options = parser.parse_args()
    options.out.parent.mkdir(parents=True, exist_ok=True)
    rows = []
    if options.out.exists():
        rows = [json.loads(line) for line in options.out.read_text().splitlines()]
    rows = [row for row in rows if row["share"] == options.share]
    made = {row["seed"] for row in rows}
    with options.out.open("a", encoding="utf-8") as log:
        for seed in range(options.trials):
            if seed in made:
                continue
            rows.append(trial(seed, options.share, 1 + seed % 2))
            log.write(json.dumps(rows[-1]) + "\n")
            log.flush()
    rows = [row for row in rows if row["seed"] < options.trials]
    times = sorted(row["took_s"] for row in rows)
    in_time = sum(row["stopped"] and row["took_s"] <= TARGET_S for row in rows)
    most = max(row["attempts"] for row in rows)
    late = [row["stall_s"] for row in rows if row["took_s"] > TARGET_S]
    figures = {
        "trials": len(rows),
        "share_of_requests_lost": options.share,
        "in_time": in_time,
        "median_s": times[len(times) // 2],
        "longest_s": times[-1],
        "attempts_max": most,
        "longest_stall_of_the_computer_s": max(row["stall_s"] for row in rows),
        "chance_of_no_arrival_in_1_s": options.share ** round(TARGET_S / EVERY_S),
    }
    write_figures(options.out.with_name("robot_stop.json"), figures)
    print(f"stops within {TARGET_S:g} s: {in_time} of {len(rows)}, {options.share:.0%} of requests")
    print(f"fail; median {figures['median_s']:.3f} s, longest {times[-1]:.3f} s, at most {most}")
    for stall_s in late:
        print(f"a late one: this computer itself stood still for up to {stall_s:.2f} s meanwhile")
    print(f"attempts; chance of none in 1 s: {figures['chance_of_no_arrival_in_1_s']:.1e}")
    return int(in_time < len(rows))


if __name__ == "__main__":
    sys.exit(main())
