# SPDX-License-Identifier: Apache-2.0
"""Launch arguments as a person types them: converted and looked up before a node starts."""

from __future__ import annotations

import difflib
import math
import re
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from cabols_control.bringup import network_names
from cabols_control.bringup.graph import all_nodes
from cabols_control.bringup.specs import Argument
from cabols_control.errors import CabolsError, ConfigError
from cabols_control.files.plain_numbers import plain_number
from cabols_control.geometry import MIN_CABLES
from cabols_control.load_programs.programs import BUILT_IN, load_program
from cabols_control.rig_folder import find_rig
from cabols_control.tension import check_method
from cabols_control.topics import FOREIGN, foreign_row, type_is_installed

TRUTH = {"true": True, "false": False}
WHOLE = re.compile(r"[+-]?[0-9]+")
PATHS = ("output", "campaigns", "uploads", "campaign_folder")
"""Folders that are made where they are not there; files end in `_file`."""
LAUNCH_FILES = ("bench.launch.py", "rig.launch.py")
WRITTEN = ("bias_file",)
"""Files that a run may make."""
NEEDED_TYPES = {"frames": FOREIGN["/tf"].type_name}
"""Message types that a flag needs, of packages that not every installation has."""


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
    if argument.default and isinstance(argument.default, str) and not words:
        raise ConfigError(
            f"{argument.name}: expected {_form(argument)}, got nothing; leave it out for "
            f"{argument.default!r}"
        )
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


def check_value(argument: Argument, value: Any) -> None:
    """Judge a value that came typed, as in a file of parameters.

    Args:
        argument: which.
        value: of the type of its default.

    Raises:
        ConfigError: if it is out of the bounds, none of the choices, or names what is not there.
    """
    argument.checked(value)
    _look_up(argument.name, value)


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
    """Find what a value names or needs, while an answer can still be given at once."""
    if value is True and name in NEEDED_TYPES and not type_is_installed(NEEDED_TYPES[name]):
        package = NEEDED_TYPES[name].partition("/")[0]
        raise ConfigError(
            f"{name}: expected the package {package}, found none; install "
            f"ros-jazzy-{package.replace('_', '-')}, or leave {name} out"
        )
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
    if name in WRITTEN and Path(value).is_dir():
        raise ConfigError(f"{name}: expected a file, found a folder at {value}")
    if name in (*PATHS, *WRITTEN):
        _check_writable(name, Path(value))
    if name in FORMS and not FORMS[name].fits(value):
        raise ConfigError(f"{name}: expected {FORMS[name].words}, got {value!r}")


def _check_writable(name: str, path: Path) -> None:
    """Refuse what could not be written: a missing folder is made in the nearest one above."""
    above = path.absolute()
    while not above.is_dir() and above != above.parent:
        if above.exists() and above != path.absolute():
            raise ConfigError(f"{name}: expected a folder, found a file at {above}")
        above = above.parent
    try:
        with tempfile.TemporaryDirectory(dir=above):
            pass
    except OSError as error:
        raise ConfigError(
            f"{name}: expected a place to write to, got {path} ({error.strerror})"
        ) from error


def _form(argument: Argument) -> str:
    if argument.choices:
        return f"one of {', '.join(argument.choices)}"
    return FORMS[argument.name].words if argument.name in FORMS else "a text"


def _find_program(text: str) -> None:
    if text not in BUILT_IN:
        load_program(text)


def _find_topics(text: str) -> None:
    try:
        for name in listed(text):
            row = foreign_row(name)
            if not type_is_installed(row.type_name):
                raise ConfigError(
                    f"expected a type of an installed package, got {row.type_name!r}; source the "
                    "workspace that has it"
                )
    except ValueError as error:
        raise ConfigError(str(error)) from error


def _find_nodes(text: str) -> None:
    there = {node.executable for node in all_nodes()}
    if not listed(text):
        raise ConfigError(f"expected some of {', '.join(sorted(there))}, got none")
    if strange := [name for name in listed(text) if name not in there]:
        raise ConfigError(f"expected some of {', '.join(sorted(there))}, got {', '.join(strange)}")


def listed(text: str) -> list[str]:
    """Names, such as topics', in a text that separates them by commas."""
    return [name.strip() for name in text.split(",") if name.strip()]


def _new_folder(text: str) -> None:
    folder = Path(text)
    if folder.is_dir() and any(folder.iterdir()):
        raise ConfigError("expected a new or empty folder, got one with files; name another one")


FORMS = {
    "namespace": network_names.Form(network_names.is_namespace, "a namespace such as /rig2"),
    "frame_prefix": network_names.Form(
        network_names.matches(r"[A-Za-z_][A-Za-z0-9_]*/?"), "letters, then a slash, such as rig2/"
    ),
    "board": network_names.Form(
        network_names.matches(r"[0-9]{1,3}"), "the number of a card, from 0"
    ),
    "robot_address": network_names.Form(network_names.is_host, "an IP address or a host's name"),
    "console_host": network_names.Form(
        lambda text: network_names.is_host(text) or network_names.is_ipv6(text),
        "an IP address or a host's name",
    ),
    "tracker_address": network_names.Form(network_names.is_host_and_port, "host:port"),
}
"""What a text must look like."""
LOOKED_UP: dict[str, Callable[[str], Any]] = {
    "rig": find_rig,
    "program": _find_program,
    "output": _new_folder,
    "record_also": _find_topics,
    "nodes": _find_nodes,
    "tension_method": lambda text: check_method(MIN_CABLES, text),
}
