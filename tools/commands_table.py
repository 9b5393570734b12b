# SPDX-License-Identifier: Apache-2.0
"""Run every executable with --help, a wrong option, a missing file, an occupied output folder.

Usage: commands_table.py            print the table
       commands_table.py --write    write docs/commands.md (`make commands-table`)

Each call runs in a folder of its own. It "started something" if it changed anything there, or began
a log of ROS, which rclpy does before anything else. Help is asked of the executable itself; for the
other cases its entry point is called in a fork of a process that has imported what is large
already, which is most of what a mistake costs. Needs the environment of `make setup`.
"""

from __future__ import annotations

import argparse
import configparser
import multiprocessing
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import NoReturn

from cabols_control.parameters.declared import declared_parameters
from structure import ROOT

PAGE = ROOT / "docs" / "commands.md"
CASES = ("--help", "wrong option", "misspelt parameter", "missing file", "occupied folder")
AT_ONCE = 2
PATIENCE_S = 600.0
"""A first call may compile inner loops."""
LIBRARIES = [
    *("numpy", "scipy.optimize", "scipy.signal", "scipy.stats", "scipy.spatial.transform"),
    *("numba", "pinocchio", "matplotlib.figure", "mpl_toolkits.mplot3d", "pydantic", "yaml"),
    *("rclpy", "rosbags.highlevel", "cabols_control.tension"),
]
"""What many executables import, and what of it takes long."""
NOWHERE, OCCUPIED, FOREIGN = "nowhere.yaml", "occupied", "thesis.tex"
MISSING_FILE: dict[str, tuple[str, ...]] = {
    "recover": ("nowhere",),
    "workspace": ("trajectory", "nowhere.csv"),
    "analyze": ("nowhere",),
    "report": ("nowhere",),
    "export": ("nowhere", "--format", "csv"),
    "demo": ("--program", "nowhere.csv"),
    "commission": ("--geometry-file", NOWHERE),
    "run_campaign": ("--campaign", NOWHERE),
    "device_simulator": ("--tracker-file", NOWHERE),
    "console_bench": ("--token-file", NOWHERE),
    "campaign_bench": ("--campaign", NOWHERE),
    "fast_gains": ("--control-file", NOWHERE),
}
"""Command lines that name a file which is not there; of the others no option names one."""
OUTPUT_OPTION = ("--output", OCCUPIED)
FILLS_A_FOLDER = (
    "demo",
    "commission",
    "commission_bench",
    "console_bench",
    "campaign_bench",
    "campaign_kills",
    "fast_gains",
    "dynamics_study",
    "fault_campaign",
)
OUTPUT: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(FILLS_A_FOLDER, OUTPUT_OPTION),
    "workspace": ("map", "--counts", "2", "2", "2", "--scheduler", "inline", *OUTPUT_OPTION),
    "recorder": ("--ros-args", "-p", f"output:={OCCUPIED}"),
}
HEAD = """\
# Commands

What every executable does with `--help`, an option or parameter that it does not know, a file that
is not there, and an output folder that holds somebody else's files. Nothing is started, written or
deleted in any of these cases. Exit codes of all: 0 done, 1 a target not met or a run failed, 2 a
wrong command line, 130 Ctrl-C. Written by `make commands-table`, by running them all.
"""


@dataclass(frozen=True)
class Executable:
    """One executable.

    Attributes:
        package: that has it.
        name: as `ros2 run` knows it.
        is_node: whether it takes ROS parameters only.
        entry_point: module:function that it calls.
    """

    package: str
    name: str
    is_node: bool
    entry_point: str = field(default="", compare=False)

    @property
    def path(self) -> str:
        """Where `ros2 run` finds it."""
        return str(Path(sys.prefix) / "lib" / self.package / self.name)


@dataclass(frozen=True)
class Outcome:
    """What one call did.

    Attributes:
        executable: that was called.
        case: one of CASES.
        words: its arguments.
        code: exit code.
        output: what it printed on stdout.
        errors: on stderr.
        started: files that it left, the first few; empty: it started nothing.
    """

    executable: Executable
    case: str
    words: tuple[str, ...]
    code: int
    output: str
    errors: str
    started: list[str] = field(default_factory=list)

    def cell(self) -> str:
        """Return what stands in the table."""
        if self.case == "--help":
            return f"{self.code}: help" + (", STARTED" if self.started else "")
        first = self.errors.strip().partition("\n")[0].removeprefix("error: ")
        return f"{self.code}: {first}".replace("|", "\\|")


def executables() -> list[Executable]:
    """Return all executables of all packages, from their setup.cfg."""
    found = []
    for path in sorted(ROOT.glob("cabols_*/setup.cfg")):
        config = configparser.ConfigParser()
        config.read(path)
        text = config.get("options.entry_points", "console_scripts", fallback="")
        package = path.parent.name
        for line in text.splitlines():
            name, _, target = (part.strip() for part in line.partition("="))
            if name:
                module = target.partition(":")[0]
                is_node = _is_node(package, module, name)
                found.append(Executable(package, name, is_node, target))
    return found


def _is_node(package: str, module: str, name: str) -> bool:
    """Whether an entry point is made by `node` (see cabols_control.node_command)."""
    path = ROOT / package / (module.replace(".", "/") + ".py")
    return f"{name} = node(" in path.read_text(encoding="utf-8")


