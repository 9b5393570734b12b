# SPDX-License-Identifier: Apache-2.0
"""Follow every command of the README and the pages, as a newcomer would, from a fresh clone.

Usage: follow_docs.py [--here] [--list] [--fresh] [--only TEXT]     (`make follow-docs`)

Commands are the lines of the shell blocks. What the ROS wheels lack is translated (`ros2 run
PACKAGE EXECUTABLE` is `.venv/lib/PACKAGE/EXECUTABLE`) or left out, with the reason. A node that
does not end is interrupted after a while and must then end in order. Goes on where it was:
finished commands are kept in build/follow_docs.json until the commit changes. Benchmarks of minutes
and more are followed with --long. Standard library only.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
RESULT = ROOT / "build" / "follow_docs.json"
CLONE = ROOT / "build" / "follow_docs"
BLOCK = re.compile(r"^```sh\n(.*?)^```", re.MULTILINE | re.DOTALL)
INLINE = re.compile(r"(?<!`)`((?:make [a-zP]|ros2 [a-z]|\.venv/)[^`]*)`(?!`)")

RUN, LONG, SERVE, LEAVE = "run", "long", "serve", "leave out"
PATIENCE_S = {RUN: 3600.0, LONG: 7200.0, SERVE: 60.0}
ENDING_S = 30.0
"""Longest that an interrupted command may take to end [s]."""
SERVED = {
    "compensation", "console", "console_bench", "limb_controller", "load_program", "markers",
    "recorder", "supervisor", "wrench_controller",
}  # fmt: skip
"""Executables that run until they are interrupted."""
RULES: tuple[tuple[str, str, str], ...] = (
    (r"sudo |rosdep |.*colcon\)?\"? build|source |mkdir |git clone|python3 -m venv", LEAVE,
     "sets up a system or a ROS 2 workspace"),
    (r"(make rt-check|ros2 run cabols_control rt_check)", LEAVE, "says what this computer lacks"),
    (r"ros2 (launch|service|action|topic|bag|lifecycle|param|node)\b", LEAVE,
     "needs ROS 2's own command"),
    (r"pip install \./", LEAVE, "into another environment than this one"),
    (r"cabols-stiffness ", LEAVE, "needs a laboratory's files"),
    (r"python -m pip install", LEAVE, "into the environment of a ROS 2 installation"),
    (r".*(<[a-z ]+>|\.\.\.)", LEAVE, "has a place to fill in"),
    (r"\(umask", LEAVE, "writes into the home folder"),
    (r"ros2 run cabols_stiffness run_campaign", LEAVE, "needs a rig that runs"),
    (r"ros2 run cabols_control commission$", LEAVE, "needs a rig that runs"),
    (r"ros2 run cabols_control calibrate_rig$", LEAVE, "needs a plan or readings"),
    (r"ros2 run cabols_control first_power_on$", LEAVE, "needs a rig that runs"),
    (r"(ros2 run cabols_control new_rig|ros2 run cabols_sim check_rig) my_rig$", RUN, ""),
    (r"ros2 run (cabols_control new_rig|cabols_sim check_rig) my_crane( --hanging)?$", RUN, ""),
    (r'make demo ARGS="--rig my_rig"$', RUN, ""),
    (r"make (new-rig|check-rig)$", LEAVE, "needs a name"),
    (r"make new-rig ARGS=my_rig$", LEAVE, "the same as new_rig, whose folder is there by now"),
    (r".*\b(my_\w+|BAG\w*|FOLDER|SOURCE|COMMAND|campaigns/first|poses\.csv)\b",
     LEAVE, "names a file"),
    (r"\.venv/bin/python -m grpc_tools", LEAVE, "writes generated sources"),
    (r"ros2 run cabols_control console .*token_file", LEAVE, "needs the token of the line before"),
    (r"ssh ", LEAVE, "needs another machine"),
    (r"make (.* )?(faults|campaign-kills|stop-trials|life-cycle)\b", LEAVE,
     "takes an hour or more: run it by itself"),
    (r"make follow-docs\b", LEAVE, "is this command"),
    (r"make bench$", LEAVE, "all of its parts are followed"),
    (r"make (test|test-long|colcon-test)$", LONG, ""),
    (r"make test-stress$", LEAVE, "runs all tests five times"),
    (r"make bench-|make (design-geometry|dynamics|fast-gains|fuzz|campaign-robots)\b", LONG, ""),
    (r"make PYTHON=", LEAVE, "chooses another Python"),
    (r"make (lock|clean|format)\b", LEAVE, "changes the tree"),
    (r"make console\b", SERVE, ""),
    (r"make [a-z-]", RUN, ""),
    (r"\.venv/(lib/cabols_\w+/\w+|bin/python [\w/.]+)", RUN, ""),
    (r"ros2 run cabols_\w+ \w+", RUN, ""),
)  # fmt: skip


@dataclass(frozen=True)
class Command:
    """One command of a page.

    Attributes:
        page: relative to the repository.
        text: as it stands there, without its comment.
        action: RUN, LONG, SERVE or LEAVE; empty if no rule knows it.
        reason: why it is left out.
    """

    page: str
    text: str
    action: str
    reason: str

    @property
    def words(self) -> list[str]:
        """What is executed."""
        found = re.match(r"ros2 run (\w+) (\w+)(.*)", self.text)
        text = ".venv/lib/{}/{}{}".format(*found.groups()) if found else self.text
        return shlex.split(text)


@dataclass(frozen=True)
class Outcome:
    """What became of a command.

    Attributes:
        page: where it stands.
        command: its text.
        result: "passed", "failed" or "left out".
        note: reason, or exit code and last line.
        seconds: that it took.
    """

    page: str
    command: str
    result: str
    note: str
    seconds: float


def pages(root: Path) -> list[Path]:
    """Return the pages whose commands are followed."""
    return [*sorted(root.glob("*.md")), *sorted((root / "docs").rglob("*.md")),
            *sorted((root / "examples").glob("*.md"))]  # fmt: skip


def commands_in(text: str, page: str) -> Iterator[Command]:
    """Yield the commands of a page: lines of its shell blocks, and those within its text."""
    lines = [
        re.sub(r"\s+#.*$", "", re.sub(r"^#.*$", "", line)).strip()
        for block in BLOCK.findall(text)
        for line in block.replace("\\\n", " ").splitlines()
    ]
    for bare in [*lines, *INLINE.findall(re.sub(r"^```.*?^```", "", text, flags=re.M | re.S))]:
        if bare:
            flat = re.sub(r"\s+", " ", bare)
            yield Command(page, flat, *judge(flat))


def judge(text: str) -> tuple[str, str]:
    """Return what to do with a command, and why it is left out; ("", "") if no rule knows it."""
    for pattern, action, reason in RULES:
        if re.match(pattern, text):
            served = re.match(r"ros2 run \w+ (\w+)", text)
            if action == RUN and served and served.group(1) in SERVED and "--help" not in text:
                return SERVE, ""
            return action, reason
    return "", ""


def all_commands(root: Path) -> list[Command]:
    """Return the commands of all pages, each once."""
    found: dict[str, Command] = {}
    for path in pages(root):
        for command in commands_in(path.read_text(encoding="utf-8"), str(path.relative_to(root))):
            found.setdefault(command.text, command)
    return list(found.values())


def missing(root: Path, commands: Iterable[Command]) -> list[str]:
    """List the make targets, executables and launch files that commands name and nobody has."""
    targets = set(re.findall(r"^([a-z-]+):", (root / "Makefile").read_text(), re.MULTILINE))
    found = []
    for command in commands:
        words = command.text.split()
        if words[0] == "make":
            named = {w for w in shlex.split(command.text)[1:] if re.fullmatch(r"[a-z-]+", w)}
            if not named <= targets:
                found.append(f"{command.page}: {command.text}: no such target")
        script = re.search(r"ros2 run (\w+) ([\w-]+)|\.venv/lib/(\w+)/([\w-]+)", command.text)
        if script:
            package, name = [part for part in script.groups() if part]
            if name.isupper():  # a place to fill in
                continue
            setup = root / package / "setup.cfg"
            if not setup.exists() or not re.search(rf"^\s*{name} *=", setup.read_text(), re.M):
                found.append(f"{command.page}: {command.text}: no such executable")
        launch = re.match(r"ros2 launch (\w+) (\S+)", command.text)
        if launch and not (root / launch.group(1) / "launch" / launch.group(2)).exists():
            found.append(f"{command.page}: {command.text}: no such launch file")
    return found


def follow(command: Command, folder: Path) -> Outcome:
    """Run one command in a folder."""
    if command.action == LEAVE:
        return Outcome(command.page, command.text, "left out", command.reason, 0.0)
    if not command.action:
        note = "no rule knows it: add one to tools/follow_docs.py"
        return Outcome(command.page, command.text, "failed", note, 0.0)
    environment = {**os.environ, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    environment.pop("PYTHONPATH", None)
    began = time.monotonic()
    with subprocess.Popen(
        command.words,
        cwd=folder,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    ) as process:
        interrupted = False
        try:
            output, _ = process.communicate(timeout=PATIENCE_S[command.action])
        except subprocess.TimeoutExpired:
            interrupted = True
            output = _end(process)
    seconds = time.monotonic() - began
    last = next((line for line in reversed(output.splitlines()) if line.strip()), "")[:160]
    served = command.action == SERVE
    passed = process.returncode in ((0, 130, -signal.SIGINT) if served else (0,))
    if served and "Traceback" in output:
        passed, last = False, f"a traceback: {last}"
    if served and not interrupted:
        return Outcome(command.page, command.text, "failed", f"ended by itself: {last}", seconds)
    note = last if passed else f"exit code {process.returncode}: {last}"
    return Outcome(command.page, command.text, "passed" if passed else "failed", note, seconds)


def _end(process: subprocess.Popen[str]) -> str:
    """Interrupt a command and what it started; kill it if that does not end it."""
    os.killpg(process.pid, signal.SIGINT)
    try:
        return process.communicate(timeout=ENDING_S)[0]
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        return process.communicate()[0]


def without_long(command: Command) -> Command:
    """Leave a command out that takes long."""
    if command.action != LONG:
        return command
    return replace(command, action=LEAVE, reason="takes minutes: --long")


def commit() -> str:
    """Return the commit that is followed."""
    done = subprocess.run(
        ["git", "rev-parse", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    return done.stdout.strip()


def fresh_clone(revision: str) -> Path:
    """Return a clone of this repository at a commit; one that is there already is kept."""
    if not (CLONE / ".git").exists():
        subprocess.run(["git", "clone", "--quiet", str(ROOT), str(CLONE)], check=True)
    subprocess.run(["git", "fetch", "--quiet"], cwd=CLONE, check=True)
    subprocess.run(["git", "checkout", "--quiet", "--detach", revision], cwd=CLONE, check=True)
    subprocess.run(["git", "clean", "--quiet", "-fd"], cwd=CLONE, check=True)
    return CLONE


def earlier(revision: str) -> dict[str, Outcome]:
    """Return what has passed already at a commit, by command."""
    if not RESULT.exists():
        return {}
    content = json.loads(RESULT.read_text(encoding="utf-8"))
    found = [Outcome(**row) for row in content["commands"]] if content["commit"] == revision else []
    return {row.command: row for row in found if row.result == "passed"}


def main() -> int:
    """Run the command line; exit code 1 if a command failed."""
    parser = argparse.ArgumentParser(description="Follow the commands of README and docs.")
    parser.add_argument("--here", action="store_true", help="in this tree, not in a fresh clone")
    parser.add_argument("--list", action="store_true", help="tell what would be done, run nothing")
    parser.add_argument("--fresh", action="store_true", help="run what has passed already, too")
    parser.add_argument("--long", action="store_true", help="benchmarks of minutes, too")
    parser.add_argument("--only", default="", help="commands that hold this text")
    options = parser.parse_args()
    chosen = [command for command in all_commands(ROOT) if options.only in command.text]
    if options.list:
        for command in chosen:
            print(f"{command.action or 'NOT KNOWN':9}  {command.text}  {command.reason}")
        return 0
    revision = commit()
    done = {} if options.fresh else earlier(revision)
    folder = ROOT if options.here else fresh_clone(revision)
    if chosen and not options.here:
        subprocess.run(["make", "setup"], cwd=folder, check=True)
    if not options.long:
        chosen = [without_long(command) for command in chosen]
    for command in chosen:
        if command.text not in done:
            outcome = follow(command, folder)
            done[command.text] = outcome
            print(f"{outcome.result:8} {outcome.seconds:6.0f} s  {command.text}  {outcome.note}",
                  flush=True)  # fmt: skip
            RESULT.parent.mkdir(exist_ok=True)
            rows = [asdict(row) for row in done.values()]
            text = json.dumps({"commit": revision, "commands": rows}, indent=2)
            RESULT.write_text(text + "\n", encoding="utf-8")
    rows_by = {
        r: sum(o.result == r for o in done.values()) for r in ("passed", "failed", "left out")
    }
    print(", ".join(f"{count} {name}" for name, count in rows_by.items()), f"({RESULT})")
    return 1 if rows_by["failed"] else 0


if __name__ == "__main__":
    sys.exit(main())
