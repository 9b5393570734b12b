# SPDX-License-Identifier: Apache-2.0
"""metadata.yaml of a rosbag2 folder, version 9."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import yaml

from cabols_control.bags.errors import BagError, MissingBagError

FILE_NAME = "metadata.yaml"
VERSION = 9
FOREVER = {"sec": 9223372036, "nsec": 854775807}


@dataclass(frozen=True)
class OfferedQos:
    """Quality of service with which a topic was published.

    Attributes:
        depth: of the queue.
        reliability: `best_effort` or `reliable`.
        durability: `volatile` or `transient_local`.
    """

    depth: int = 10
    reliability: str = "reliable"
    durability: str = "volatile"

    def profile(self) -> dict[str, Any]:
        """Return it as rosbag2 writes it."""
        return {
            "history": "keep_last",
            "depth": self.depth,
            "reliability": self.reliability,
            "durability": self.durability,
            "deadline": dict(FOREVER),
            "lifespan": dict(FOREVER),
            "liveliness": "automatic",
            "liveliness_lease_duration": dict(FOREVER),
            "avoid_ros_namespace_conventions": False,
        }

    def text(self) -> str:
        """Return the YAML list that stands in an MCAP channel's metadata."""
        return yaml.safe_dump([self.profile()], sort_keys=False).strip()


@dataclass
class TopicSummary:
    """One channel of a bag, for metadata.yaml."""

    name: str
    type_name: str
    type_hash: str
    qos_text: str
    messages: int = 0
    encoding: str = "cdr"


@dataclass
class Summary:
    """Content of metadata.yaml about one MCAP file; times in ns."""

    file_name: str
    topics: list[TopicSummary] = field(default_factory=list)
    start_ns: int | None = None
    end_ns: int = 0

    @property
    def messages(self) -> int:
        """Number of all messages."""
        return sum(topic.messages for topic in self.topics)

    @property
    def duration_ns(self) -> int:
        """Time from the first message to the last."""
        return 0 if self.start_ns is None else self.end_ns - self.start_ns


@dataclass(frozen=True)
class Compression:
    """rosbag2's own compression, beside that of MCAP's chunks.

    Attributes:
        form: `zstd`, or empty.
        mode: `FILE`, `MESSAGE`, or empty.
    """

    form: str = ""
    mode: str = ""


def write_metadata(
    folder: Path,
    summary: Summary | Sequence[Summary],
    custom: dict[str, str],
    compression: Compression | None = None,
) -> None:
    """Write metadata.yaml atomically: the file is either complete or absent.

    Args:
        folder: of the bag.
        summary: of its only file, or of all its files in order.
        custom: free text by key, which goes into custom_data.
        compression: of its messages; None: none.
    """
    files = [summary] if isinstance(summary, Summary) else list(summary)
    compression = compression or Compression()
    first = min((file.start_ns for file in files if file.start_ns is not None), default=0)
    last = max((file.end_ns for file in files if file.start_ns is not None), default=first)
    document = {
        "rosbag2_bagfile_information": {
            "version": VERSION,
            "storage_identifier": "mcap",
            "duration": {"nanoseconds": signed(last - first)},
            "starting_time": {"nanoseconds_since_epoch": signed(first)},
            "message_count": sum(file.messages for file in files),
            "topics_with_message_count": [_topic(topic) for topic in _merged(files)],
            "compression_format": compression.form,
            "compression_mode": compression.mode,
            "relative_file_paths": [file.file_name for file in files],
            "files": [_file(file) for file in files],
            "custom_data": {_Text(key): _Text(value) for key, value in custom.items()} or None,
            "ros_distro": "jazzy",
        }
    }
    text = yaml.dump(document, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=10**6)
    temporary = folder / (FILE_NAME + ".tmp")
    temporary.write_text(text, encoding="utf-8")
    temporary.replace(folder / FILE_NAME)


def signed(time_ns: int) -> int:
    """Time as ROS 2 reads it: MCAP's are unsigned, ROS's signed, both of 64 bits [ns]."""
    return (time_ns + (1 << 63)) % (1 << 64) - (1 << 63)


def _file(summary: Summary) -> dict[str, Any]:
    return {
        "path": summary.file_name,
        "starting_time": {"nanoseconds_since_epoch": signed(summary.start_ns or 0)},
        "duration": {"nanoseconds": signed(summary.duration_ns)},
        "message_count": summary.messages,
    }


def _merged(files: Sequence[Summary]) -> list[TopicSummary]:
    """One entry for a topic's channels of one type, in all files."""
    found: dict[tuple[str, str], TopicSummary] = {}
    for file in files:
        for topic in file.topics:
            entry = found.setdefault((topic.name, topic.type_name), replace(topic, messages=0))
            entry.messages += topic.messages
    return list(found.values())


def read_metadata(folder: Path) -> dict[str, Any]:
    """Read the content of metadata.yaml.

    Raises:
        BagError: if it is missing or not that of a bag.
    """
    path = folder / FILE_NAME
    if not folder.is_dir():
        came = "a file" if folder.exists() else "nothing"
        raise MissingBagError(f"{folder}: expected a bag's folder, got {came}; check the path")
    if not path.exists():
        raise BagError(
            f"{folder}: expected a bag with {FILE_NAME}, got none; if its recorder was killed, "
            f"run `ros2 run cabols_control recover {folder}`"
        )
    try:
        content = yaml.load(path.read_text(encoding="utf-8"), Loader=yaml.CSafeLoader)
        information = content["rosbag2_bagfile_information"]
        str(information["relative_file_paths"][0])
        for entry in information.get("topics_with_message_count") or []:
            str(entry["topic_metadata"]["name"]), str(entry["topic_metadata"]["type"])
            int(entry["message_count"])
        custom_data(information)
    except (OSError, ValueError, yaml.YAMLError, LookupError, TypeError, AttributeError) as error:
        raise BagError(
            f"{path}: expected rosbag2's metadata, got something else "
            f"({type(error).__name__}: {error}); delete it and run "
            f"`ros2 run cabols_control recover {folder}`"
        ) from error
    return dict(information)


def custom_data(information: dict[str, Any]) -> dict[str, str]:
    """Return custom_data as text by key."""
    found = information.get("custom_data") or {}
    return {str(key): str(value) for key, value in found.items()}


def _topic(topic: TopicSummary) -> dict[str, Any]:
    return {
        "topic_metadata": {
            "name": topic.name,
            "type": topic.type_name,
            "serialization_format": topic.encoding,
            "offered_qos_profiles": yaml.safe_load(topic.qos_text) or [],
            "type_description_hash": topic.type_hash,
        },
        "message_count": topic.messages,
    }


class _Text(str):
    """A string that readers of YAML 1.1 and 1.2 must both read as one: `1e3`, `yes`, `0o7`."""

    __slots__ = ()


class _Dumper(yaml.SafeDumper):
    """Quotes text, writes each value in full."""

    def ignore_aliases(self, data: Any) -> bool:
        """Write repeated values in full: some readers do not support anchors."""
        del data
        return True


def _represent(dumper: yaml.SafeDumper, text: _Text) -> yaml.ScalarNode:
    # PyYAML falls back to double quotes where a literal block cannot hold the text.
    style = "|" if "\n" in text else '"'
    return dumper.represent_scalar("tag:yaml.org,2002:str", str(text), style=style)


_Dumper.add_representer(_Text, _represent)
