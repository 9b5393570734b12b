# SPDX-License-Identifier: Apache-2.0
"""The demo: a session on the simulated rig, recorded, analysed, reported.

The robot moves, the cables follow; the limbs pre-tighten, load the robot by a 6-DOF wrench
trajectory, unload.
"""

from __future__ import annotations

import argparse
import importlib
import json
import sys
import threading
import time
from pathlib import Path
from typing import Any

from cabols_control.bringup.log_line import read_line
from cabols_control.bringup.processes import Ended
from cabols_control.command_line import (
    DONE,
    FAILED,
    INTERRUPTED,
    CommandParser,
    command,
    fail,
    rig_option,
)
from cabols_control.errors import UsageError
from cabols_control.files.output_folder import output_folder
from cabols_control.load_programs.programs import BUILT_IN, LoadProgram, load_program
from cabols_control.rig import load_rig
from cabols_control.rig_folder import find_rig
from cabols_control.run_report.judgement.computer import (
    TimerError,
    advice,
    missed,
    timer_numbers,
)
from cabols_sim.bench.attempt import BAG, LOG, Attempt, put_aside
from cabols_sim.bench.bare_timer import Timers, bare_timers
from cabols_sim.bench.busiest import busiest
from cabols_sim.bench.pulley_rig import make_pulley_rig
from cabols_sim.bench.run import forgiving, isolated_environment, real_time_arguments, run_bench

TRIES = 2
LIMIT_S = 240.0
"""Longest time of a session besides its programme, at full speed [s]."""
SLOW_LIMB = ("cabols_sim", "slow_limb_controller")
SHOWN = ("supervisor", "load_program")
"""Nodes whose every line is an event: modes and programmes."""


class Progress:
    """Prints events and the progress of the programme."""

    def __init__(self, duration_s: float) -> None:
        """Start counting; duration_s is the programme's."""
        self._duration = duration_s
        self._began = time.monotonic()
        self._loading: float | None = None
        self._starting = True
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._tick, daemon=True)

    def __enter__(self) -> Progress:
        """Start ticking."""
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Stop ticking."""
        self._stop.set()
        self._thread.join()

    def line(self, node: str, text: str) -> None:
        """Show a node's line if it is an event, a warning or an error.

        Args:
            node: that has written it.
            text: the line as it came.
        """
        read = read_line(text)
        if node == "load_program":
            self._starting = False
        if node in SHOWN or read.loud:
            self.say(f"{node}: {read.words}")

    def load(self, begins: bool) -> None:
        """Count a programme's time from its beginning to its end."""
        self._loading = time.monotonic() if begins else None

    def step(self, text: str) -> None:
        """Show the operator's next step."""
        self._starting = False
        self.say(text)

    def say(self, text: str) -> None:
        """Print one line with the time since start."""
        print(f"  {time.monotonic() - self._began:5.1f} s  {text}", flush=True)

    def _tick(self) -> None:
        while not self._stop.wait(5.0):
            loading = self._loading
            if self._starting:
                self.say("starting")
            elif loading is not None:
                done = min(time.monotonic() - loading, self._duration)
                self.say(f"loading: {done:.0f} of {self._duration:.0f} s")


@command
def main() -> int:
    """Run the demo; returns 0, 1 after a failure, 130 after Ctrl-C."""
    arguments = _arguments()
    program = load_program(arguments.program)
    # ROS's wheels restart Python at their first import, so this comes before everything else.
    session_module = (
        None if arguments.rigid else importlib.import_module("cabols_sim.ros.demo_session")
    )
    with output_folder(arguments.output, "demo") as folder:
        if arguments.pulleys is not None:
            arguments.rig = str(_pulley_rig(arguments))
        code, complete = _run(arguments, program, session_module)
        if complete:
            folder.finish()
    return code


def _pulley_rig(arguments: argparse.Namespace) -> Path:
    """Make the folder of the rig with pulleys that the options ask for."""
    source, neglected = find_rig(arguments.rig), arguments.neglect_pulleys
    target = arguments.output / f"{source.name}_pulleys"
    return make_pulley_rig(source, target, arguments.pulleys, neglected)


