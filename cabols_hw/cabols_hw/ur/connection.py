# SPDX-License-Identifier: Apache-2.0
"""One connection to a controller's RTDE port: handshake, packages, deadlines."""

from __future__ import annotations

import socket
import threading
import time
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from cabols_hw.abb.errors import RobotError
from cabols_hw.ur.rtde import (
    PORT,
    Package,
    PackageType,
    Recipe,
    Splitter,
    packed,
    request_version,
    setup_inputs,
    setup_outputs,
)


class RtdeConnection:
    """Sends and receives packages; one thread reads, any may write.

    Attributes:
        version: of the controller's software, "5.14.0.0"; empty if it does not tell.
    """

    def __init__(
        self,
        address: tuple[str, int],
        outputs: Sequence[str],
        inputs: Sequence[str],
        rate: float,
        timeout_s: float,
    ) -> None:
        """Connect, agree on the recipes, start the data.

        Args:
            address: host and port; port 0: RTDE's own.
            outputs: fields that the controller sends.
            inputs: fields that this client writes; empty: it only reads.
            rate: packages a second [Hz].
            timeout_s: for all of it.

        Raises:
            RobotError: if the controller does not answer, or refuses something.
        """
        host, port = address
        self._where = f"{host}:{port or PORT}"
        self._splitter = Splitter()
        self._packages: deque[Package] = deque()
        self._lock = threading.Lock()
        deadline = time.monotonic() + timeout_s
        try:
            self._link = socket.create_connection((host, port or PORT), timeout_s)
        except OSError as error:
            raise RobotError(
                f"robot: no RTDE connection to {self._where} ({error}): check address, cable and "
                "that the controller is on"
            ) from error
        self._link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        try:
            self._agree(outputs, inputs, rate, deadline)
        except BaseException:
            self.close()
            raise

    def _agree(
        self, outputs: Sequence[str], inputs: Sequence[str], rate: float, deadline: float
    ) -> None:
        answer = self._ask(request_version(), PackageType.REQUEST_PROTOCOL_VERSION, deadline)
        if answer[:1] != b"\x01":
            raise RobotError(
                f"robot: {self._where} does not speak RTDE version 2: update the controller's "
                "software to 3.2 or later"
            )
        version = self._ask(
            packed(PackageType.GET_URCONTROL_VERSION), PackageType.GET_URCONTROL_VERSION, deadline
        )
        parts = [int.from_bytes(version[k : k + 4], "big") for k in range(0, len(version), 4)]
        self.version = ".".join(str(part) for part in parts)
        kind = PackageType.SETUP_OUTPUTS
        self.outputs = Recipe(outputs, self._ask(setup_outputs(outputs, rate), kind, deadline))
        self.inputs: Recipe | None = None
        if inputs:
            kind = PackageType.SETUP_INPUTS
            self.inputs = Recipe(inputs, self._ask(setup_inputs(inputs), kind, deadline))
        if self._ask(packed(PackageType.START), PackageType.START, deadline)[:1] != b"\x01":
            raise RobotError(f"robot: {self._where} refuses to send RTDE data: restart it")

    def _ask(self, request: bytes, kind: PackageType, deadline: float) -> bytes:
        self.send(request)
        while True:
            left = deadline - time.monotonic()
            package = self._next(left) if left > 0.0 else None
            if package is None:
                raise RobotError(
                    f"robot: no answer to {kind.name} from {self._where}: is it the RTDE port of a "
                    "controller?"
                )
            if package.kind == kind:
                return package.payload

    def _next(self, timeout_s: float) -> Package | None:
        """Next package within a time; None if none came."""
        give_up = time.monotonic() + timeout_s
        while not self._packages:
            left = give_up - time.monotonic()
            if not left > 0.0:
                return None
            try:
                self._link.settimeout(max(left, 1e-4))
                received = self._link.recv(65536)
            except TimeoutError:
                return None
            except OSError as error:
                raise self._lost(error) from error
            if not received:
                raise self._lost(ConnectionError("closed by the controller"))
            self._packages.extend(self._splitter.feed(received))
        return self._packages.popleft()

    def _lost(self, error: OSError) -> RobotError:
        return RobotError(f"robot: the RTDE connection to {self._where} was lost ({error})")

    def newest(self, timeout_s: float) -> tuple[dict[str, Any], int] | None:
        """Values of the newest data package, and how many came; None if none came in time.

        Args:
            timeout_s: longest wait for the first [s].

        Raises:
            RobotError: if the connection is lost or sends something else.
        """
        give_up = time.monotonic() + timeout_s
        values, count = None, 0
        while True:
            wait = 0.0 if values is not None else max(give_up - time.monotonic(), 0.0)
            package = self._next(max(wait, 1e-4)) if (wait or not count) else self._waiting()
            if package is None:
                return None if values is None else (values, count)
            if package.kind == PackageType.DATA_PACKAGE:
                values, count = self.outputs.read(package.payload), count + 1

    def _waiting(self) -> Package | None:
        """Next package that has arrived already."""
        if not self._packages:
            return self._next(1e-4)
        return self._packages.popleft()

    def write(self, values: Sequence[float]) -> None:
        """Write all inputs.

        Args:
            values: in the order of the recipe.

        Raises:
            RobotError: if the connection is lost.
        """
        assert self.inputs is not None
        self.send(self.inputs.write(values))

    def send(self, raw: bytes) -> None:
        """Send bytes, whole.

        Args:
            raw: of one package.

        Raises:
            RobotError: if the connection is lost.
        """
        try:
            with self._lock:
                self._link.settimeout(1.0)
                self._link.sendall(raw)
        except OSError as error:
            raise self._lost(error) from error

    def close(self) -> None:
        """Close; a thread that reads ends with a RobotError."""
        with suppress(OSError):
            self._link.shutdown(socket.SHUT_RDWR)
        self._link.close()
