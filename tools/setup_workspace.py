# SPDX-License-Identifier: Apache-2.0
"""Set up .venv with everything that cabols needs, and build the workspace into it.

Does nothing that is already done: each step leaves a stamp of what it was made from in
.venv/.cabols, written when the step has ended well. Runs on any Python 3.8 or later, standard
library only; the environment itself needs CPython 3.10 to 3.13 on x86-64 Linux.

Environment: PYTHON names the Python to use (default: the best one found).
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import json
import os
import platform
import re
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
VENV = ROOT / ".venv"
STAMPS = VENV / ".cabols"
LOCK = ROOT / "requirements.lock"
BUILD = ROOT / "build"
LOG = BUILD / "setup.log"

VERSIONS = ((3, 11), (3, 12), (3, 13), (3, 10))  # best tried first
HEARTBEAT_S = 20.0
TAIL_LINES = 25
# Left by a sourced ROS workspace or by an active environment, these would mix two installations.
FOREIGN = {
    "AMENT_PREFIX_PATH",
    "CMAKE_PREFIX_PATH",
    "COLCON_PREFIX_PATH",
    "LD_LIBRARY_PATH",
    "PYTHONDONTWRITEBYTECODE",
    "PYTHONHOME",
    "PYTHONPATH",
    "RMW_IMPLEMENTATION",
    "ROS_DISTRO",
    "ROS_PYTHON_VERSION",
    "ROS_VERSION",
    "VIRTUAL_ENV",
    "_ROS_WHEELS_BOOTSTRAP_COMPLETE",
}
# The wheels' CMake files carry the paths of the machine that built them.
BAKED_PYTHON = re.compile(r"/opt/python/cp\d+-cp\d+/include/python3\.\d+")
BAKED_NUMPY = re.compile(
    r"/opt/python/cp\d+-cp\d+/lib/python3\.\d+/site-packages/numpy/(?:_core|core)/include"
)
PROBE = """
import importlib.util, json, os, platform, sys, sysconfig
print(json.dumps({
    "executable": sys.executable,
    "version": list(sys.version_info[:2]),
    "cpython": platform.python_implementation() == "CPython",
    "has_venv": all(importlib.util.find_spec(name) for name in ("venv", "ensurepip")),
    "has_headers": os.path.exists(os.path.join(sysconfig.get_path("include"), "Python.h")),
}))
"""


class SetupError(Exception):
    """Set-up cannot go on; the message says why and what to do."""


def say(text: str) -> None:
    """Print one line of progress at once."""
    print(f"setup: {text}", flush=True)


def clean_environment() -> dict[str, str]:
    """Return this process's environment without what belongs to another installation."""
    return {key: value for key, value in os.environ.items() if key not in FOREIGN}


def run(what: str, command: list[str], environment: dict[str, str] | None = None) -> None:
    """Run one step with its output in the log; raise SetupError with the log's end if it fails."""
    say(what)
    start = time.monotonic()
    with LOG.open("a") as log:
        log.write(f"\n$ {shlex.join(command)}\n")
        log.flush()
        position = log.tell()
        process = subprocess.Popen(
            command,
            cwd=ROOT,
            env=environment or clean_environment(),
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=subprocess.STDOUT,
        )
        while True:
            try:
                code = process.wait(timeout=HEARTBEAT_S)
                break
            except subprocess.TimeoutExpired:
                say(f"  ... {time.monotonic() - start:.0f} s")
            except BaseException:
                process.terminate()
                process.wait()
                raise
    if code != 0:
        with LOG.open(errors="replace") as log:
            log.seek(position)
            tail = "".join(log.readlines()[-TAIL_LINES:])
        raise SetupError(f"failed with code {code}; the end of {LOG}:\n\n{tail}")
    say(f"  done in {time.monotonic() - start:.0f} s")


# --- Python and the other prerequisites ---


def probe(python: str) -> dict[str, Any] | None:
    """Ask one Python what it is and has; None if it does not run or is of no use."""
    try:
        done = subprocess.run(
            [python, "-c", PROBE],
            env=clean_environment(),
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=30,
            check=True,
        )
        found: dict[str, Any] = json.loads(done.stdout)
    except (OSError, subprocess.SubprocessError, ValueError):
        return None
    return found if found["cpython"] and tuple(found["version"]) in VERSIONS else None


