# SPDX-License-Identifier: Apache-2.0
"""A real Chromium, driven by Playwright: the system's, with its pictures drawn in software."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from playwright.sync_api import expect, sync_playwright

NAMES = ("chromium", "chromium-browser", "google-chrome")
ARGUMENTS = (
    "--no-sandbox",
    "--disable-gpu",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)
PATIENCE_MS = 180_000.0
"""Longest wait for a page or a browser: a busy machine takes its time."""
SIZE = {"width": 1280, "height": 720}


def chromium_path() -> str:
    """Where the system's Chromium is; `make test` installs it where it can."""
    found = next(filter(None, map(shutil.which, NAMES)), None)
    assert found, "no Chromium found; install it: sudo apt-get install chromium"
    return found


@contextmanager
def chromium(profile: Path) -> Iterator[Any]:
    """A browser with an empty profile.

    It draws without a graphics card, which takes a core: nice leaves most of that to the rig's
    loops, but not all, or whatever else the machine has to do would stop the page.
    """
    start = profile / "chromium.sh"
    start.write_text(f'#!/bin/sh\nexec nice -n 5 {chromium_path()} "$@"\n')
    start.chmod(0o755)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch_persistent_context(
            str(profile / "profile"),
            executable_path=start,
            args=list(ARGUMENTS),
            headless=True,
            viewport=SIZE,
            timeout=PATIENCE_MS,
        )
        browser.set_default_timeout(PATIENCE_MS)
        expect.set_options(timeout=PATIENCE_MS)
        try:
            yield browser
        finally:
            browser.close()
