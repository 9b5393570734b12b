# SPDX-License-Identifier: Apache-2.0
"""Bags of any types, made with rosbags' own serialisation."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore

from cabols_control.bags.definitions import Definitions, parse_definition
from cabols_control.bags.writer import BagWriter

T0 = 1_700_000_000_000_000_000


class BagBuilder:
    """Writes one bag.

    Attributes:
        store: rosbags' types.
    """

    def __init__(self, folder: Path, metadata: dict[str, str] | None = None) -> None:
        self.store = get_typestore(Stores.ROS2_JAZZY)
        self._definitions = Definitions()
        self._writer = BagWriter(folder, metadata or {})
        self._types: dict[str, str] = {}

    def __enter__(self) -> BagBuilder:
        return self

    def __exit__(self, *error: object) -> None:
        self._writer.__exit__(*error)

    def add(self, topic, type_name, time_ns, **fields):
        """Write a message; fields that are not given are zero or empty."""
        if topic not in self._types:
            self._learn(type_name)
            self._writer.add_topic(topic, type_name)
            self._types[topic] = type_name
        message = self.make(type_name, **fields)
        if "header" not in fields and hasattr(message, "header"):
            message.header.stamp.sec = time_ns // 10**9
            message.header.stamp.nanosec = time_ns % 10**9
        data = bytes(self.store.serialize_cdr(message, type_name))
        self._writer.write(topic, time_ns + 700, time_ns + 300, data)
        return message

    def make(self, type_name, **fields):
        """Return a message."""
        self._learn(type_name)
        values = {}
        for name, (kind, detail) in self.store.fielddefs[type_name][1]:
            values[name] = fields.get(name, self._default(kind, detail))
        return self.store.types[type_name](**values)

    def _default(self, kind, detail):
        if kind == Nodetype.NAME:
            return self.make(detail)
        if kind == Nodetype.BASE:
            return {"string": "", "bool": False, "float32": 0.0, "float64": 0.0}.get(detail[0], 0)
        (inner, base), count = detail
        size = count if kind == Nodetype.ARRAY else 0
        if inner == Nodetype.BASE and base[0] != "string":
            return np.zeros(size, base[0])
        return [self._default(inner, base) for _ in range(size)]

    def _learn(self, type_name):
        if type_name in self.store.fielddefs:
            return
        types = parse_definition(type_name, self._definitions.get(type_name).text)
        self.store.register({k: v for k, v in types.items() if k not in self.store.fielddefs})
