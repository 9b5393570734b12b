# SPDX-License-Identifier: Apache-2.0
"""Sockets: the robot's stream, its controller's web services, the tracker's gRPC, DDS topics."""

from __future__ import annotations

import ctypes
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from concurrent import futures
from contextlib import suppress
from pathlib import Path
from typing import Any

import grpc
from binary_targets import LIVE, answers, check_reading, packets, replies
from engine import Target
from oracles import check, finite

from cabols_control.errors import CabolsError
from cabols_hw.abb.egm.reader import EgmReader
from cabols_hw.abb.rws.client import RwsSession
from cabols_hw.abb.rws.dialects import RWS_1
from cabols_hw.abb.rws.http_exchange import Deadline
from cabols_hw.tracker import tracker_pb2 as pb
from cabols_hw.tracker.client import TrackerClient
from cabols_hw.tracker.config import load_tracker_config

HOST = "127.0.0.1"
ASK_S = 0.12
"""Time of a request in these tests; answers that never end cost as much [s]."""


def open_stream() -> Callable[[bytes], bool]:
    """Datagrams on the robot's port."""
    reader = EgmReader(port=0)
    fed = 0
    sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sender.bind((HOST, 0))

    def feed(data: bytes) -> bool:
        nonlocal reader, fed
        fed += 1
        if fed % 20 == 0:
            # Else the highest number that was sent would make all later ones old.
            reader.close()
            reader = EgmReader(port=0)
        counted = reader.counter.received + sum(reader.counter.refused.values())
        sender.sendto(data[:60000], (HOST, reader.port))
        found = None
        give_up = time.monotonic() + 0.5
        after = counted
        while found is None and after == counted and time.monotonic() < give_up:
            found = reader.take(0.001)
            after = reader.counter.received + sum(reader.counter.refused.values())
        check(after > counted or found is not None, "EGM: a datagram that was not counted")
        if found is None:
            return False
        finite(found.joints, "EGM")
        finite(found.position, "EGM")
        return True

    return feed


class RawServer:
    """Answers every request with given bytes, then closes or keeps the connection."""

    def __init__(self) -> None:
        self.answer = b""
        self._listener = socket.create_server((HOST, 0), backlog=64)
        self.port = self._listener.getsockname()[1]
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self) -> None:
        while True:
            link, _ = self._listener.accept()
            with link, suppress(OSError):
                link.settimeout(1.0)
                head = b""
                while b"\r\n\r\n" not in head and (part := link.recv(65536)):
                    head += part
                link.sendall(self.answer)
                link.shutdown(socket.SHUT_WR)


def http_answers() -> list[bytes]:
    """Whole answers with their heads, as controllers send them."""
    made = []
    for data in answers():
        body = data[2:]
        kind = b"application/json" if body.startswith(b"{") else b"text/html; charset=utf-8"
        head = b"HTTP/1.1 200 OK\r\nContent-Type: " + kind
        made.append(head + b"\r\nContent-Length: %d\r\n\r\n" % len(body) + body)
        parts = b"%x\r\n%s\r\n0\r\n\r\n" % (len(body), body)
        made.append(head + b"\r\nTransfer-Encoding: chunked\r\n\r\n" + parts)
    made.append(
        b'HTTP/1.1 401 Unauthorized\r\nWWW-Authenticate: Digest realm="validusers@robapi.abb", '
        b'domain="/", qop="auth", nonce="abc", opaque="x", algorithm="MD5"\r\n'
        b"Set-Cookie: -http-session-=1::http.session::2; path=/\r\nContent-Length: 0\r\n\r\n"
    )
    made.append(b"HTTP/1.1 503 Service Unavailable\r\nContent-Length: 0\r\n\r\n")
    made.append(b"HTTP/1.1 204 No Content\r\n\r\n")
    return made


def open_web() -> Callable[[bytes], bool]:
    """Answers of the robot's controller over HTTP."""
    server = RawServer()
    call = RWS_1.operation_mode()

    def feed(data: bytes) -> bool:
        server.answer = data
        session = RwsSession(f"http://{HOST}:{server.port}", "user", "secret")
        connection = session.connection()
        begin = time.monotonic()
        try:
            states = session.attempt(connection, call, Deadline(ASK_S))
        except CabolsError:
            return False
        finally:
            connection.close()
            check(time.monotonic() - begin < ASK_S + 1.0, "RWS: beyond its deadline")
        check(any(call.key in state for state in states), "RWS: no value")
        return True

    return feed


class _Raw(grpc.GenericRpcHandler):
    """Answers the tracker's calls with bytes as they are."""

    def __init__(self) -> None:
        self.measured = b""

    def service(self, details: Any) -> Any:
        name = details.method.rpartition("/")[2]
        return grpc.unary_unary_rpc_method_handler(lambda *_: self._answer(name))

    def _answer(self, name: str) -> bytes:
        if name == "Measure":
            return self.measured
        point = pb.Vector3(x=1.0, y=2.0, z=0.5)
        if name == "GetStatus":
            return pb.Status(
                ready=True, beam_locked=True, time_ns=6_000_000_000
            ).SerializeToString()
        return pb.BeamReply(success=True, position_m=point).SerializeToString()


