# SPDX-License-Identifier: Apache-2.0
"""RTDE as the controller speaks it: recipes, data packages, inputs that one client may write."""

from __future__ import annotations

import socket
import struct
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

from cabols_control.errors import CabolsError
from cabols_hw.abb.errors import RobotError
from cabols_hw.ur.rtde import FORMATS, Package, PackageType, Splitter, packed

HOST = "127.0.0.1"
SOFTWARE = (5, 14, 0, 0)
RATE = 500.0
"""Of the controller's own clock [Hz]."""

OUTPUTS: dict[str, str] = {
    "timestamp": "DOUBLE",
    "actual_q": "VECTOR6D",
    "target_q": "VECTOR6D",
    "actual_qd": "VECTOR6D",
    "actual_TCP_pose": "VECTOR6D",
    "target_TCP_pose": "VECTOR6D",
    "actual_TCP_speed": "VECTOR6D",
    "actual_TCP_force": "VECTOR6D",
    "robot_mode": "INT32",
    "safety_mode": "INT32",
    "safety_status_bits": "UINT32",
    "robot_status_bits": "UINT32",
    "runtime_state": "UINT32",
    "speed_scaling": "DOUBLE",
    **{f"output_int_register_{k}": "INT32" for k in range(48)},
    **{f"output_double_register_{k}": "DOUBLE" for k in range(48)},
}
INPUTS: dict[str, str] = {f"input_int_register_{k}": "INT32" for k in range(48)}


class RtdeServerError(CabolsError):
    """The server's port is not available."""


class RtdeServer:
    """Serves clients, each in a thread; sends each what its recipe asks for.

    Attributes:
        port: where it listens.
    """

    def __init__(
        self, read: Callable[[str], Any], write: Callable[[dict[str, int]], None], port: int = 0
    ) -> None:
        """Listen.

        Args:
            read: gives the value of an output field.
            write: takes input fields by name.
            port: of TCP; 0: any.

        Raises:
            RtdeServerError: if the port is taken.
        """
        self._read, self._write = read, write
        try:
            self._listener = socket.create_server((HOST, port))
        except OSError as error:
            raise RtdeServerError(
                f"rtde_port: expected a free TCP port, got {port} ({error.strerror})"
            ) from error
        self.port: int = self._listener.getsockname()[1]
        self._owners: dict[str, _Client] = {}
        self._clients: list[_Client] = []
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._accept, name="rtde", daemon=True)

    def start(self) -> None:
        """Begin to serve."""
        self._thread.start()

    def stop(self) -> None:
        """End, and close all connections."""
        with suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        with self._lock:
            clients = list(self._clients)
        for client in clients:
            client.close()

    def on_truth(self) -> None:
        """Send every started client a data package."""
        with self._lock:
            clients = [client for client in self._clients if client.started]
        for client in clients:
            client.send_data()

    def claim(self, client: _Client, name: str) -> str:
        """Type of an input that a client will write, or why it may not.

        Args:
            client: that asks.
            name: of the field.
        """
        with self._lock:
            if name not in INPUTS:
                return "NOT_FOUND"
            if self._owners.setdefault(name, client) is not client:
                return "IN_USE"
            return INPUTS[name]

    def value(self, name: str) -> Any:
        """Value of an output field.

        Args:
            name: of it.
        """
        return self._read(name)

    def take(self, values: dict[str, int]) -> None:
        """Take inputs.

        Args:
            values: by name.
        """
        self._write(values)

    def forget(self, client: _Client) -> None:
        """Give back what a client held.

        Args:
            client: that has gone.
        """
        with self._lock:
            self._clients.remove(client)
            self._owners = {n: c for n, c in self._owners.items() if c is not client}

    def _accept(self) -> None:
        while True:
            try:
                link, _ = self._listener.accept()
            except OSError:
                return
            link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            client = _Client(self, link)
            with self._lock:
                self._clients.append(client)
            threading.Thread(target=client.serve, name="rtde_client", daemon=True).start()


