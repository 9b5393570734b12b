# SPDX-License-Identifier: Apache-2.0
"""Start the simulated rig and end it, many times, at any moment and in every way that there is.

Each trial starts the graph with a recorder, loads it, and ends it at a random time after the
start, or after PRETIGHTENING or LOADING has begun: by SIGINT to the launcher, two of them,
SIGTERM, two of them; SIGINT twice, SIGHUP, or SIGQUIT, to every process at once, as a terminal
does where launcher and nodes share it; by SIGTERM to one node, drawn by lot; or by SIGKILL to the
launcher. Afterwards no process is left, every node has ended with 0 and without a traceback, the
bag is complete, its last current zero and its last tensions low. Trials are appended to a file;
another call goes on where it was. With --ros2-launch, where ROS 2's launch is installed,
bench.launch.py is launched in place of the project's own launcher.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from record import write_figures

from cabols_control.bags.reader import read_bag
from cabols_control.errors import CabolsError
from cabols_sim.bench.run import forgiving, isolated_environment, run_bench

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "harness"))
from line_journal import LineJournal

LAUNCH_FILE = Path(sys.prefix) / "share" / "cabols_sim" / "launch" / "bench.launch.py"
MARK = "CABOLS_LIFE_CYCLE"
"""Environment variable by which the processes of a trial are found."""
WAYS = (
    *("sigint", "double", "sigterm", "terminal", "hangup", "killed"),
    *("twice", "quit", "one"),
)
PHASES = ("start", "start", "PRETIGHTENING", "LOADING")
OF_A_NODE = re.compile(r"\[\w+-\d+\] ")
DIED = re.compile(r"process has died \[pid (\d+),")
"""Launch's word of a node that failed; asyncio may have lost the exit code, and then says so."""
EARLIEST_PHASE_S = 6.0
LATER_S = 2.0
SPEED = 0.5
START_LIMIT_S = 90.0
END_LIMIT_S = 60.0
LAST_TENSION_N = 10.0


def arguments_of(folder: Path, robot: bool) -> dict[str, Any]:
    """Arguments of the graph."""
    return {
        "record": True,
        "output": str(folder / "bag"),
        "auto_start": True,
        "program": "ramps",
        "robot": robot,
        "speed": SPEED,
        **forgiving(SPEED),
    }


def launch_child(folder: Path, robot: bool) -> int:
    """Launch bench.launch.py as `ros2 launch` does, in the place of the child below."""
    from launch.actions import IncludeLaunchDescription
    from launch.launch_description_sources import PythonLaunchDescriptionSource

    from launch import LaunchDescription, LaunchService

    given = [(name, str(value)) for name, value in arguments_of(folder, robot).items()]
    os.environ.update(isolated_environment())
    source = PythonLaunchDescriptionSource(str(LAUNCH_FILE))
    include = IncludeLaunchDescription(source, launch_arguments=given)
    service = LaunchService(argv=[f"{name}:={value}" for name, value in given], noninteractive=True)
    service.include_launch_description(LaunchDescription([include]))
    return int(service.run())


def child(folder: Path, robot: bool) -> int:
    """Run the graph as its launcher; leave the nodes' exit codes."""
    ended = run_bench(arguments_of(folder, robot), environment=isolated_environment())
    result = {"first": ended.first, "code": ended.code, "codes": ended.codes}
    (folder / "ended.json").write_text(json.dumps(result), encoding="utf-8")
    return 0