def calls(executable: Executable) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield the cases that an executable has, with their command lines."""
    name = executable.name
    yield "--help", ("--help",)
    yield "wrong option", ("--hlep",)
    if executable.is_node:
        names = [p.name for p in declared_parameters(f"{executable.package}.nodes.{name}")]
        files = [parameter for parameter in names if parameter.endswith("_file")]
        yield "misspelt parameter", ("--ros-args", "-p", f"{misspelt(names[0])}:=x")
        if files:
            yield "missing file", ("--ros-args", "-p", f"{files[0]}:={NOWHERE}")
    elif name in MISSING_FILE:
        yield "missing file", MISSING_FILE[name]
    if name in OUTPUT:
        yield "occupied folder", OUTPUT[name]


def misspelt(name: str) -> str:
    """Leave a letter out of the middle of a name."""
    return name[: len(name) // 2] + name[len(name) // 2 + 1 :]


def observe(executable: Executable, case: str, words: tuple[str, ...]) -> Outcome:
    """Call an executable in a new folder and see what it does."""
    with tempfile.TemporaryDirectory() as place:
        folder, logs = Path(place) / "work", Path(place) / "ros_logs"
        (folder / OCCUPIED).mkdir(parents=True)
        (folder / OCCUPIED / FOREIGN).write_text("years of work", encoding="utf-8")
        before = _snapshot(Path(place))
        environment = {"ROS_LOG_DIR": str(logs), "ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF"}
        call = _execute if case == CASES[0] else _fork
        code, output, errors = call(executable, words, folder, environment)
        changed = sorted(before.items() ^ _snapshot(Path(place)).items())
    names = sorted({name for name, _ in changed})[:5]
    return Outcome(executable, case, words, code, output, errors, names)


def _execute(
    executable: Executable, words: Sequence[str], folder: Path, environment: dict[str, str]
) -> tuple[int, str, str]:
    """Run the executable; return exit code, output and errors."""
    done = subprocess.run(
        [executable.path, *words],
        cwd=folder,
        env={**os.environ, **environment},
        capture_output=True,
        stdin=subprocess.DEVNULL,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    return done.returncode, done.stdout, done.stderr


def _fork(
    executable: Executable, words: Sequence[str], folder: Path, environment: dict[str, str]
) -> tuple[int, str, str]:
    """Call the entry point in a process of its own; return exit code, output and errors."""
    texts = (folder.parent / "output.txt", folder.parent / "errors.txt")
    forks = multiprocessing.get_context("forkserver")
    forks.set_forkserver_preload(LIBRARIES)
    call = (executable.entry_point, [executable.path, *words], folder, environment, *texts)
    process = forks.Process(target=_call, args=call)
    process.start()
    process.join(PATIENCE_S)
    if process.exitcode is None:
        process.kill()
        process.join()
        raise subprocess.TimeoutExpired([executable.path, *words], PATIENCE_S)
    output, errors = (text.read_text("utf-8") for text in texts)
    for text in texts:
        text.unlink()
    return process.exitcode, output, errors


def _call(
    entry_point: str,
    words: list[str],
    folder: Path,
    environment: dict[str, str],
    output: Path,
    errors: Path,
) -> NoReturn:
    """Do in this process what the executable does."""
    for path, stream in ((output, 1), (errors, 2)):
        os.dup2(os.open(path, os.O_CREAT | os.O_WRONLY), stream)
    os.chdir(folder)
    os.environ.update(environment)
    sys.argv = words
    module, _, function = entry_point.partition(":")
    sys.exit(getattr(import_module(module), function)())


def _snapshot(folder: Path) -> dict[str, str]:
    """Content of every file, and every folder, below a folder."""
    return {
        str(path.relative_to(folder)): path.read_text("utf-8", "replace") if path.is_file() else ""
        for path in folder.rglob("*")
    }


def observe_all() -> list[Outcome]:
    """Run all cases of all executables, two at a time."""
    todo = [(executable, *call) for executable in executables() for call in calls(executable)]
    with ThreadPoolExecutor(AT_ONCE) as pool:
        return list(pool.map(lambda item: observe(*item), todo))


def page(outcomes: list[Outcome]) -> str:
    """Return docs/commands.md."""
    lines = [HEAD, f"| package | command | {' | '.join(CASES)} |", "|---" * (len(CASES) + 2) + "|"]
    for executable in dict.fromkeys(outcome.executable for outcome in outcomes):
        mine = {o.case: o.cell() for o in outcomes if o.executable == executable}
        cells = " | ".join(mine.get(case, "-") for case in CASES)
        lines.append(f"| {executable.package} | `{executable.name}` | {cells} |")
    return "\n".join(lines) + "\n"


def main() -> int:
    """Print or write the table; 1 if an executable started something or returned another code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="write docs/commands.md")
    options = parser.parse_args()
    outcomes = observe_all()
    text = page(outcomes)
    if options.write:
        PAGE.write_text(text, encoding="utf-8")
    else:
        print(text, end="")
    wrong = [o for o in outcomes if o.started or o.code != (0 if o.case == "--help" else 2)]
    for outcome in wrong:
        print(f"{outcome.executable.name}, {outcome.case}: {outcome}", file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