def _run(
    arguments: argparse.Namespace, program: LoadProgram, session_module: Any
) -> tuple[int, bool]:
    """Run the session and judge it; return the exit code and whether the report was written."""
    devices = "" if arguments.rigid else ", robot and laser tracker"
    folder, cables = find_rig(arguments.rig), load_rig(arguments.rig).geometry.cables
    print(
        f"cabols demo: {program.name} on the simulated rig {folder.name} of {cables} cables"
        f"{devices}, {arguments.speed:g} of real time, 1 kHz",
        flush=True,
    )
    attempt = _attempt(arguments, program, session_module)
    for left in range(arguments.tries - 1, 0, -1):
        if not (attempt.failure and attempt.stalled):
            break
        print(attempt.why)
        put_aside(arguments.output, arguments.tries - left)
        print(f"running it once more ({left} left)", flush=True)
        attempt = _attempt(arguments, program, session_module)
    bag = arguments.output / BAG
    if attempt.failure:
        return fail(f"{attempt.why}; the bag is {bag}", FAILED), False
    if attempt.interrupted:
        print(f"interrupted: all nodes ended, motors at zero; the bag is {bag}")
        return INTERRUPTED, False
    return _report(arguments, bag, attempt.timers), True


def _attempt(arguments: argparse.Namespace, program: LoadProgram, session_module: Any) -> Attempt:
    """Run the session once."""
    output: Path = arguments.output
    environment = isolated_environment()
    asked = _asked(arguments)
    values = {**_values(arguments, output / BAG, program.name), **asked}
    stand_ins = {"limb_controller": SLOW_LIMB} if arguments.slow_limb_law else {}
    with bare_timers(asked, arguments.speed) as timers, Progress(program.duration) as progress:
        session, on_start = None, None
        if session_module is not None:
            plan = session_module.DemoPlan(arguments.program, program.duration, arguments.speed)
            domain = int(environment["ROS_DOMAIN_ID"])
            session = session_module.DemoSession(plan, domain, progress.step, progress.load)
            on_start = session.start
        try:
            ended = run_bench(
                values,
                progress.line,
                output / LOG,
                environment,
                on_start,
                stand_ins=stand_ins,
                limit_s=LIMIT_S / arguments.speed + program.duration,
            )
        finally:
            if session is not None:
                session.stop()
    done = session is not None and session.done
    return Attempt(_failure(ended, session, output / LOG), not ended.first and not done, timers)


def _asked(arguments: argparse.Namespace) -> dict[str, int]:
    """What the demo asks of the kernel."""
    return {} if arguments.plain else real_time_arguments()


def _values(arguments: argparse.Namespace, bag: Path, program: str) -> dict[str, Any]:
    """Arguments of the graph."""
    values = {
        "rig": arguments.rig,
        "output": str(bag),
        "description": f"{program}, scale 1, simulated rig, seed {arguments.seed}",
        "seed": arguments.seed,
        "linear": arguments.linear,
        "speed": arguments.speed,
        **forgiving(arguments.speed),
    }
    if arguments.rigid:
        return {
            **values,
            "program": arguments.program,
            "auto_start": True,
            "exit_when_done": True,
        }
    return {**values, "robot": True}


def _failure(ended: Ended, session: Any, log: Path) -> str:
    """Return the failure; empty without one, or after Ctrl-C."""
    if session is not None and session.error is not None:
        interrupted_s = ended.interrupted_s
        if interrupted_s is None or session.error_s < interrupted_s:
            return str(session.error)
    if ended.overdue:
        return (
            "the session had not ended in time, so all nodes were ended, motors at zero: one of "
            f"them is too slow or leaves the others no time; their output is in {log}"
        )
    expected = ended.first == "load_program" and ended.code == 0 and session is None
    if ended.first and not expected:
        return (
            f"{ended.first} ended with code {ended.code}; its output is "
            f"{log / (ended.first + '.log')}"
        )
    return ""


