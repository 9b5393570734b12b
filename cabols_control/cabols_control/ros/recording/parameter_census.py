# SPDX-License-Identifier: Apache-2.0
"""Asks every node of the graph for its parameters, once: what ran, not what was to run."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.task import Future

PERIOD_S = 1.0
"""Between two looks for nodes [s]."""
AGAIN_S = 5.0
"""Until a question without an answer is asked again [s]."""


class _Asked:
    """Questions to one node."""

    def __init__(
        self, owner: Node, name: str, on_answer: Callable[[str, dict[str, Any]], None]
    ) -> None:
        self._owner, self._name, self._on_answer = owner, name, on_answer
        self._names = owner.create_client(ListParameters, f"{name}/list_parameters")
        self._values = owner.create_client(GetParameters, f"{name}/get_parameters")
        self._since_s = 0.0
        self.answered = False

    def ask(self) -> None:
        """Ask, unless an answer is still to be expected."""
        if self.answered or time.monotonic() - self._since_s < AGAIN_S:
            return
        if not (self._names.service_is_ready() and self._values.service_is_ready()):
            return
        self._since_s = time.monotonic()
        self._names.call_async(ListParameters.Request()).add_done_callback(self._hear_names)

    def _hear_names(self, future: Future) -> None:
        answer = future.result()
        if answer is None or self.answered:
            return
        names = sorted(answer.result.names)
        asked = self._values.call_async(GetParameters.Request(names=names))
        asked.add_done_callback(lambda done: self._hear_values(names, done))

    def _hear_values(self, names: list[str], future: Future) -> None:
        answer = future.result()
        if answer is None or self.answered or len(answer.values) != len(names):
            return
        self.answered = True
        values = [parameter_value_to_python(value) for value in answer.values]
        plain = [v if isinstance(v, str | float | int | bool | None) else list(v) for v in values]
        self._on_answer(self._name, dict(zip(names, plain, strict=True)))

    def forget(self) -> None:
        """Close the clients: other nodes need not know them."""
        self._owner.destroy_client(self._names)
        self._owner.destroy_client(self._values)


class ParameterCensus:
    """Keeps the parameters of the nodes in its owner's namespace.

    Attributes:
        parameters: values by name, by node; those of the owner are there from the start.
    """

    def __init__(self, node: Node, on_change: Callable[[], None]) -> None:
        """Begin to ask; the node's executor does it.

        Args:
            node: owner.
            on_change: called after each look that has brought something new.
        """
        self._node, self._on_change, self._new = node, on_change, False
        own = {name: node.get_parameter(name).value for name in node._parameters}
        self.parameters: dict[str, dict[str, Any]] = {
            node.get_name(): {k: list(v) if isinstance(v, tuple) else v for k, v in own.items()}
        }
        self._asked: dict[str, _Asked] = {}
        node.create_timer(PERIOD_S, self._look)

    def _look(self) -> None:
        if self._new and all(asked.answered for asked in self._asked.values()):
            self._new = False
            self._on_change()
        here = self._node.get_namespace()
        for name, namespace in self._node.get_node_names_and_namespaces():
            if namespace == here and name not in self.parameters and name not in self._asked:
                self._asked[name] = _Asked(self._node, name, self._keep)
        for name, asked in list(self._asked.items()):
            asked.ask()
            if asked.answered:
                asked.forget()
                del self._asked[name]

    def _keep(self, name: str, values: dict[str, Any]) -> None:
        self.parameters[name] = values
        self._new = True
