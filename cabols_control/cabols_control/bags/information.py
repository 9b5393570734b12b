# SPDX-License-Identifier: Apache-2.0
"""What a bag says of itself, without reading its messages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from cabols_control.bags.errors import BagError
from cabols_control.bags.metadata import custom_data, read_metadata
from cabols_control.bags.names import relative, type_of
from cabols_control.command_line import did_you_mean


@dataclass(frozen=True)
class BagInformation:
    """What metadata.yaml says.

    Attributes:
        folder: of the bag.
        metadata: text by key, as given to the recorder.
        types: message type by topic, relative to /cabols.
        counts: number of messages by topic.
    """

    folder: Path
    metadata: dict[str, str]
    types: dict[str, str]
    counts: dict[str, int]

    def present(self, wanted: Sequence[str] | None = None) -> list[str]:
        """Return the topics that are wanted, relative; None: all that have messages.

        Raises:
            BagError: if one of them has no messages.
        """
        there = [topic for topic, count in self.counts.items() if count]
        if wanted is None:
            return there
        found = [relative(topic) for topic in wanted]
        for topic in found:
            if topic not in there:
                raise BagError(
                    f"{self.folder}: expected one of the topics {', '.join(there)}, got "
                    f"{topic}{did_you_mean(topic, there)}"
                )
        return list(dict.fromkeys(found))


def bag_information(folder: str | Path) -> BagInformation:
    """Read metadata.yaml.

    Raises:
        BagError: if it is missing, or not that of a bag.
    """
    place = Path(folder)
    content = read_metadata(place)
    entries = content.get("topics_with_message_count") or []
    types: dict[str, str] = {}
    counts: dict[str, int] = {}
    for entry in entries:
        topic = relative(str(entry["topic_metadata"]["name"]))
        types[topic] = type_of(str(entry["topic_metadata"]["type"]))
        counts[topic] = counts.get(topic, 0) + int(entry["message_count"])
    return BagInformation(place, custom_data(content), types, counts)