def _arguments() -> argparse.Namespace:
    parser = CommandParser("demo", __doc__)
    rig_option(parser)
    parser.add_argument("--output", type=Path, default=Path("build/demo"), help="folder to fill")
    parser.add_argument(
        "--program",
        default="multi_axis",
        help=f"{', '.join(sorted(BUILT_IN))} or a .csv file (default: %(default)s)",
    )
    parser.add_argument("--seed", type=int, default=0, help="of all noise of the simulated rig")
    parser.add_argument(
        "--speed",
        type=float,
        default=1.0,
        help="below 1 the rig moves in slow motion, while programmes keep the wall's time",
    )
    parser.add_argument(
        "--rigid",
        action="store_true",
        help="only pre-tighten and load, on a target that never moves: no robot, no tracker",
    )
    parser.add_argument(
        "--pulleys",
        type=float,
        metavar="METRES",
        help="let all cables leave swivelling pulleys of this radius",
    )
    parser.add_argument(
        "--neglect-pulleys",
        action="store_true",
        help="with --pulleys: in the simulated rig alone, control believes in points",
    )
    parser.add_argument("--linear", action="store_true", help="simulate the linear plant")
    parser.add_argument(
        "--plain",
        action="store_true",
        help="ask the kernel for nothing: no cores, no SCHED_FIFO, no limit on wake-up times",
    )
    parser.add_argument(
        "--tries",
        type=int,
        choices=range(1, 10),
        default=TRIES,
        metavar="N",
        help="runs at most, if they fail while this computer stands still (default: %(default)s)",
    )
    parser.add_argument(
        "--slow-limb-law",
        action="store_true",
        help="burn a millisecond in every cycle of the limb law: the demo must then fail",
    )
    options = parser.parse_args()
    if options.neglect_pulleys and options.pulleys is None:
        raise UsageError("--neglect-pulleys: expected --pulleys METRES beside it, got none")
    return options


def _report(arguments: argparse.Namespace, bag: Path, timers: Timers) -> int:
    """Analyse the bag; print, plot, write; judge the software apart from this computer."""
    from cabols_control.run_report.judgement.acceptance import by_computer, failures
    from cabols_control.run_report.judgement.figures_of_merit import load_run, summarise, table
    from cabols_control.run_report.judgement.stalls import stall_numbers
    from cabols_control.run_report.pictures.run_figures import write_figures
    from cabols_control.run_report.report import write_report
    from cabols_sim.reproductions import run_all

    output: Path = arguments.output
    print("analysing the bag", flush=True)
    run = load_run(bag)
    summary = {
        **summarise(run, load_rig(arguments.rig)),
        **_timer_numbers(run.loading_log_ns, timers),
        **stall_numbers(run, timers.records),
    }
    failed, busy = failures(summary), by_computer(summary)
    summary["not_met_by_software"] = [check.quantity for check in failed]
    summary["not_met_by_computer"] = [check.quantity for check in busy]
    print(table(summary))
    if busy:
        print(advice(summary, bool(_asked(arguments))))
        others = ", ".join(f"{name} ({load:.0f} %)" for name, load in busiest())
        if others:
            print(f"Busy beside the demo right now, percent of a core: {others}")
    (output / "summary.json").write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")
    print("figures, reproductions of the source's results, report", flush=True)
    write_figures(run, output, summary)
    reproductions = run_all(output / "reproductions")
    write_report(output / "report.html", run, summary, reproductions)
    for name in ("summary.json", "overview.png", "session.png", "report.html"):
        if (output / name).exists():
            print(f"  {output / name}")
    if failed:
        return fail(f"not met: {', '.join(check.quantity for check in failed)}", FAILED)
    return DONE


def _timer_numbers(window_ns: tuple[int, int], timers: Timers) -> dict[str, Any]:
    """What the bare timers missed during the load; nothing is excused if they failed."""
    try:
        return timer_numbers(missed(timers.records, *window_ns))
    except TimerError as error:
        print(f"warning: {error}", file=sys.stderr)
        return timer_numbers(None)


if __name__ == "__main__":
    sys.exit(main())
