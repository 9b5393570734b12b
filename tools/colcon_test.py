# SPDX-License-Identifier: Apache-2.0
"""Run `colcon test` on the packages that `make setup` has built into .venv.

python tools/colcon_test.py [colcon's arguments]

Exit code: that of colcon, 1 if a package's tests failed.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence

from setup_workspace import BUILD, ROOT, VENV, clean_environment

PACKAGES = ("cabols_control", "cabols_hw", "cabols_stiffness", "cabols_sim")


def main(words: Sequence[str]) -> int:
    """Test one package after the other: their graphs would disturb each other."""
    environment = clean_environment()
    environment.update(
        AMENT_PREFIX_PATH=str(VENV),
        CMAKE_PREFIX_PATH=str(VENV),
        PATH=f"{VENV / 'bin'}{os.pathsep}{environment.get('PATH', '')}",
    )
    command = [str(VENV / "bin/colcon"), "--log-base", str(BUILD / "colcon/log"), "test"]
    command += ["--base-paths", *(str(ROOT / name) for name in PACKAGES)]
    command += ["--build-base", str(BUILD / "colcon"), "--test-result-base", str(BUILD / "colcon")]
    command += ["--merge-install", "--install-base", str(VENV)]
    command += ["--executor", "sequential", "--event-handlers", "console_direct+"]
    command += ["--return-code-on-test-failure", *words]
    return subprocess.run(command, check=False, env=environment, cwd=ROOT).returncode


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
