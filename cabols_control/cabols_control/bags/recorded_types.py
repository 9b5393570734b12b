# SPDX-License-Identifier: Apache-2.0
"""Types as a bag records them: its definitions in their forms, and the installed ones beside."""

from __future__ import annotations

import re
import warnings
from functools import lru_cache
from typing import Any

from rosbags.typesys import Stores, TypesysError, get_types_from_idl, get_typestore
from rosbags.typesys.store import Typestore

from cabols_control.bags.definitions import Definitions, parse_definition
from cabols_control.bags.errors import BagError, BagWarning
from cabols_control.bags.storage.records import ChannelInfo

KEPT_STORES = 24
"""Definitions that stay compiled, 0.2 MB each: as many as a bag of the rig has types."""
IDL_PART = re.compile(r"^=+\s*\nIDL: .*$", re.MULTILINE)


def store_of(channel: ChannelInfo) -> Typestore:
    """Return a type store with a channel's type.

    Raises:
        BagError: if the bag has no definition of it that can be used, or no CDR messages.
    """
    if channel.encoding not in ("cdr", ""):
        raise BagError(
            f"{channel.topic}: expected CDR messages, got {channel.encoding}; leave it out: name "
            "the topics to be read"
        )
    text = channel.schema.data.decode("utf-8", "replace")
    try:
        if channel.schema.encoding == "ros2msg" and text.strip():
            return _store_of_text(channel.type_name, text)
        return _complete(_types(channel, text), channel.type_name)
    except BagError:
        raise
    except Exception as error:
        # A definition that is read may still lack a nested type.
        raise BagError(
            f"{channel.topic}: expected a complete definition of {channel.type_name} in the bag, "
            f"got {type(error).__name__} {error}; name the topics to be read, without this one"
        ) from error


@lru_cache(maxsize=KEPT_STORES)
def _store_of_text(type_name: str, text: str) -> Typestore:
    """Store of a definition; kept, as a store compiles its decoders anew."""
    return _complete(parse_definition(type_name, text), type_name)


def _complete(types: dict[str, Any], type_name: str) -> Typestore:
    store = get_typestore(Stores.EMPTY)
    store.register(types)
    store.get_msgdef(type_name)
    return store


def _types(channel: ChannelInfo, text: str) -> dict[str, Any]:
    """Types of a channel: from the bag; from the installed packages where the bag has none."""
    if channel.schema.encoding == "ros2idl":
        return _from_idl(channel, text)
    if channel.schema.encoding == "ros2msg" and (text.strip() or not _has_fields(channel)):
        return parse_definition(channel.type_name, text)
    if channel.schema.encoding not in ("ros2msg", ""):
        raise BagError(
            f"{channel.topic}: expected a definition of {channel.type_name} as ros2msg or "
            f"ros2idl, got {channel.schema.encoding}; name the topics to be read, without this one"
        )
    try:
        installed = Definitions().get(channel.type_name)
    except BagError as error:
        raise BagError(f"{channel.topic}: no definition in the bag, and {error}") from error
    if channel.type_hash and channel.type_hash != installed.type_hash:
        raise BagError(
            f"{channel.topic}: expected a definition of {channel.type_name} in the bag, got none, "
            "and the installed one is another version; install the one it was recorded with"
        )
    if not channel.type_hash:
        warnings.warn(
            f"{channel.topic}: the bag has no definition of {channel.type_name}; decoded by the "
            "installed one",
            BagWarning,
            stacklevel=2,
        )
    return parse_definition(channel.type_name, installed.text)


def _has_fields(channel: ChannelInfo) -> bool:
    """Whether a type without a text has fields, as far as it is installed (std_msgs/Empty none)."""
    try:
        return bool(Definitions().get(channel.type_name).text.strip())
    except BagError:
        return True


def _from_idl(channel: ChannelInfo, text: str) -> dict[str, Any]:
    found: dict[str, Any] = {}
    try:
        for part in IDL_PART.split(text.replace("\r\n", "\n")):
            if part.strip():
                found.update(get_types_from_idl(part))
    except TypesysError as error:
        raise BagError(
            f"{channel.topic}: expected an IDL definition of {channel.type_name}, got text that "
            f"is none ({error}); name the topics to be read, without this one"
        ) from error
    return found


def has_header(channel: ChannelInfo) -> bool:
    """Whether a channel's messages begin with a std_msgs/Header."""
    text = channel.schema.data.decode("utf-8", "replace")
    if not text and channel.schema.encoding in ("", "ros2msg"):
        text = _installed_text(channel.type_name)
    lines = text.removeprefix("\ufeff").splitlines()
    fields = (line for line in lines if "=" not in line and line.strip())
    fields = (line for line in fields if not line.lstrip().startswith("#"))
    return next(fields, "").split()[:1] in (["std_msgs/Header"], ["std_msgs/msg/Header"])


@lru_cache(maxsize=64)
def _installed_text(type_name: str) -> str:
    try:
        return Definitions().get(type_name).text
    except BagError:
        return ""
