# SPDX-License-Identifier: Apache-2.0
"""The simulated rig with its console, led by a browser and watched on the graph."""

from __future__ import annotations

import socket
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import yaml
from cabols_msgs.msg import Mode
from playwright.sync_api import expect

from cabols_control.rig_folder import rig_file

TALL = {"width": 1280, "height": 720}
SLOW = 0.1
"""A browser that draws in software shares the cores: the rig's time passes slowly."""
PATIENCE_S, ASK_AGAIN_S = 180.0, 15.0
LIVE = "window.cabolsFrames > 3"
ZEROED = "[...document.querySelectorAll('[id^=\"z-\"]')].every(e => e.textContent === 'zero set')"


def free_port() -> int:
    """A TCP port that nobody has."""
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


def console_values(folder: Any, port: int, **more: Any) -> dict[str, Any]:
    """Arguments of the bench with a console."""
    return {
        "console": True,
        "console_port": port,
        "campaigns": str(folder / "campaigns"),
        "uploads": str(folder / "programs"),
        "speed": SLOW,
        "watchdog": 0.1,
        "command_timeout": 0.1,
        "stale_after": 3.0,
        "state_timeout": 5.0,
        "operator_timeout": 120.0,
        **more,
    }


def short_campaign(path: Path, configurations: list[int], paths: int) -> None:
    """Write a small part of the bench's campaign, of few configurations."""
    whole = yaml.safe_load(rig_file("campaign.yaml").read_text("utf-8"))
    for key in ("validation_configurations", "validation_paths"):
        whole.pop(key, None)
    whole.update(configurations=configurations, paths=whole["paths"][:paths])
    path.write_text(yaml.safe_dump(whole), encoding="utf-8")


class Panel:
    """The page as an operator uses it: by names and roles, never by a script behind it."""

    def __init__(self, page: Any, port: int) -> None:
        self.page = page
        self.address = f"http://127.0.0.1:{port}"
        self.errors: list[str] = []
        self.foreign: list[str] = []
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.on("request", self._note)

    def _note(self, request: Any) -> None:
        local = (self.address, self.address.replace("http", "ws", 1), "data:", "blob:")
        if not request.url.startswith(local):
            self.foreign.append(request.url)

    def open(self) -> Panel:
        self.page.goto(self.address)
        self.wait_for(LIVE)
        return self

    def wait_for(self, condition: str) -> None:
        """Wait for a condition in the page; asked by the clock, as a busy browser draws rarely."""
        self.page.wait_for_function(condition, polling=100)

    def press(self, name: str) -> None:
        """Press a button by its data-name, once it is enabled."""
        self.page.locator(f"[data-name={name}]").click()

    def expect_disabled(self, name: str) -> None:
        """A button follows the rig within half a second."""
        expect(self.page.locator(f"[data-name={name}]")).to_be_disabled()

    def text(self, name: str) -> str:
        return str(self.page.locator(f"[data-name={name}]").inner_text())

    def take_command(self) -> None:
        self.page.get_by_role("button", name="Take command").click()
        self.page.get_by_text("You are in command", exact=False).first.wait_for()

    def wait_mode(self, name: str) -> None:
        self.page.wait_for_selector(f'#mode-chip[data-mode="{name}"]')

    def wait_text(self, selector: str, text: str) -> None:
        self.page.locator(selector).filter(has_text=text).first.wait_for()

    def log(self) -> str:
        return str(self.page.locator("#log").inner_text())

    def change_mode(self, watcher: Any, name: str) -> None:
        """Ask for a mode and see it on the graph, then on the page.

        While a busy computer's reports are late the rig refuses; an operator then asks again.
        """
        wanted = getattr(Mode, name)
        give_up = time.monotonic() + PATIENCE_S
        while watcher.modes()[-1] != wanted:
            assert time.monotonic() < give_up, f"no {name}; the page's log:\n{self.log()}"
            self.press(f"mode-{name}")
            with suppress(AssertionError):
                watcher.wait(lambda: watcher.modes()[-1] == wanted, name, ASK_AGAIN_S)
        self.wait_mode(name)

    def pretighten_and_load(self, watcher: Any) -> None:
        """From STOPPED to LOADING, as seen on the graph."""
        self.change_mode(watcher, "PRETIGHTENING")
        watcher.wait(lambda: all(watcher.seen["limb_state"][-1].zeroed), "all limbs zeroed")
        self.wait_for(ZEROED)
        self.change_mode(watcher, "LOADING")
