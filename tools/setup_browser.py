# SPDX-License-Identifier: Apache-2.0
"""See to it that there is a Chromium for the console's tests: find one, or install it.

Installs only as root on a system with apt-get, such as a build machine; anybody else is told the
command: the tests that need a browser then fail, the others run all the same. Standard library
only.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys

NAMES = ("chromium", "chromium-browser", "google-chrome")
PATIENCE_S = 900


def found() -> str:
    """Path of a Chromium; empty if there is none."""
    return next(filter(None, map(shutil.which, NAMES)), "")


def install() -> str:
    """Install Debian's Chromium; returns why that did not work, empty if it did."""
    environment = {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}
    command = ["apt-get", "install", "-y", "--no-install-recommends", "chromium"]
    for step in (["apt-get", "update"], command):
        print(f"setup: {' '.join(step)}", flush=True)
        try:
            done = subprocess.run(
                step,
                check=False,
                env=environment,
                capture_output=True,
                text=True,
                timeout=PATIENCE_S,
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            return str(error)
        # Without fresh lists the package may still be known.
        if done.returncode and step is command:
            return done.stderr.strip()[-600:]
    return ""


def main() -> int:
    """Look, install where that is possible, say what to do where it is not; always 0."""
    if found():
        return 0
    reason = "no Chromium found, which the console's tests drive"
    if os.geteuid() == 0 and shutil.which("apt-get"):
        reason = install()
        if found():
            print(f"setup: {found()} is there", flush=True)
            return 0
    print(f"setup: {reason}\nInstall it: sudo apt-get install chromium", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