class Launch:
    """One launcher with its nodes, and what they print."""

    def __init__(self, folder: Path, robot: bool, by_launch: bool) -> None:
        self.folder, self.by_launch = folder, by_launch
        folder.mkdir(parents=True)
        command = [sys.executable, __file__, "--child", str(folder), *["--robot"] * robot]
        command += ["--ros2-launch"] * by_launch
        environment = {**os.environ, MARK: str(folder)}
        self.began_s = time.monotonic()
        self.lines: list[str] = []
        self.process = subprocess.Popen(
            command,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
            text=True,
            start_new_session=True,
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.lines.append(line.rstrip())

    def wait_for(self, words: str, seconds: float) -> bool:
        """Wait until a line has these words; whether one has."""
        give_up = time.monotonic() + seconds
        while not any(words in line for line in list(self.lines)):
            if time.monotonic() > give_up or self.process.poll() is not None:
                return False
            time.sleep(0.01)
        return True

    def pids(self) -> list[int]:
        """All processes of the trial that live."""
        return [pid for pid in _processes() if self._is_ours(pid)]

    def _is_ours(self, pid: int) -> bool:
        with suppress(OSError):
            environ = Path(f"/proc/{pid}/environ").read_bytes().split(b"\0")
            return f"{MARK}={self.folder}".encode() in environ
        return False

    def send(self, number: int, to_all: bool) -> None:
        """Send a signal to the launcher, or to all processes."""
        for pid in self.pids() if to_all else [self.process.pid]:
            with suppress(ProcessLookupError):
                os.kill(pid, number)

    def end_one(self, dice: random.Random) -> None:
        """Send SIGTERM to one node; to the launcher before there is any."""
        nodes = [pid for pid in self.pids() if pid != self.process.pid]
        with suppress(ProcessLookupError):
            os.kill(dice.choice(nodes or [self.process.pid]), signal.SIGTERM)

    def wait_until_gone(self, seconds: float) -> list[int]:
        """Wait until no process is left; return those that are."""
        give_up = time.monotonic() + seconds
        while (left := self.pids()) and time.monotonic() < give_up:
            self.process.poll()
            time.sleep(0.02)
        return left


def _processes() -> Iterator[int]:
    return (int(entry.name) for entry in Path("/proc").iterdir() if entry.name.isdecimal())


def trial(number: int, seed: int, folder: Path, by_launch: bool) -> dict[str, Any]:
    """Run one trial; return what was done and what is wrong."""
    dice = random.Random(f"{seed}/{number}")
    way, phase = WAYS[number % len(WAYS)], dice.choice(PHASES)
    robot = dice.random() < 0.5
    delay_s = dice.uniform(0.0, EARLIEST_PHASE_S if phase == "start" else LATER_S)
    launch = Launch(folder / f"{number:04d}", robot, by_launch)
    wrong = []
    reached = phase == "start" or launch.wait_for(f"mode {phase}", START_LIMIT_S)
    time.sleep(delay_s)
    struck_s = time.monotonic()
    _strike(launch, way, dice)
    left = launch.wait_until_gone(END_LIMIT_S)
    took_s = time.monotonic() - struck_s
    if left:
        wrong.append(f"processes left: {_names(left)}")
        for pid in left:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
    wrong += _faults(launch, way)
    if not wrong:
        for path in sorted(launch.folder.rglob("*"), reverse=True):
            path.rmdir() if path.is_dir() else path.unlink()
        launch.folder.rmdir()
    else:
        (launch.folder / "output.log").write_text("\n".join(launch.lines), encoding="utf-8")
    return {
        "number": number,
        "way": way,
        "phase": phase,
        "reached": reached,
        "robot": robot,
        "delay_s": round(delay_s, 3),
        "ended_in_s": round(took_s, 3),
        "wrong": wrong,
    }


def _strike(launch: Launch, way: str, dice: random.Random) -> None:
    if way in ("sigint", "double"):
        launch.send(signal.SIGINT, to_all=False)
    if way == "double":
        time.sleep(dice.uniform(0.0, 1.0))
        launch.send(signal.SIGINT, to_all=False)
    if way == "sigterm":
        launch.send(signal.SIGTERM, to_all=False)
    if way == "terminal":
        launch.send(signal.SIGINT, to_all=True)
        time.sleep(dice.uniform(0.0, 1.0))
        launch.send(signal.SIGINT, to_all=True)
    if way == "twice":
        launch.send(signal.SIGTERM, to_all=False)
        time.sleep(dice.uniform(0.0, 1.0))
        launch.send(signal.SIGTERM, to_all=False)
    if way == "quit":
        launch.send(signal.SIGQUIT, to_all=True)
    if way == "one":
        launch.end_one(dice)
    if way == "hangup":
        launch.send(signal.SIGHUP, to_all=True)
    if way == "killed":
        launch.send(signal.SIGKILL, to_all=False)


def _names(pids: list[int]) -> str:
    found = []
    for pid in pids:
        with suppress(OSError):
            found.append(Path(f"/proc/{pid}/cmdline").read_text().replace("\0", " ")[:80])
    return "; ".join(found)


def _faults(launch: Launch, way: str) -> Iterator[str]:
    """What is wrong with how a launch has ended."""
    for index, line in enumerate(launch.lines):
        # What launch itself prints when it is interrupted while it starts is not ours.
        if "Traceback" in line and (not launch.by_launch or OF_A_NODE.match(line)):
            yield "traceback: " + " | ".join(launch.lines[index : index + 40])[:1500]
        if (died := DIED.search(line)) and not any(
            f"Unknown child process pid {died[1]}," in other for other in launch.lines
        ):
            yield line
    path = launch.folder / "ended.json"
    early = not launch.lines or launch.by_launch
    if way != "killed" and not early:
        if not path.exists():
            yield f"the launcher ended with {launch.process.poll()} before its nodes"
        else:
            codes = json.loads(path.read_text(encoding="utf-8"))["codes"]
            bad = {name: code for name, code in codes.items() if code}
            if bad:
                yield f"exit codes {bad}"
    bag = launch.folder / "bag"
    if not bag.exists():
        return
    if not (bag / "metadata.yaml").exists():
        yield "the bag has no metadata.yaml"
        return
    try:
        read = read_bag(bag, ["motor_current", "limb_state"])
    except CabolsError as error:
        yield f"the bag cannot be read: {error}"
        return
    if "motor_current" in read and len(read["motor_current"]):
        last = read["motor_current"]["current"][-1]
        if abs(last).max() > 0.0:
            yield f"last current {last.tolist()}"
    if "limb_state" in read and len(read["limb_state"]):
        tension = float(read["limb_state"]["tension"][-1].max())
        if tension >= LAST_TENSION_N:  # NaN before the limbs have a zero
            yield f"last tension {tension:.1f} N"


def report(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Figures of all trials so far."""
    by_way = {
        way: {
            "trials": sum(row["way"] == way for row in rows),
            "wrong": sum(bool(row["wrong"]) for row in rows if row["way"] == way),
        }
        for way in WAYS
    }
    return {
        "trials": len(rows),
        "wrong": sum(bool(row["wrong"]) for row in rows),
        "phase_not_reached": sum(not row["reached"] for row in rows),
        "slowest_end_s": max((row["ended_in_s"] for row in rows), default=None),
        "by_way": by_way,
    }


def main() -> int:
    """Run what is missing of the trials; returns 1 if one went wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=200)
    parser.add_argument("--short", action="store_true", help="18 trials")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--output", type=Path, default=None)
    parser.add_argument("--ros2-launch", action="store_true", help="by bench.launch.py")
    parser.add_argument("--child", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--robot", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    by_launch = arguments.ros2_launch
    if arguments.child:
        return (launch_child if by_launch else child)(arguments.child, arguments.robot)
    # Ignored where a shell runs this in the background, or nohup does, and launchers leave it so.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    name = "life_cycle_ros2_launch" if by_launch else "life_cycle"
    output = (arguments.output or Path("build") / name).absolute()
    output.mkdir(parents=True, exist_ok=True)
    journal = LineJournal(output / "journal.jsonl")
    wanted = 18 if arguments.short else arguments.trials
    for number in (n for n in range(wanted) if n not in journal.found):
        shutil.rmtree(output / f"{number:04d}", ignore_errors=True)  # of a trial that was cut
        row = trial(number, arguments.seed, output, by_launch)
        journal.add(number, **row)
        said = "; ".join(row["wrong"])[:300] or "in order"
        print(
            f"{number:4d} {row['way']:9s} {row['delay_s']:5.2f} s after {row['phase']:13s} "
            f"ended in {row['ended_in_s']:5.2f} s: {said}",
            flush=True,
        )
    figures = report(list(journal.found.values()))
    write_figures(Path(f"build/bench/{name}.json"), figures)
    for way, counts in figures["by_way"].items():
        print(f"{way:10s} {counts['trials']:4d} trials, {counts['wrong']} wrong")
    print(f"{figures['trials']} starts and ends, {figures['wrong']} wrong")
    return 1 if figures["wrong"] else 0


if __name__ == "__main__":
    sys.exit(main())
