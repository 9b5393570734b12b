"""Typed configuration: frozen dataclasses from YAML; an unknown key is an error."""

from __future__ import annotations

from contextvars import ContextVar
from importlib.resources import files
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import ValidationError

from cabols_control.errors import ConfigError

T = TypeVar("T")

STRICT: Any = {"extra": "forbid"}
"""Configuration of every pydantic dataclass here: `@dataclass(frozen=True, config=STRICT)`."""

_folder: ContextVar[Path | None] = ContextVar("folder", default=None)


def beside(name: str) -> Path:
    """Path of a file that a configuration names: relative to the YAML file that is being loaded."""
    return (_folder.get() or Path()) / name


def packaged(package: str, name: str) -> Path:
    """Path of a configuration file that is installed with a package."""
    return Path(str(files(package) / "config" / name))


def read_yaml(path: str | Path) -> dict[str, Any]:
    """Read a YAML file that holds one mapping.

    Raises:
        ConfigError: if the file is missing, is not YAML or is not a mapping.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
        content = yaml.safe_load(text)
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: cannot be read ({error})") from error
    except yaml.YAMLError as error:
        raise ConfigError(f"{path}: expected YAML, got {error}") from error
    if not isinstance(content, dict):
        raise ConfigError(f"{path}: expected a mapping of keys, got {type(content).__name__}")
    return content


def load_config(cls: type[T], path: str | Path) -> T:
    """Make one configuration dataclass from a YAML file.

    Args:
        cls: pydantic dataclass with config STRICT.
        path: YAML file with the fields of cls; missing ones take their default.

    Raises:
        ConfigError: naming the file, the key, what was expected and what came.
    """
    content = read_yaml(path)
    token = _folder.set(Path(path).resolve().parent)
    try:
        return cls(**content)
    except ValidationError as error:
        raise ConfigError(f"{path}: {_first_lines(error)}") from error
    except (TypeError, ValueError) as error:
        raise ConfigError(f"{path}: {error}") from error
    finally:
        _folder.reset(token)


def _first_lines(error: ValidationError) -> str:
    found = []
    for item in error.errors()[:5]:
        key = ".".join(str(part) for part in item["loc"]) or "file"
        found.append(f"{key}: {item['msg']} (got {item.get('input')!r})")
    return "; ".join(found)
