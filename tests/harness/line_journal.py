# SPDX-License-Identifier: Apache-2.0
"""A file of JSON lines that a long statistic adds to, so that it goes on where it was stopped."""

from __future__ import annotations

import json
from pathlib import Path


class LineJournal:
    """Results by their key."""

    def __init__(self, path, fresh=False):
        """Read what is there; fresh: begin anew. A last line that was cut short is left out."""
        self.path, self.found = Path(path), {}
        self.path.parent.mkdir(parents=True, exist_ok=True)
        if fresh:
            self.path.unlink(missing_ok=True)
        if self.path.exists():
            text = self.path.read_text(encoding="utf-8")
            whole = text[: text.rfind("\n") + 1]
            if whole != text:
                self.path.write_text(whole, encoding="utf-8")
            for line in whole.splitlines():
                entry = json.loads(line)
                self.found[entry["key"]] = entry

    def add(self, key, **values):
        """Append a result."""
        entry = {"key": key, **values}
        self.found[key] = entry
        with self.path.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps(entry) + "\n")
