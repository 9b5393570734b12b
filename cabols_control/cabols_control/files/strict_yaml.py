# SPDX-License-Identifier: Apache-2.0
"""YAML as it is written, with the line of every key; what only looks like a number is refused.

YAML 1.1 reads `yes` as true, `0145` as 101 and `1:30` as 90, keeps the last of two equal keys, and
lets nine short lines stand for a billion values. A rig's file means what a person reads in it:
here booleans are `true` and `false`, numbers are decimal, keys are unique, aliases and depth are
bounded. The rules for numbers are those of YAML 1.2's core schema, without octal and hexadecimal.
"""

from __future__ import annotations

import re
from copy import deepcopy
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import yaml

from cabols_control.errors import ConfigError

MAX_LETTERS = 1_000_000
MAX_DEPTH = 20
MAX_VALUES = 50_000
"""Values of a file with all aliases written out."""
MERGE = "<<"
"""Key that YAML 1.1 replaces by another mapping's keys, and 1.2 does not."""
MAX_SHOWN = 60
"""Letters of a wrong value in a message."""
MAX_KEPT, MAX_KEPT_LETTERS = 64, 20_000
"""Files whose content is kept, as a rig's files are read again and again, and their length."""

_ODD_BREAK = re.compile("[\u0085\u2028\u2029]")


@dataclass(frozen=True)
class Document:
    """What a file holds.

    Attributes:
        content: values, as Python's.
        root: YAML's tree of the same, with line numbers.
    """

    content: Any
    root: yaml.Node | None

    def line(self, path: tuple[str | int, ...]) -> int:
        """Line of a key, from 1; of the nearest one above where there is none; 0 for no tree."""
        node, line = self.root, 0
        for part in path:
            found = _child(node, part)
            if found is None:
                break
            line, node = found
        return line


def _child(node: yaml.Node | None, part: str | int) -> tuple[int, yaml.Node] | None:
    if isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            if key.value == str(part):
                return key.start_mark.line + 1, value
    if isinstance(node, yaml.SequenceNode) and isinstance(part, int) and part < len(node.value):
        item = node.value[part]
        return item.start_mark.line + 1, item
    return None


class _Loader(yaml.SafeLoader):
    """SafeLoader with the rules of this module."""

    yaml_implicit_resolvers: dict[str, list[Any]] = {}  # noqa: RUF012

    def __init__(self, stream: str) -> None:
        super().__init__(stream)
        self._depth = 0

    def compose_sequence_node(self, anchor: Any) -> yaml.SequenceNode:
        self._go_deeper()
        node = super().compose_sequence_node(anchor)
        self._depth -= 1
        return node

    def compose_mapping_node(self, anchor: Any) -> yaml.MappingNode:
        self._go_deeper()
        node = super().compose_mapping_node(anchor)
        self._depth -= 1
        return node

    def _go_deeper(self) -> None:
        self._depth += 1
        if self._depth > MAX_DEPTH:
            event: yaml.Event = self.peek_event()  # type: ignore[no-untyped-call]
            line = 0 if event.start_mark is None else event.start_mark.line + 1
            raise ConfigError(f"line {line}: expected at most {MAX_DEPTH} levels, got more")

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen: dict[str, int] = {}
        for key, _ in node.value:
            line = key.start_mark.line + 1
            if not isinstance(key, yaml.ScalarNode):
                raise ConfigError(f"line {line}: expected a name as key, got a list or mapping")
            if key.value == MERGE and key.style is None:
                raise ConfigError(f"line {line}: expected keys of its own, got a merge; write them")
            if key.value in seen:
                raise ConfigError(
                    f"line {line}: expected each key once, got {shown(key.value)} in line "
                    f"{seen[key.value]} already; delete one of them"
                )
            seen[key.value] = line
        return super().construct_mapping(node, deep)


