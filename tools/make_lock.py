# SPDX-License-Identifier: Apache-2.0
"""Write requirements.lock from requirements.in, with one version for all Pythons where it exists.

Usage: make_lock.py PYTHON [PYTHON ...]     (the first one's answer is preferred for the others)
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
HEADER = """\
# Made by tools/make_lock.py from requirements.in (`make lock`); edit that file instead.
# Everything that `make setup` installs, for CPython {pythons}, Linux on x86-64.
"""


def canonical(name: str) -> str:
    """Return the name of a distribution as package indices spell it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def resolve(python: str, wanted: list[str], hints: dict[str, str]) -> dict[str, str]:
    """Ask one Python's pip what it would install into an empty environment."""
    with tempfile.TemporaryDirectory() as scratch:
        venv, report = Path(scratch, "venv"), Path(scratch, "report.json")
        subprocess.run([python, "-m", "venv", str(venv)], check=True)
        pip = [str(venv / "bin/pip"), "install", "--quiet"]
        subprocess.run([*pip, "--upgrade", "pip"], check=True)
        for constraints in (hints, {}):
            text = "".join(f"{name}=={version}\n" for name, version in constraints.items())
            Path(scratch, "constraints.txt").write_text(text)
            command = [*pip, "--dry-run", "--ignore-installed", "--report", str(report)]
            command += ["--constraint", str(Path(scratch, "constraints.txt")), *wanted]
            done = subprocess.run(command, check=False)
            if done.returncode == 0:
                break
        done.check_returncode()
        items = json.loads(report.read_text())["install"]
    return {canonical(i["metadata"]["name"]): i["metadata"]["version"] for i in items}


def python_version(python: str) -> str:
    """Return "3.11" for the path of a Python 3.11."""
    code = "import sys; print('%d.%d' % sys.version_info[:2])"
    return subprocess.run(
        [python, "-c", code], check=True, capture_output=True, text=True
    ).stdout.strip()


def lock_lines(answers: dict[str, dict[str, str]]) -> list[str]:
    """Merge the answers, by Python version, with markers where they differ."""
    lines = []
    for name in sorted({name for answer in answers.values() for name in answer}):
        pythons_of: dict[str, list[str]] = {}
        for python, answer in answers.items():
            if name in answer:
                pythons_of.setdefault(answer[name], []).append(python)
        for version, pythons in sorted(pythons_of.items()):
            marker = " or ".join(f'python_version == "{python}"' for python in sorted(pythons))
            everywhere = len(pythons) == len(answers)
            lines.append(f"{name}=={version}" + ("" if everywhere else f" ; {marker}"))
    return lines


def main(pythons: list[str]) -> None:
    """Resolve with each Python and write the lock file."""
    if not pythons:
        sys.exit(__doc__)
    lines = (ROOT / "requirements.in").read_text().splitlines()
    wanted = [line.split("#")[0].strip() for line in lines if line.split("#")[0].strip()]
    answers: dict[str, dict[str, str]] = {}
    for python in pythons:
        version = python_version(python)
        print(f"resolving for Python {version} ...", flush=True)
        answers[version] = resolve(python, wanted, next(iter(answers.values()), {}))
    header = HEADER.format(pythons=", ".join(sorted(answers)))
    (ROOT / "requirements.lock").write_text(header + "\n".join(lock_lines(answers)) + "\n")


if __name__ == "__main__":
    main(sys.argv[1:])
