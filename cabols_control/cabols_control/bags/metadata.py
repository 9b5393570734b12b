"""metadata.yaml of a rosbag2 folder, version 9."""

from __future__ import annotations

from dataclasses import dataclass, field
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


def write_metadata(folder: Path, summary: Summary, custom: dict[str, str]) -> None:
    """Write metadata.yaml atomically: the file is either complete or absent.

    Args:
        folder: of the bag.
        summary: of its only file.
        custom: free text by key, which goes into custom_data.
    """
    start = {"nanoseconds_since_epoch": summary.start_ns or 0}
    duration = {"nanoseconds": summary.duration_ns}
    document = {
        "rosbag2_bagfile_information": {
            "version": VERSION,
            "storage_identifier": "mcap",
            "duration": duration,
            "starting_time": start,
            "message_count": summary.messages,
            "topics_with_message_count": [_topic(topic) for topic in summary.topics],
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [summary.file_name],
            "files": [
                {
                    "path": summary.file_name,
                    "starting_time": dict(start),
                    "duration": dict(duration),
                    "message_count": summary.messages,
                }
            ],
            "custom_data": {_Text(key): _Text(value) for key, value in custom.items()} or None,
            "ros_distro": "jazzy",
        }
    }
    text = yaml.dump(document, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=10**6)
    temporary = folder / (FILE_NAME + ".tmp")
    temporary.write_text(text, encoding="utf-8")
    temporary.replace(folder / FILE_NAME)


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
        information["relative_file_paths"][0]
    except (OSError, UnicodeDecodeError, yaml.YAMLError, KeyError, IndexError, TypeError) as error:
        raise BagError(
            f"{path}: expected rosbag2's metadata, got something else "
            f"({type(error).__name__}: {error}); delete it and run recover"
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
            "serialization_format": "cdr",
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