def candidates(version: tuple[int, int]) -> Iterator[str]:
    """Yield Pythons that may be of a version: by name, then pyenv's."""
    name = f"python{version[0]}.{version[1]}"
    for command in (name, "python3"):
        found = shutil.which(command)
        if found:
            yield found
    pyenv = Path(os.environ.get("PYENV_ROOT") or Path.home() / ".pyenv") / "versions"
    for path in sorted(pyenv.glob(f"{version[0]}.{version[1]}.*/bin/{name}"), reverse=True):
        yield str(path)


def lacks(python: dict[str, Any]) -> str:
    """Say what a Python lacks and the command that installs it; empty if nothing."""
    name = "python{}.{}".format(*python["version"])
    missing = []
    if not python["has_venv"]:
        missing.append((f"{name}'s venv module", f"{name}-venv"))
    if not python["has_headers"]:
        missing.append((f"{name}'s headers (Python.h)", f"{name}-dev"))
    if not missing:
        return ""
    what = " and ".join(thing for thing, _ in missing)
    return f"{what} not found. Install: sudo apt install {' '.join(name for _, name in missing)}"


def find_python() -> dict[str, Any]:
    """Return the Python to make the environment with.

    Raises:
        SetupError: if there is none, or none that is complete.
    """
    asked = os.environ.get("PYTHON")
    if asked:
        chosen = probe(asked)
        if chosen is None:
            raise SetupError(f"PYTHON={asked}: not a CPython 3.10 to 3.13")
        if lacks(chosen):
            raise SetupError(lacks(chosen))
        return chosen
    incomplete = []
    for version in VERSIONS:
        for path in candidates(version):
            found = probe(path)
            if found is None or tuple(found["version"]) != version:
                continue
            if not lacks(found):
                return found
            incomplete.append(found)
    if incomplete:
        raise SetupError(lacks(incomplete[0]))
    raise SetupError(
        "no Python 3.10 to 3.13 found. Install one (sudo apt install python3 python3-venv "
        "python3-dev, or pyenv), or name it: make PYTHON=/path/to/python3.11"
    )


def check_machine() -> None:
    """Raise SetupError, naming the remedy, for what the set-up itself cannot bring."""
    if sys.platform != "linux" or platform.machine() != "x86_64":
        raise SetupError(
            f"the ROS wheels are for Linux on x86-64, this is {sys.platform} on "
            f"{platform.machine()}. Use a ROS 2 Jazzy installation: docs/installing.md"
        )
    if re.search(r"\s", str(ROOT)):
        raise SetupError(f"the path contains a space, which ROS's tools do not bear: {ROOT}")
    if not shutil.which(os.environ.get("CXX") or "g++"):
        raise SetupError("no C++ compiler found. Install: sudo apt install g++")


# --- stamps ---


def digest_of(folder: Path, *more: str) -> str:
    """Return a digest of a folder's files (names and contents) and of some more text."""
    result = hashlib.sha256("\0".join(more).encode())
    for path in sorted(folder.rglob("*")):
        parts = path.relative_to(folder).parts
        hidden = any(part.startswith(".") or part == "__pycache__" for part in parts)
        if hidden or path.suffix == ".pyc" or not path.is_file():
            continue
        result.update("/".join(parts).encode() + b"\0" + path.read_bytes() + b"\0")
    return result.hexdigest()


def is_stamped(name: str, digest: str) -> bool:
    """Tell whether a step was done from what is there now."""
    stamp = STAMPS / name
    return stamp.exists() and stamp.read_text() == digest


@contextlib.contextmanager
def stamped(name: str, digest: str) -> Iterator[None]:
    """Stamp a step when its body ends well; until then it counts as not done."""
    STAMPS.mkdir(parents=True, exist_ok=True)
    stamp = STAMPS / name
    with contextlib.suppress(FileNotFoundError):
        stamp.unlink()
    yield
    partial = stamp.with_suffix(".partial")
    partial.write_text(digest)
    partial.replace(stamp)