for _tag, _pattern, _first in (
    ("bool", r"true|True|TRUE|false|False|FALSE", "tTfF"),
    ("int", r"[-+]?(0|[1-9][0-9]*)", "-+0123456789"),
    (
        "float",
        r"[-+]?((0|[1-9][0-9]*)(\.[0-9]*)?|\.[0-9]+)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)"
        r"|\.(nan|NaN|NAN)",
        "-+.0123456789",
    ),
    ("null", r"~|null|Null|NULL|", ["~", "n", "N", ""]),
):
    _Loader.add_implicit_resolver(
        f"tag:yaml.org,2002:{_tag}", re.compile(f"^(?:{_pattern})$"), list(_first)
    )


def shown(value: Any) -> str:
    """Text of a value for a message, of bounded length."""
    text = repr(value) if not isinstance(value, (list, dict)) else _outline(value)
    return text if len(text) <= MAX_SHOWN else text[: MAX_SHOWN - 3] + "..."


def _outline(value: list[Any] | dict[str, Any]) -> str:
    """A short list as it is, else its size: the whole may be as long as a book."""
    plain = all(not isinstance(item, (list, dict)) for item in value)
    if plain and len(value) <= 12:
        return repr(value)
    kind = "list" if isinstance(value, list) else "mapping"
    return f"a {kind} of {len(value)} entries"


def parse(text: str) -> Document:
    """Read one YAML document.

    Raises:
        ConfigError: if it is not YAML, too large, too deep, or against this module's rules; with
            the line, without the file's name.
    """
    if len(text) > MAX_LETTERS:
        raise ConfigError(f"expected at most {MAX_LETTERS} letters, got {len(text)}")
    if len(text) > MAX_KEPT_LETTERS:
        return _parse(text)
    kept = _kept(text)
    return Document(deepcopy(kept.content), kept.root)


@lru_cache(maxsize=MAX_KEPT)
def _kept(text: str) -> Document:
    return _parse(text)


def _parse(text: str) -> Document:
    _check_breaks(text)
    try:
        loader = _Loader(text)
        try:
            root = loader.get_single_node()
            if root is None:
                return Document(None, None)
            values = _count(root, {}, set())
            if values > MAX_VALUES:
                raise ConfigError(
                    f"expected at most {MAX_VALUES} values with all aliases written out, got "
                    f"{values if values < 1e9 else 'over 1e9'}"
                )
            return Document(loader.construct_document(root), root)
        finally:
            loader.dispose()
    except yaml.YAMLError as error:
        raise ConfigError(f"expected YAML, got {_problem(error)}") from error
    except (ValueError, RecursionError) as error:
        if isinstance(error, ConfigError):
            raise
        raise ConfigError(f"expected YAML, got {shown(str(error))}") from error


def _check_breaks(content: str) -> None:
    """Refuse ends of lines that YAML's versions read differently."""
    found = _ODD_BREAK.search(content)
    if found:
        line = content[: found.start()].count("\n") + 1
        raise ConfigError(
            f"line {line}: expected lines that end by a line feed, got the character "
            f"U+{ord(found[0]):04X}, which YAML 1.1 and 1.2 read differently; delete it"
        )


def _count(node: yaml.Node, known: dict[int, int], above: set[int]) -> int:
    """Values below a node, with aliases written out."""
    if isinstance(node, yaml.ScalarNode):
        return 1
    if id(node) in above:
        raise ConfigError(
            f"line {node.start_mark.line + 1}: expected values, got an alias of what it is part of"
        )
    if id(node) not in known:
        above.add(id(node))
        parts = node.value
        if isinstance(node, yaml.MappingNode):
            parts = [part for pair in node.value for part in pair]
        known[id(node)] = 1 + sum(_count(part, known, above) for part in parts)
        above.discard(id(node))
    return known[id(node)]


def _problem(error: yaml.YAMLError) -> str:
    """What PyYAML found and where, in one line."""
    if isinstance(error, yaml.MarkedYAMLError):
        mark = error.problem_mark or error.context_mark
        where = f" in line {mark.line + 1}" if mark is not None else ""
        return f"{str(error.problem or error.context)[:MAX_SHOWN]}{where}"
    return str(error).splitlines()[0][: 2 * MAX_SHOWN]
