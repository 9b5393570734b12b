# SPDX-License-Identifier: Apache-2.0
"""Launch arguments as a person types them: converted and looked up before a node starts."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from cabols_control.bringup.graph import all_nodes
from cabols_control.bringup.specs import Argument
from cabols_control.errors import CabolsError, ConfigError
from cabols_control.files.plain_numbers import plain_number
from cabols_control.geometry import MIN_CABLES
from cabols_control.load_programs.programs import BUILT_IN, load_program
from cabols_control.rig_folder import find_rig
from cabols_control.tension import check_method
from cabols_control.topics import foreign_row

TRUTH = {"true": True, "false": False}
WHOLE = re.compile(r"[+-]?\d+")
PATHS = ("output", "campaigns", "uploads", "campaign_folder")
"""Folders that are made where they are not there; files end in `_file`."""
LAUNCH_FILES = ("bench.launch.py", "rig.launch.py")
WRITTEN = ("bias_file",)
"""Files that a run may make."""


def read_arguments(
    arguments: Sequence[Argument], texts: Mapping[str, str], known: Sequence[str] = ()
) -> dict[str, Any]:
    """Read all arguments of a launch.

    Args:
        arguments: that there are.
        texts: as given, by name; what is missing has its default.
        known: further names that are somebody else's.

    Returns:
        Values by name, typed as the defaults; paths without `~`.

    Raises:
        ConfigError: naming every argument that cannot be used or is not known, a line each.
    """
    names = [argument.name for argument in arguments]
    wrong = [_unknown(name, names) for name in texts if name not in (*names, *known)]
    values: dict[str, Any] = {}
    for argument in arguments:
        with _refusals_into(wrong):
            text = texts.get(argument.name)
            value = argument.default if text is None else read_argument(argument, text)
            values[argument.name] = value
            _look_up(argument.name, value)
    if wrong:
        raise ConfigError("; ".join(wrong) if len(wrong) == 1 else "\n  ".join(["", *wrong]))
    return values


@contextmanager
def _refusals_into(wrong: list[str]) -> Iterator[None]:
    """Collect what is refused inside."""
    try:
        yield
    except CabolsError as error:
        wrong.append(str(error))


def others(
    configurations: Sequence[str], typed: Sequence[str], command: Sequence[str]
) -> list[str]:
    """Names in a launch that are not for us to judge: of a launch file that includes ours.

    Args:
        configurations: names of all launch configurations.
        typed: words of the form name:=text that the launch was given.
        command: words of the command line of this process.
    """
    files = [Path(word).name for word in command if word.endswith(".launch.py")]
    if files and not set(files) & set(LAUNCH_FILES):
        return list(configurations)
    names = {word.partition(":=")[0] for word in typed}
    return [name for name in configurations if name not in names]


def read_argument(argument: Argument, text: str) -> Any:
    """Read one argument's text as the type of its default.

    Args:
        argument: which.
        text: as typed.

    Raises:
        ConfigError: if it is no such value or out of the bounds.
    """
    words = text.strip()
    if isinstance(argument.default, bool):
        if words.lower() not in TRUTH:
            raise ConfigError(f"{argument.name}: expected true or false, got {text!r}")
        return TRUTH[words.lower()]
    if isinstance(argument.default, int):
        if not WHOLE.fullmatch(words):
            raise ConfigError(
                f"{argument.name}: expected {_range(argument, 'a whole number')}, got {text!r}"
            )
        return argument.checked(int(words))
    if isinstance(argument.default, float):
        return argument.checked(_number(argument, words, text))
    if isinstance(argument.default, list):
        parts = words.removeprefix("[").removesuffix("]").split(",")
        if len(parts) != len(argument.default):
            raise ConfigError(
                f"{argument.name}: expected {len(argument.default)} numbers as in "
                f"{argument.default}, got {text!r}"
            )
        return [argument.checked(_number(argument, part.strip(), text)) for part in parts]
    return argument.checked(_expanded(argument.name, words))


def _number(argument: Argument, words: str, text: str) -> float:
    try:
        number = plain_number(words)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise ConfigError(f"{argument.name}: expected {_range(argument, 'a number')}, got {text!r}")
    return number


def _range(argument: Argument, what: str) -> str:
    if argument.bounds is None:
        return what
    unit = f" {argument.unit}" if argument.unit else ""
    return f"{what} from {argument.bounds[0]:g} to {argument.bounds[1]:g}{unit}"


def _expanded(name: str, text: str) -> str:
    """Replace `~` in what names a file or folder."""
    names_path = name.endswith("_file") or name in (*PATHS, "rig", "program")
    if not (names_path and text.startswith("~")):
        return text
    try:
        return str(Path(text).expanduser())
    except RuntimeError as error:
        raise ConfigError(f"{name}: expected a path, got {text!r} ({error})") from error


def _unknown(name: str, names: Sequence[str]) -> str:
    close = difflib.get_close_matches(name, names, 1)
    hint = f"did you mean {close[0]}?" if close else "--show-args lists those that there are"
    return f"{name}: there is no such argument; {hint}"


def _look_up(name: str, value: Any) -> None:
    """Find what a value names, while an answer can still be given at once."""
    if not value or not isinstance(value, str):
        return
    if name.endswith("_file") and name not in WRITTEN and not Path(value).is_file():
        raise ConfigError(f"{name}: expected a file, found none at {value}")
    if name in LOOKED_UP:
        try:
            LOOKED_UP[name](value)
        except CabolsError as error:
            raise ConfigError(f"{name}:={value}: {error}") from error
    if name in PATHS and Path(value).exists() and not Path(value).is_dir():
        raise ConfigError(f"{name}: expected a folder, found a file at {value}")
    if name in PATTERNS and not re.fullmatch(PATTERNS[name][0], value):
        raise ConfigError(f"{name}: expected {PATTERNS[name][1]}, got {value!r}")


def _find_program(text: str) -> None:
    if text not in BUILT_IN:
        load_program(text)


def _find_topics(text: str) -> None:
    try:
        for name in listed(text):
            foreign_row(name)
    except ValueError as error:
        raise ConfigError(str(error)) from error


def _find_nodes(text: str) -> None:
    there = {node.executable for node in all_nodes()}
    if strange := [name for name in listed(text) if name not in there]:
        raise ConfigError(f"expected some of {', '.join(sorted(there))}, got {', '.join(strange)}")


def listed(text: str) -> list[str]:
    """Names, such as topics', in a text that separates them by commas."""
    return [name.strip() for name in text.split(",") if name.strip()]


def _new_folder(text: str) -> None:
    folder = Path(text)
    if folder.is_dir() and any(folder.iterdir()):
        raise ConfigError("expected a new or empty folder, got one with files; name another one")


HOST = r"[A-Za-z0-9](?:[A-Za-z0-9.-]*[A-Za-z0-9])?"
PATTERNS = {
    "namespace": (r"(/[A-Za-z_]\w*)+", "a namespace such as /rig2"),
    "frame_prefix": (r"[A-Za-z_]\w*/?", "letters, then a slash, such as rig2/"),
    "board": (r"\d{1,3}", "the number of a card, from 0"),
    "robot_address": (HOST, "an IP address or a host's name"),
    "console_host": (rf"{HOST}|[0-9A-Fa-f:]*:[0-9A-Fa-f:]*", "an IP address or a host's name"),
    "tracker_address": (rf"{HOST}:\d{{1,5}}", "host:port"),
}
"""What a text must look like, and in words."""
LOOKED_UP: dict[str, Callable[[str], Any]] = {
    "rig": find_rig,
    "program": _find_program,
    "output": _new_folder,
    "record_also": _find_topics,
    "nodes": _find_nodes,
    "tension_method": lambda text: check_method(MIN_CABLES, text),
}