# --- the steps ---


def wheels_digest() -> str:
    """Return what the installed wheels depend on: the lock, and where .venv is."""
    return hashlib.sha256(LOCK.read_bytes() + str(VENV).encode()).hexdigest()


def make_venv() -> None:
    """Make .venv, or keep it if it was made in this place and is of the Python asked for."""
    place = STAMPS / "place"
    if place.exists() and place.read_text() == str(VENV) and is_of_asked_python():
        return
    python = find_python()
    version = "{}.{}".format(*python["version"])
    command = [python["executable"], "-m", "venv", "--clear", str(VENV)]
    run(f"making .venv with Python {version} ({python['executable']})", command)
    with stamped("place", str(VENV)):
        pass


def install_wheels() -> None:
    """Install what the lock file says.

    setuptools and wheel go first: one locked package comes as a source distribution, and
    building it in isolation would fetch versions that no lock pins.
    """
    lines = LOCK.read_text().splitlines()
    tools = [line for line in lines if re.match(r"(setuptools|wheel)==", line)]
    pip = [str(VENV / "bin/python"), "-m", "pip", "install", "--disable-pip-version-check"]
    count = sum("==" in line for line in lines)
    run("installing the build tools", [*pip, *tools])
    run(
        f"installing {count} packages from requirements.lock (the first time 2 to 5 minutes)",
        [*pip, "--no-build-isolation", "--requirement", str(LOCK)],
    )


def mend_baked_paths() -> None:
    """Point the wheels' CMake files to this Python's and numpy's headers."""
    code = "import numpy, sysconfig as s; print(s.get_path('include')); print(numpy.get_include())"
    answer = subprocess.run(
        [str(VENV / "bin/python"), "-c", code],
        env=clean_environment(),
        check=True,
        capture_output=True,
        text=True,
    )
    python_include, numpy_include = answer.stdout.split()
    for path in VENV.glob("share/*/cmake/*.cmake"):
        old = path.read_text()
        new = BAKED_NUMPY.sub(numpy_include, BAKED_PYTHON.sub(python_include, old))
        if "/opt/python/" in new:
            raise SetupError(f"{path}: a path of the wheel's build machine that is not known here")
        if new != old:
            path.write_text(new)


def packages() -> list[Path]:
    """Return the workspace's packages, messages first."""
    found = [path.parent for path in ROOT.glob("*/package.xml")]
    return sorted(found, key=lambda path: (not is_cmake(path), path.name))


def is_cmake(package: Path) -> bool:
    """Tell a CMake package from a Python one."""
    return (package / "CMakeLists.txt").exists()


def remove_old_modules(package: Path) -> None:
    """Remove an installed Python package's files, so that a deleted module does not live on.

    Caches stay, they cost much to make again; drop_stale_kernels removes those that must go.
    """
    shutil.rmtree(BUILD / "colcon" / package.name, ignore_errors=True)
    shutil.rmtree(VENV / "lib" / package.name, ignore_errors=True)
    shutil.rmtree(VENV / "share" / package.name, ignore_errors=True)
    for site_packages in VENV.glob("lib/python3.*/site-packages"):
        for path in list((site_packages / package.name).rglob("*")):
            if path.is_file() and path.parent.name != "__pycache__":
                path.unlink()
        for path in site_packages.glob(f"{package.name}-*.egg-info"):
            shutil.rmtree(path, ignore_errors=True)


def colcon_build(names: list[str]) -> None:
    """Build packages into .venv, which is an ament prefix as well."""
    environment = clean_environment()
    environment.update(
        AMENT_PREFIX_PATH=str(VENV),
        CMAKE_PREFIX_PATH=str(VENV),
        PATH=f"{VENV / 'bin'}{os.pathsep}{environment.get('PATH', '')}",
    )
    command = [str(VENV / "bin/colcon"), "--log-base", str(BUILD / "colcon/log"), "build"]
    command += ["--base-paths", *(str(ROOT / name) for name in names)]
    command += ["--packages-select", *names]
    command += ["--build-base", str(BUILD / "colcon")]
    command += ["--merge-install", "--install-base", str(VENV)]
    command += ["--event-handlers", "console_direct+", "console_start_end-"]
    command += ["--cmake-args", "-G", "Ninja", "-DCMAKE_BUILD_TYPE=Release", "-DBUILD_TESTING=OFF"]
    command += [f"-DPython3_EXECUTABLE={VENV / 'bin/python'}"]
    run(f"building {', '.join(names)}", command, environment)


