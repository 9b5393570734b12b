# SPDX-License-Identifier: Apache-2.0
"""Typed configuration: frozen dataclasses from YAML; wrong keys, types and numbers are errors."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from contextvars import ContextVar
from importlib.resources import files
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np
from pydantic import AfterValidator, ValidationError

from cabols_control.errors import ConfigError
from cabols_control.files.given_file import read_given
from cabols_control.files.strict_yaml import Document, parse, shown

T = TypeVar("T")

STRICT: Any = {"extra": "forbid"}
"""Configuration of every pydantic dataclass here: `@dataclass(frozen=True, config=STRICT)`."""

MAX_FINDINGS = 5
"""Mistakes that one message names."""

_KINDS: dict[Any, tuple[str, Callable[[Any], bool]]] = {
    float: ("a number", lambda v: isinstance(v, (int, float)) and not isinstance(v, bool)),
    int: ("a whole number", lambda v: isinstance(v, int) and not isinstance(v, bool)),
    bool: ("true or false", lambda v: isinstance(v, bool)),
    str: ("text", lambda v: isinstance(v, str)),
}

_folder: ContextVar[Path | None] = ContextVar("folder", default=None)


def within(lower: float, upper: float) -> AfterValidator:
    """Bounds of a number, for Annotated; NaN fails.

    Args:
        lower: smallest value that is allowed.
        upper: largest value that is allowed.
    """

    def check(value: float) -> float:
        if not lower <= value <= upper:
            raise ValueError(f"expected {lower:g} to {upper:g}, got {value!r}")
        return value

    return AfterValidator(check)


def beside(name: str) -> Path:
    """Path of a file that a configuration names: relative to the YAML file that is being loaded."""
    return (_folder.get() or Path()) / name


def packaged(package: str, name: str) -> Path:
    """Path of a data file that is installed with a package.

    Args:
        package: Python package.
        name: of the file in its folder `config`.
    """
    return Path(str(files(package) / "config" / name))


def read_yaml(path: str | Path) -> dict[str, Any]:
    """Read a YAML file that holds one mapping.

    Raises:
        ConfigError: if the file is missing, is not YAML or is not a mapping.
    """
    content: dict[str, Any] = _read(path).content
    return content


def _read(path: str | Path) -> Document:
    try:
        text = read_given(path)
    except (OSError, UnicodeDecodeError, ValueError) as error:
        raise ConfigError(f"{path}: cannot be read ({error})") from error
    try:
        document = parse(text)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from error
    if not isinstance(document.content, dict):
        kind = type(document.content).__name__
        raise ConfigError(f"{path}: expected a mapping of keys, got {kind}")
    return document


def load_config(
    cls: type[T],
    path: str | Path,
    shared: Mapping[str, Any] | None = None,
    source: str | Path = "",
    defaults: Mapping[str, Any] | None = None,
) -> T:
    """Make one configuration dataclass from a YAML file.

    Args:
        cls: pydantic dataclass with config STRICT.
        path: YAML file with the fields of cls; missing ones take their default.
        shared: fields that another file of the rig has; where this file has them, too, both must
            agree.
        source: that other file.
        defaults: fields that hold where this file does not say otherwise; nested as the file.

    Raises:
        ConfigError: naming the file, the line, the key, what was expected and what came.
    """
    document = _read(path)
    content = document.content
    findings = _wrong_types(cls, content)
    if findings:
        raise ConfigError(f"{path}: {_told(document, findings)}")
    token = _folder.set(Path(path).resolve().parent)
    try:
        made = cls(**{**(shared or {}), **_filled(content, defaults or {})})
    except ValidationError as error:
        raise ConfigError(f"{path}: {_told(document, _of_pydantic(error))}") from error
    except ConfigError as error:
        raise type(error)(f"{path}: {error}") from error
    except (TypeError, ValueError) as error:
        raise ConfigError(f"{path}: {error}") from error
    finally:
        _folder.reset(token)
    _check_shared(path, document, shared or {}, source)
    return made


def _filled(content: dict[str, Any], defaults: Mapping[str, Any]) -> dict[str, Any]:
    """The file's values, and defaults where it has none."""
    found = {**defaults, **content}
    for key, value in defaults.items():
        if isinstance(value, Mapping) and isinstance(content.get(key), dict):
            found[key] = _filled(content[key], value)
    return found


def _check_shared(
    path: str | Path, document: Document, shared: Mapping[str, Any], source: str | Path
) -> None:
    """Refuse a number that stands in two files and differs."""
    for key, value in shared.items():
        if key in document.content and not _same(document.content[key], value):
            raise ConfigError(
                f"{path}: {key} (line {document.line((key,))}): expected {shown(value)} as in "
                f"{source}, got {shown(document.content[key])}; delete it here"
            )


def _same(one: Any, other: Any) -> bool:
    try:
        return bool(np.array_equal(np.asarray(one, dtype=float), np.asarray(other, dtype=float)))
    except (TypeError, ValueError):
        return bool(one == other)


Finding = tuple[tuple[Any, ...], str]


def _wrong_types(hint: Any, value: Any, place: tuple[Any, ...] = ()) -> list[Finding]:
    """Values of another type than a field's; pydantic alone would read "yes" as true."""
    origin, parts = get_origin(hint), get_args(hint)
    if origin is Annotated:
        return _wrong_types(parts[0], value, place)
    if origin in (Union, UnionType):
        found = [_wrong_types(part, value, place) for part in parts if part is not type(None)]
        if (value is None and type(None) in parts) or [] in found:
            return []
        return min(found, key=len)
    if origin is list:
        if not isinstance(value, list):
            return [(place, f"expected a list, got {shown(value)}")]
        return [
            finding
            for index, item in enumerate(value)
            for finding in _wrong_types(parts[0], item, (*place, index))
        ]
    if dataclasses.is_dataclass(hint):
        if not isinstance(value, dict):
            return [(place, f"expected a mapping of keys, got {shown(value)}")]
        hints = get_type_hints(hint, include_extras=True)
        # pydantic finds unknown keys.
        return [
            finding
            for key, item in value.items()
            if key in hints
            for finding in _wrong_types(hints[key], item, (*place, key))
        ]
    if hint not in _KINDS:
        return []
    kind, fits = _KINDS[hint]
    return [] if fits(value) else [(place, f"expected {kind}, got {shown(value)}")]


def _of_pydantic(error: ValidationError) -> list[Finding]:
    found: list[Finding] = []
    for item in error.errors(include_url=False):
        came = shown(item.get("input"))
        text = {
            "unexpected_keyword_argument": f"expected no such key, got {came}",
            "missing": "expected this key, got none",
            "missing_argument": "expected this key, got none",
        }.get(item["type"])
        if text is None:
            # What our own checks raise says already what came.
            own = item["type"] == "value_error"
            text = str(item["ctx"]["error"]) if own else f"{item['msg']} (got {came})"
        found.append((item["loc"], text))
    return found


def _told(document: Document, findings: list[Finding]) -> str:
    """Name the mistakes, each with its key and line."""
    told = []
    for place, text in findings[:MAX_FINDINGS]:
        line = document.line(place)
        key = ".".join(str(part)[:80] for part in place)
        # A check of the whole mapping names its keys itself.
        where = f"{key} (line {line}): " if key and line else (f"{key}: " if key else "")
        told.append(f"{where}{text[:400]}")
    more = len(findings) - MAX_FINDINGS
    return "; ".join(told) + (f"; and {more} more" if more > 0 else "")