class _Client:
    """One connection.

    Attributes:
        started: whether it wants data.
    """

    def __init__(self, server: RtdeServer, link: socket.socket) -> None:
        self._server, self._link = server, link
        self._sending = threading.Lock()
        self._outputs: tuple[str, ...] = ()
        self._format = ""
        self._inputs: dict[int, tuple[str, ...]] = {}
        self._every, self._turn = 1, 0
        self.started = False

    def serve(self) -> None:
        splitter = Splitter()
        try:
            while received := self._link.recv(65536):
                for package in splitter.feed(received):
                    self._answer(package)
        except (OSError, RobotError, struct.error, ValueError):
            pass
        self.close()
        self._server.forget(self)

    def close(self) -> None:
        self.started = False
        with suppress(OSError):
            self._link.shutdown(socket.SHUT_RDWR)
        self._link.close()

    def send_data(self) -> None:
        self._turn += 1
        if self._turn % self._every:
            return
        flat: list[Any] = []
        for name in self._outputs:
            value = self._server.value(name)
            flat.extend(value if isinstance(value, (tuple, list)) else (value,))
        raw = struct.pack(f">B{self._format}", 1, *flat)
        with suppress(OSError):
            self._send(PackageType.DATA_PACKAGE, raw)

    def _send(self, kind: PackageType, payload: bytes) -> None:
        with self._sending:
            self._link.sendall(packed(kind, payload))

    def _answer(self, package: Package) -> None:
        kind, payload = package
        if kind == PackageType.REQUEST_PROTOCOL_VERSION:
            fits = payload == struct.pack(">H", 2)
            self._send(PackageType.REQUEST_PROTOCOL_VERSION, bytes([fits]))
        elif kind == PackageType.GET_URCONTROL_VERSION:
            self._send(PackageType.GET_URCONTROL_VERSION, struct.pack(">4I", *SOFTWARE))
        elif kind == PackageType.SETUP_OUTPUTS:
            self._setup_outputs(payload)
        elif kind == PackageType.SETUP_INPUTS:
            self._setup_inputs(payload)
        elif kind in (PackageType.START, PackageType.PAUSE):
            self._send(PackageType(kind), b"\x01")
            self.started = kind == PackageType.START and bool(self._outputs)
        elif kind == PackageType.DATA_PACKAGE:
            self._take(payload)

    def _setup_outputs(self, payload: bytes) -> None:
        (rate,) = struct.unpack_from(">d", payload)
        names = _names(payload[8:])
        types = [OUTPUTS.get(name, "NOT_FOUND") for name in names]
        found = all(kind in FORMATS for kind in types)
        self._outputs = tuple(names) if found else ()
        self._format = "".join(FORMATS[kind] for kind in types) if found else ""
        # The simulated clock gives a truth every 4 ms.
        self._every = max(1, round(250.0 / rate)) if rate > 0.0 else 1
        self._send(PackageType.SETUP_OUTPUTS, bytes([found]) + ",".join(types).encode())

    def _setup_inputs(self, payload: bytes) -> None:
        names = _names(payload)
        types = [self._server.claim(self, name) for name in names]
        number = len(self._inputs) + 1 if all(kind in FORMATS for kind in types) else 0
        if number:
            self._inputs[number] = tuple(names)
        self._send(PackageType.SETUP_INPUTS, bytes([number]) + ",".join(types).encode())

    def _take(self, payload: bytes) -> None:
        names = self._inputs.get(payload[0] if payload else 0)
        if names is not None:
            values = struct.unpack_from(f">{len(names)}i", payload, 1)
            self._server.take(dict(zip(names, values, strict=True)))


def _names(payload: bytes) -> Sequence[str]:
    # Clients may end the list by a comma, which controllers overlook.
    return [name for name in payload.decode("ascii").split(",") if name]
