# SPDX-License-Identifier: Apache-2.0
"""Message definitions and their hashes, as a bag carries them."""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore

from cabols_control.bags.errors import BagError


@dataclass(frozen=True)
class Definition:
    """One message type.

    Attributes:
        type_name: e.g. `cabols_msgs/msg/LimbState`.
        text: its .msg and those of all nested types, concatenated (MCAP's encoding `ros2msg`).
        type_hash: RIHS01 hash (REP-2011).
    """

    type_name: str
    text: str
    type_hash: str


class Definitions:
    """Looks types up in rosbags and in the installed ROS packages."""

    def __init__(self) -> None:
        """Start with the types of ROS 2 Jazzy."""
        self._store = get_typestore(Stores.ROS2_JAZZY)

    def get(self, type_name: str) -> Definition:
        """Return the definition of a type.

        Args:
            type_name: e.g. `geometry_msgs/msg/WrenchStamped`.

        Raises:
            BagError: if no installed package has the type, or its .msg is not readable.
        """
        self._learn(type_name)
        text, _ = self._store.generate_msgdef(type_name, ros_version=2)
        return Definition(type_name, text, self._store.hash_rihs01(type_name))

    def _learn(self, type_name: str) -> None:
        """Register an unknown type and all types nested in it."""
        waiting = [type_name]
        found: dict[str, Any] = {}
        while waiting:
            name = waiting.pop()
            if name in self._store.fielddefs or name in found:
                continue
            types = _read_msg(name)
            found.update(types)
            waiting += [inner for _, fields in types.values() for inner in _nested(fields)]
        if found:
            self._store.register(found)


def _read_msg(type_name: str) -> dict[str, Any]:
    package, _, rest = type_name.partition("/")
    if not package or rest.count("/") != 1:
        raise BagError(
            f"{type_name}: expected a type such as std_msgs/msg/Header; complete the name"
        )
    candidates = [share / package / f"{rest}.msg" for share in _share_folders()]
    path = next((path for path in candidates if path.is_file()), None)
    if path is None:
        raise BagError(
            f"{type_name}: expected {package}/{rest}.msg in an ament prefix, found none in "
            f"{', '.join(str(share) for share in _share_folders())}; build and source {package}"
        )
    try:
        return dict(get_types_from_msg(path.read_text(encoding="utf-8"), type_name))
    except (TypesysError, OSError, UnicodeDecodeError) as error:
        raise BagError(f"{path}: expected a message definition, got {error}; mend it") from error


def _share_folders() -> list[Path]:
    """Return share folders of the ament prefixes; an environment made of wheels is one itself."""
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    return [Path(prefix) / "share" for prefix in (*prefixes, sys.prefix) if prefix]


def _nested(fields: Any) -> list[str]:
    """Names of the types in a list of rosbags' field descriptions."""
    found = []
    for _, (_, detail) in fields:
        inner = detail[0][1] if isinstance(detail[0], tuple) else detail
        if isinstance(inner, str):
            found.append(inner)
    return found


def parse_definition(type_name: str, text: str) -> dict[str, Any]:
    """Parse the concatenated text that a bag carries into rosbags' type dictionary.

    Args:
        type_name: of the message, e.g. `cabols_msgs/msg/Mode`.
        text: its definition and those of the types in it, as a bag carries them.

    Raises:
        BagError: if the text is no message definition.
    """
    # Of other editors: a byte order mark, line ends of other systems.
    unix = text.lstrip("\ufeff").replace("\r\n", "\n").replace("\r", "\n")
    try:
        return dict(get_types_from_msg(unix, type_name))
    except Exception as error:
        # The parser may raise any error for a text that is none.
        raise BagError(
            f"{type_name}: expected its definition in the bag, got text that is none ({error}); "
            "record it with cabols or `ros2 bag`"
        ) from error


def verified(definition: Definition) -> Definition:
    """Return a definition whose text and hash agree; for a damaged one, the installed type's.

    A single damaged byte may leave a definition that is readable but wrong; the hash reveals it.
    If the type is not installed either, the text counts, with its own hash.
    """
    store = get_typestore(Stores.EMPTY)
    try:
        store.register(parse_definition(definition.type_name, definition.text))
        type_hash = str(store.hash_rihs01(definition.type_name))
    except (BagError, TypesysError, KeyError):
        return Definitions().get(definition.type_name)
    if type_hash == definition.type_hash:
        return definition
    try:
        return Definitions().get(definition.type_name)
    except BagError:
        return Definition(definition.type_name, definition.text, type_hash)
