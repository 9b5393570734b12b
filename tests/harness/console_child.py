# SPDX-License-Identifier: Apache-2.0
"""A console's server alone with a rig that answers: prints its port, then serves.

python console_child.py FOLDER
"""

from __future__ import annotations

import sys
from pathlib import Path

from cabols_control.console.access import AccessPolicy
from cabols_control.console.dispatcher import Answer, Dispatcher, Settings
from cabols_control.console.latest import LatestValues
from cabols_control.console.server import ConsoleServer, open_socket

SCENE = {"reflectors": [[0, 0, 0]] * 3}


class AnsweringRig:
    """Takes every command."""

    async def call(self, *_):
        return Answer(True, "ok")

    async def start(self, *_):
        return Answer(True, "ok")

    async def cancel(self, *_):
        return Answer(True, "ok")


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    listener = open_socket("127.0.0.1", 0)
    settings = Settings("rig", folder / "uploads", folder / "campaigns", 13, SCENE, 8)
    dispatcher = Dispatcher(AnsweringRig(), LatestValues(), settings)
    print(listener.getsockname()[1], flush=True)
    ConsoleServer(dispatcher, AccessPolicy("127.0.0.1", ""), listener, None).run()