def open_grpc() -> Callable[[bytes], bool]:
    """Answers of the tracker over gRPC."""
    server = grpc.server(futures.ThreadPoolExecutor(2))
    raw = _Raw()
    server.add_generic_rpc_handlers((raw,))
    port = server.add_insecure_port(f"{HOST}:0")
    server.start()
    client: Any = TrackerClient(f"{HOST}:{port}", load_tracker_config())
    client.keep_alive = server

    def feed(data: bytes) -> bool:
        raw.measured = data
        client._before_ns = 0
        try:
            reading = client.measure(0, expected=(1.0, 2.0, 0.5))
        except CabolsError:
            return False
        return check_reading(reading)

    return feed


SENT = (*LIVE, "loop_status", "stop", "desired_wrench", "desired_tension", "operator_heartbeat")
NODES = ("supervisor", "limb_controller", "wrench_controller", "load_program")
READY_S = 300.0
PR_SET_PDEATHSIG = 1
MEMORY_BYTES = 5 * 1024 * 1024


def _end_with_parent() -> None:
    """A node must not outlive the fuzzer, however that ends (Linux)."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


def _resident(pid: int) -> int:
    return 4096 * int(Path(f"/proc/{pid}/statm").read_text().split()[1])


class Graph:
    """Nodes as processes in a domain of their own, and publishers that send bytes as they are."""

    def __init__(self) -> None:
        import rclpy
        from rclpy.executors import SingleThreadedExecutor

        from cabols_control.bringup.free_domains import claim_domain
        from cabols_control.ros.messages import topics
        from cabols_control.ros.messages.qos import topic_qos

        domain = claim_domain()
        environment = dict(os.environ, ROS_DOMAIN_ID=str(domain))
        environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
        folder = Path(sys.prefix) / "lib" / "cabols_control"
        logs = Path("build") / "fuzz" / "dds_topics" / "logs"
        logs.mkdir(parents=True, exist_ok=True)
        self.nodes = {
            name: subprocess.Popen(
                [str(folder / name), "--ros-args", "-r", "__ns:=/cabols"],
                env=environment,
                stdout=(logs / f"{name}.log").open("w"),
                stderr=subprocess.STDOUT,
                preexec_fn=_end_with_parent,  # noqa: PLW1509 - no thread runs yet
            )
            for name in NODES
        }
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = rclpy.create_node("fuzz", namespace="/cabols", context=self.context)
        spinner = SingleThreadedExecutor(context=self.context)
        # A node that finds its role taken refuses to start: it listens first, then it reports.
        told: set[str] = set()
        status = self.node.create_subscription(
            topics.TYPES["loop_status"],
            "loop_status",
            lambda message: told.add(message.node),
            topic_qos("loop_status"),
        )
        begin = time.monotonic()
        while not set(NODES) <= told:
            check(time.monotonic() - begin < READY_S, "DDS: nodes did not start")
            rclpy.spin_once(self.node, executor=spinner, timeout_sec=0.1)
        self.node.destroy_subscription(status)
        self.publishers = [
            self.node.create_publisher(topics.TYPES[t], t, topic_qos(t)) for t in SENT
        ]
        time.sleep(1.0)
        self.first: dict[str, int] = {}
        self.sent = 0

    def look(self) -> None:
        """Every node must live, and have grown little since it was warm."""
        for name, process in self.nodes.items():
            check(process.poll() is None, f"DDS: {name} ended")
            now = _resident(process.pid)
            if self.sent >= 2000:
                grown = now - self.first.setdefault(name, now)
                check(grown <= MEMORY_BYTES, f"DDS: {name} grew by {grown >> 20} MiB")

    def close(self) -> None:
        """End what was started."""
        for process in self.nodes.values():
            process.kill()
        for process in self.nodes.values():
            process.wait()
        self.context.try_shutdown()


def sent_messages() -> list[bytes]:
    """A good message of each topic."""
    from binary_targets import messages_of

    return messages_of(SENT, 11)


def open_dds() -> Callable[[bytes], bool]:
    """Messages of any bytes to running nodes; one that ends, or grows, is a finding."""
    import atexit

    graph = Graph()
    atexit.register(graph.close)

    def feed(data: bytes) -> bool:
        index = data[0] % len(SENT) if data else 0
        # A message without its head is never sent by DDS, nor is one of no bytes.
        raw = data[1:].ljust(4, b"\0")
        graph.publishers[index].publish(raw)
        graph.sent += 1
        time.sleep(0.0005)
        if graph.sent % 100 == 0:
            graph.look()
        return True

    return feed


TARGETS = (
    Target("egm_socket", packets, open_stream, socket=True),
    Target("rws_socket", http_answers, open_web, text=True, socket=True, deadline_s=3.0),
    Target("tracker_socket", replies, open_grpc, socket=True, deadline_s=10.0),
    Target("dds_topics", sent_messages, open_dds, socket=True, deadline_s=90.0),
)
