# SPDX-License-Identifier: Apache-2.0
"""A page of the console without a browser: what its server has to do for one, and no drawing.

Run as a program of its own: `console_page.py PORT SECONDS CORE`, -1 for any core; prints one line
of JSON. It fetches the page, speaks NiceGUI's socket.io and reads the wire, acknowledging as the
page's script does.
"""

from __future__ import annotations

import asyncio
import json
import os
import re
import socket
import sys
import time
import uuid
from contextlib import suppress

import httpx
import socketio
import websockets

ACK_S = 0.4
PATIENCE_S = 90.0


async def page(port: int, seconds: float) -> dict[str, float]:
    """Be one page for so long; return how many frames came."""
    text = await fetch(f"http://127.0.0.1:{port}/")
    found = re.search(r'console-settings">(.*?)</script>', text)
    assert found, "no settings on the page"
    own = json.loads(found[1])["page"]
    events = socketio.AsyncClient(reconnection=False)
    names = {"client_id": own, "tab_id": str(uuid.uuid4()), "document_id": str(uuid.uuid4())}
    query = "&".join(f"{k}={v}" for k, v in names.items())
    await events.connect(
        f"http://127.0.0.1:{port}/?{query}&implicit_handshake=true&next_message_id=0",
        transports=["websocket"],
        socketio_path="/_nicegui_ws/socket.io",
    )
    frames, newest, acked = 0, 0, 0.0
    stamps = []
    # The console may end first: then what has come by then counts.
    with suppress(websockets.ConnectionClosed):
        wire = await websockets.connect(f"ws://127.0.0.1:{port}/live?page={own}")
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            message = json.loads(await wire.recv())
            now = time.monotonic()
            if message["k"] == "f":
                frames, newest = frames + 1, message["n"]
                stamps.append(now)
            if message["k"] == "p" or now - acked > ACK_S:
                acked = now
                await wire.send(json.dumps({"a": newest}))
    alive = float(events.connected)
    with suppress(Exception):
        await events.disconnect()
    span = stamps[-1] - stamps[0]
    return {"frames": frames, "rate_hz": (frames - 1) / span, "alive": alive}


async def fetch(address: str) -> str:
    """Fetch the page once it is served."""
    give_up = time.monotonic() + PATIENCE_S
    while not is_served(address):
        assert time.monotonic() < give_up, f"nobody serves {address}"
        await asyncio.sleep(0.2)
    async with httpx.AsyncClient() as client:
        return (await client.get(address)).text


def is_served(address: str) -> bool:
    """Whether somebody listens."""
    with socket.socket() as wire:
        return wire.connect_ex(("127.0.0.1", int(address.strip("/").rpartition(":")[2]))) == 0


if __name__ == "__main__":
    if int(sys.argv[3]) >= 0:
        os.sched_setaffinity(0, {int(sys.argv[3])})
    print(json.dumps(asyncio.run(page(int(sys.argv[1]), float(sys.argv[2])))))
