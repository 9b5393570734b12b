# SPDX-License-Identifier: Apache-2.0
"""Node: the operator's console, a web page; its heartbeat names the operator to the supervisor."""

from __future__ import annotations

import sys
import threading
import time
from pathlib import Path

from cabols_msgs.msg import OperatorHeartbeat

from cabols_control.bringup_nodes import NODES as CONTROL_NODES
from cabols_control.console.access import AccessPolicy
from cabols_control.console.dispatcher import Dispatcher, Settings
from cabols_control.console.latest import LatestValues
from cabols_control.console.server import ConsoleServer, open_socket
from cabols_control.console.view3d.foxglove_link import FoxgloveLink
from cabols_control.console.view3d.scene import SceneConfig, load_scene, scene_numbers
from cabols_control.errors import ConfigError
from cabols_control.ros.console.calls import Calls
from cabols_control.ros.console.feed import Feed
from cabols_control.ros.messages.qos import topic_qos
from cabols_control.ros.node import RUNNING, ControlNode, run_node
from cabols_control.ros.parameters import declare, declare_row
from cabols_control.ros.threads.ticker import Ticker

PERIOD_S = 0.05
HEARTBEAT_EVERY = 4
END_S = 1.0


class ConsoleNode(ControlNode):
    """Reads the rig's state twenty times a second; the server runs in a thread of its own.

    The page commands nothing by itself: each action is a service or action of another node.
    """

    def __init__(self) -> None:
        """Bind the address and subscribe.

        Raises:
            ConfigError: if another address than loopback is to be served without a token.
        """
        super().__init__("console")
        host = declare_row(self, CONTROL_NODES.argument("console_host"))
        port = declare_row(self, CONTROL_NODES.argument("console_port"))
        policy = AccessPolicy(host, self._read_token())
        tls = self._declare_tls()
        self.latest = LatestValues()
        self._calls = Calls(self, self.latest)
        self.dispatcher = Dispatcher(self._calls, self.latest, self._settings())
        self._feed = Feed(self, self.rig, self.latest, self.rig_folder)
        where = open_socket(host, port)
        self.address = (host, int(where.getsockname()[1]))
        self._server = ConsoleServer(self.dispatcher, policy, where, tls)
        self._scheme = "http" if tls is None else "https"
        topic = "operator_heartbeat"
        self._heartbeat = self.create_publisher(OperatorHeartbeat, topic, topic_qos(topic))
        self._ticker = Ticker(self.context, PERIOD_S, self._tick)
        self._turns = 0
        self._failure: BaseException | None = None
        self._ending = False
        self._thread = threading.Thread(target=self._serve, name="console_server", daemon=True)

    def _read_token(self) -> str:
        path = declare_row(self, CONTROL_NODES.argument("token_file"))
        if not path:
            return ""
        try:
            return Path(path).read_text(encoding="utf-8").splitlines()[0].strip()
        except (OSError, UnicodeDecodeError, IndexError) as error:
            raise ConfigError(
                f"token_file: expected a file whose first line is the token, got {path} "
                f"({type(error).__name__})"
            ) from error

    def _declare_tls(self) -> tuple[str, str] | None:
        certificate = declare(self, "tls_certificate", "", "PEM file; with tls_key: serve HTTPS")
        key = declare(self, "tls_key", "", "PEM file")
        if bool(certificate) != bool(key):
            raise ConfigError("expected tls_certificate and tls_key together, or neither")
        for path in (certificate, key):
            if path and not Path(path).is_file():
                raise ConfigError(f"tls: expected a PEM file, got {path}")
        return (certificate, key) if certificate else None

    def _settings(self) -> Settings:
        uploads = declare_row(self, CONTROL_NODES.argument("uploads"))
        campaigns = declare_row(self, CONTROL_NODES.argument("campaigns"))
        configurations = declare(
            self, "configurations", 13, "stored configurations of the robot, how many", (0, 1000)
        )
        title = declare(self, "title", "cabols", "shown in the header")
        scene = load_scene(
            self.rig_folder,
            declare(self, "scene_file", "", "YAML of what is drawn"),
        )
        self._foxglove = self._open_foxglove(scene)
        return Settings(
            title=title,
            uploads=Path(uploads),
            campaigns=Path(campaigns),
            configurations=configurations,
            scene=scene_numbers(self.rig, scene),
            cables=self.rig.geometry.cables,
            rig=f"{self.rig_folder.name}, files {self.rig_folder.fingerprint}",
        )

    def _open_foxglove(self, scene: SceneConfig) -> FoxgloveLink | None:
        port = declare_row(self, CONTROL_NODES.argument("foxglove_port"))
        if not port:
            return None
        link = FoxgloveLink(self.rig, scene, "127.0.0.1", port)
        self.get_logger().info(f"Foxglove at ws://127.0.0.1:{link.port}")
        return link

    def begin(self) -> None:
        """Start reading and serving."""
        super().begin()
        self._ticker.start()
        self._thread.start()
        host, port = self.address
        shown = f"[{host}]" if ":" in host else host
        self.get_logger().info(f"console at {self._scheme}://{shown}:{port}")

    def end(self) -> None:
        """Publish that no operator is present, and stop."""
        self._ending = True
        self._ticker.stop()
        self._server.stop()
        if self._thread.is_alive():
            self._thread.join(timeout=END_S)
        self._calls.close()
        if self._foxglove is not None:
            self._foxglove.close()

    @property
    def failure(self) -> BaseException | None:
        """Return the error that ended a thread."""
        return self._failure or self._ticker.failure

    def _serve(self) -> None:
        try:
            self._server.run()
        except BaseException as error:
            self._failure = error
        if not self._ending and self.context.ok():
            self._failure = self._failure or RuntimeError("the console's server has ended")
            self.context.try_shutdown()

    def _tick(self) -> None:
        began = time.monotonic()
        frame = self._feed.look()
        if self._foxglove is not None:
            self._foxglove.send(frame)
        self._turns += 1
        if self._turns % HEARTBEAT_EVERY == 0:
            self._beat()
        self.status.work.add(time.monotonic() - began)
        self.status.cycle(time.time_ns(), RUNNING)

    def _beat(self) -> None:
        """Publish whether an operator's page answers; a dead console publishes nothing."""
        self.dispatcher.publish_operator()
        holder = self.dispatcher.lease.holder
        message = OperatorHeartbeat(
            source=self.get_name(),
            operator_name="" if holder is None else holder.name,
            attended=self.dispatcher.lease.attended,
        )
        message.header.stamp = self.get_clock().now().to_msg()
        self._heartbeat.publish(message)


def main() -> int:
    """Entry point."""
    return run_node(ConsoleNode)


if __name__ == "__main__":
    sys.exit(main())