def build_packages() -> None:
    """Build the packages whose files changed; Python ones together, as each start costs."""
    digests = {path.name: digest_of(path, wheels_digest()) for path in packages()}
    changed = [path for path in packages() if not is_stamped(path.name, digests[path.name])]
    python_packages = [path for path in changed if not is_cmake(path)]
    groups = [[path] for path in changed if is_cmake(path)] + [python_packages]
    for group in filter(None, groups):
        with contextlib.ExitStack() as stack:
            for path in group:
                stack.enter_context(stamped(path.name, digests[path.name]))
                if not is_cmake(path):
                    remove_old_modules(path)
            colcon_build([path.name for path in group])
    if python_packages:
        drop_stale_kernels()
        warm_up()


def drop_stale_kernels() -> None:
    """Remove numba's caches if any file with compiled functions has changed.

    numba looks only at the file of a function itself: a cached function would go on with the old
    code of another file's function that was compiled into it.
    """
    sources = [
        path
        for package in packages()
        for path in sorted((package / package.name).rglob("*.py"))
        if re.search(r"^@(njit|compiled)", path.read_text(), re.MULTILINE)
    ]
    contents = b"".join(path.read_bytes() for path in sources)
    digest = hashlib.sha256(contents).hexdigest()
    if is_stamped("kernels", digest):
        return
    with stamped("kernels", digest):
        for pattern in ("*.nbi", "*.nbc"):
            for path in VENV.glob(f"lib/python3.*/site-packages/cabols_*/**/__pycache__/{pattern}"):
                path.unlink()


def warm_up() -> None:
    """Compile the inner loops now rather than in the first run."""
    try:
        for package in ("cabols_control", "cabols_sim"):
            command = [str(VENV / "bin/python"), "-m", f"{package}.warm_up"]
            run(f"compiling the inner loops of {package}", command)
    except SetupError as error:
        say(f"not compiled ahead, so the first run will be slow: {error}")


def is_of_asked_python() -> bool:
    """Tell whether .venv has a Python that runs, of the version that PYTHON names if it is set."""
    installed = probe(str(VENV / "bin/python"))
    asked = os.environ.get("PYTHON")
    if installed is None or not asked:
        return installed is not None
    wanted = probe(asked)
    return wanted is not None and bool(installed["version"] == wanted["version"])


def is_complete() -> bool:
    """Tell whether there is nothing to do."""
    if os.environ.get("PYTHON") and not is_of_asked_python():
        return False
    return is_stamped("wheels", wheels_digest()) and all(
        is_stamped(path.name, digest_of(path, wheels_digest())) for path in packages()
    )


def set_up() -> None:
    """Do what is not done yet.

    Raises:
        SetupError: if a prerequisite is missing or a step fails.
    """
    start = time.monotonic()
    check_machine()
    LOG.write_text("")
    make_venv()
    if not is_stamped("wheels", wheels_digest()):
        with stamped("wheels", wheels_digest()):
            install_wheels()
            mend_baked_paths()
    build_packages()
    say(f"ready after {time.monotonic() - start:.0f} s")


def main() -> int:
    """Set up, unless all is done; return the exit code."""
    BUILD.mkdir(exist_ok=True)
    with (BUILD / ".setup-lock").open("w") as guard:
        fcntl.flock(guard, fcntl.LOCK_EX)
        try:
            if not is_complete():
                set_up()
        except SetupError as error:
            print(f"setup: {error}", file=sys.stderr)
            return 1
        except KeyboardInterrupt:
            print("setup: interrupted; run it again to go on", file=sys.stderr)
            return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
