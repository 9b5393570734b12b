"""The demo: a 6-DOF wrench trajectory on the simulated rig, recorded, analysed, reported."""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import threading
import time
from pathlib import Path

from cabols_control.programs import BUILT_IN, load_program
from cabols_control.rig import load_rig
from cabols_sim.bench_run import run_bench, two_cores

STALL_S = 0.1
"""Watchdogs of the demo; a rig's own stay at the 10 and 15 ms of their configuration files."""
EVENTS = ("mode ", "programme", "error", "ERROR", "WARN", "Error", "lost")


class Progress:
    """Tells what happens and how far the programme is."""

    def __init__(self, duration_s: float) -> None:
        """Start counting; duration_s is the programme's."""
        self._duration = duration_s
        self._began = time.monotonic()
        self._loading: float | None = None
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._tick, daemon=True)

    def __enter__(self) -> Progress:
        """Begin ticking."""
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Stop ticking."""
        self._stop.set()
        self._thread.join()

    def line(self, node: str, text: str) -> None:
        """Show a node's line if it is an event."""
        if "programme" in text and self._loading is None:
            self._loading = time.monotonic()
        if any(word in text for word in EVENTS):
            self.say(f"{node}: {text.rpartition(']: ')[2]}")

    def say(self, text: str) -> None:
        """Print one line with the time since start."""
        print(f"  {time.monotonic() - self._began:5.1f} s  {text}", flush=True)

    def _tick(self) -> None:
        while not self._stop.wait(5.0):
            if self._loading is None:
                self.say("starting")
            else:
                done = min(time.monotonic() - self._loading, self._duration)
                self.say(f"loading: {done:.0f} of {self._duration:.0f} s")


def main() -> int:
    """Run the demo; returns 0, 1 after a failure, 130 after Ctrl-C."""
    arguments = _arguments()
    output = arguments.output
    program = load_program(arguments.program)
    bag = output / "bag"
    shutil.rmtree(output, ignore_errors=True)
    output.mkdir(parents=True)
    print(f"cabols demo: {program.name} on the simulated eight-cable rig, real time at 1 kHz")
    values = {
        "program": arguments.program,
        "auto_start": True,
        "exit_when_done": True,
        "output": str(bag),
        "description": f"{program.name}, scale 1, simulated rig, seed {arguments.seed}",
        "fifo_priority": arguments.fifo_priority,
        "seed": arguments.seed,
        "linear": arguments.linear,
        "speed": arguments.speed,
        # A desktop's kernel may stall for longer than a rig's watchdog allows.
        "watchdog": STALL_S,
        "command_timeout": STALL_S,
        **two_cores(),
    }
    with Progress(program.duration) as progress:
        ended = run_bench(values, progress.line, output / "log")
    if not ended.first:
        print(f"interrupted: all nodes ended, motors at zero; the bag is {bag}")
        return 130
    if ended.first != "load_program" or ended.code != 0:
        print(
            f"error: {ended.first} ended with code {ended.code}; its output is "
            f"{output / 'log' / (ended.first + '.log')}",
            file=sys.stderr,
        )
        return 1
    return _report(output, bag)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="demo", description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("build/demo"), help="folder to fill")
    parser.add_argument(
        "--program",
        default="multi_axis",
        help=f"{', '.join(sorted(BUILT_IN))} or a .csv file (default: %(default)s)",
    )
    parser.add_argument("--seed", type=int, default=0, help="of the simulated rig's noise")
    parser.add_argument(
        "--speed",
        type=float,
        default=1.0,
        help="below 1 the rig moves in slow motion, while programmes keep the wall's time",
    )
    parser.add_argument("--linear", action="store_true", help="simulate the linear plant")
    parser.add_argument(
        "--fifo-priority",
        type=int,
        default=0,
        help="SCHED_FIFO priority of bridge and limb controller, 0 for none; a warning tells "
        "where it is refused (default: %(default)s)",
    )
    return parser.parse_args()


def _report(output: Path, bag: Path) -> int:
    """Analyse the bag alone; print, plot, write."""
    from cabols_sim.analysis import load_run, summarise, table
    from cabols_sim.figures import write_figures
    from cabols_sim.report import write_report
    from cabols_sim.reproductions import run_all

    print("analysing the bag", flush=True)
    run = load_run(bag)
    summary = summarise(run, load_rig())
    print(table(summary))
    (output / "summary.json").write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")
    print("figures, reproductions of the source's results, report", flush=True)
    write_figures(run, output)
    reproductions = run_all(output / "reproductions")
    write_report(output / "report.html", run, summary, reproductions)
    for name in ("summary.json", "overview.png", "report.html"):
        print(f"  {output / name}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
