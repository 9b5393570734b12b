"""One node of the graph: executable, topics, parameters, and its command line."""

from __future__ import annotations

import json
from dataclasses import dataclass, field, replace
from typing import Any

ONE_BLAS_THREAD = {"OPENBLAS_NUM_THREADS": "1"}
"""Environment of every node: its matrices are tiny, and two cores run the whole graph."""


@dataclass(frozen=True)
class NodeSpec:
    """One node of the graph.

    Attributes:
        package: ROS package.
        executable: its executable, and the node's name.
        reads: topics, relative to /cabols.
        writes: topics, relative to /cabols.
        parameters: ROS parameters.
        options: command line of an executable that is no ROS node, by name without dashes.
    """

    package: str
    executable: str
    reads: tuple[str, ...]
    writes: tuple[str, ...]
    parameters: dict[str, Any] = field(default_factory=dict)
    options: dict[str, Any] = field(default_factory=dict)

    def with_parameters(self, **parameters: Any) -> NodeSpec:
        """Return the same node with more parameters."""
        return replace(self, parameters={**self.parameters, **parameters})

    def option_list(self) -> list[str]:
        """Return the options as they stand on the command line."""
        return [word for name, value in self.options.items() for word in (f"--{name}", str(value))]

    def arguments(self) -> list[str]:
        """Return the command line behind the executable's name."""
        if not self.parameters:
            return self.option_list()
        found = [*self.option_list(), "--ros-args"]
        for name, value in self.parameters.items():
            # JSON is YAML: quotes keep a path or a name from being read as a number.
            found += ["-p", f"{name}:={json.dumps(value)}"]
        return found
