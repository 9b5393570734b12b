# SPDX-License-Identifier: Apache-2.0
"""Entry points of nodes and ROS tools: the command line is judged before rclpy is imported.

`ros2 run PACKAGE NODE --help` lists the node's parameters and starts nothing; an unknown word, a
misspelt parameter or one of another node's ends it with exit code 2 and a suggestion.
"""

from __future__ import annotations

import atexit
import importlib
import os
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NoReturn

import yaml

from cabols_control import end_signals
from cabols_control.command_line import (
    DONE,
    USAGE,
    CommandParser,
    did_you_mean,
    fail,
    unknown_options,
)
from cabols_control.parameters.declared import (
    DeclaredParameter,
    declared_parameters,
    docstring_of,
)

ROS_ARGS, END = "--ros-args", "--"
OF_EVERY_NODE = ("use_sim_time", "start_type_description_service")
"""Parameters that rclpy declares itself."""
ROS_FIRST = "cabols_control.ros.messages.transport"
"""Imports rclpy, whose wheels restart Python once to find their libraries."""
RULE, FILE, OUTPUT = ":=", "_file", "output"
EPILOG = """Parameters are set by --ros-args -p NAME:=VALUE or --params-file FILE; indices from 0.
Exit code: 0 ended by INT, TERM, HUP or QUIT, 1 the node failed, 2 a wrong command line or file."""


def node(name: str, module: str) -> Callable[[], int]:
    """Return the entry point of a node.

    Args:
        name: of the executable.
        module: full name of the module whose `main` runs it.
    """

    def entry() -> int:
        if missing := without_ros():
            return fail(missing, USAGE)
        open_standard_files()
        # Python may be restarted for rclpy (ROS_FIRST): they wait until that is over. Then they end
        # the process at once, as nothing is open yet, until the node takes them over.
        end_signals.hold()
        check_node_arguments(name, module, sys.argv[1:])
        importlib.import_module(ROS_FIRST)
        end_signals.handle(lambda *_: os._exit(DONE))
        leave(int(importlib.import_module(module).main()))

    return entry


def leave(code: int) -> NoReturn:
    """End this process, whose node has closed what it opened, as the interpreter would, but faster.

    What waits for an end is done: threads, files, registered functions. To take everything apart,
    object by object, would need half a second more, a web server seconds on a busy machine.

    Args:
        code: exit code.
    """
    threading._shutdown()  # type: ignore[attr-defined]
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):
            stream.flush()
    os._exit(code)


def tool(module: str, parser: Callable[[], CommandParser]) -> Callable[[], int]:
    """Return the entry point of a tool that joins the graph.

    Args:
        module: full name of the module whose `main` runs it, with the same parser.
        parser: makes its parser; needs nothing of ROS.
    """

    def entry() -> int:
        words, _ = split_ros_arguments(sys.argv[1:])
        parser().parse_args(words)
        if missing := without_ros():
            return fail(missing, USAGE)
        return int(importlib.import_module(module).main())

    return entry


def open_standard_files() -> None:
    """Open what is closed of standard input, output and error, as who starts daemons may leave it.

    Their numbers would go to the next files and sockets, and log lines into these.
    """
    # A new file gets the lowest number that is free.
    while (number := os.open(os.devnull, os.O_RDWR)) < 3:
        pass
    os.close(number)


def without_ros() -> str:
    """Say that what needs ROS cannot run here, as where pip alone installed it; else empty."""
    lacking = [name for name in ("rclpy", "cabols_msgs") if find_spec(name) is None]
    if not lacking:
        return ""
    return (
        f"expected ROS 2 with this project's messages, found no {' and no '.join(lacking)}: "
        "install as docs/installing.md says, and source the workspace"
    )


def check_node_arguments(name: str, module: str, words: Sequence[str]) -> None:
    """Judge a node's command line before ROS reads it; return if the node may start.

    Args:
        name: of the executable, and of the node.
        module: full name of the module that declares its parameters.
        words: command line after the executable's name.

    Raises:
        SystemExit: 0 after help or version; 2 if the node could not obey: an unknown word or
            parameter, a file that is not there, an output folder with files in it.
    """
    parser = node_parser(name, module)
    own, ros = split_ros_arguments(words)
    # parse_known_args, as a node has no options of its own but --help and --version.
    _, unknown = parser.parse_known_args(own)
    if unknown:
        parser.error(unknown_options(unknown, [*parser.option_names(), ROS_ARGS]))
    known = [parameter.name for parameter in declared_parameters(module)]
    wrong = [
        f"unknown parameter {given}{did_you_mean(given, known)}"
        for given in given_parameters(name, ros)
        if given not in (*known, *OF_EVERY_NODE) and not given.startswith("qos_overrides.")
    ]
    wrong += [
        f"{given}: {value}: expected a file, found none; check the path"
        for given, value in given_files(name, ros)
    ]
    wrong += [
        f"{given}: {value}: expected a new or empty folder, got one with files; name another one"
        for given, value in _given(name, ros)
        if given == OUTPUT and isinstance(value, str) and _occupied(Path(value))
    ]
    if wrong:
        parser.error("; ".join(wrong))


def node_parser(name: str, module: str) -> CommandParser:
    """Return a parser whose help lists the node's parameters.

    Args:
        name: of the executable.
        module: full name of the module that declares them; it is read, not imported.
    """
    text = docstring_of(module)
    listed = "\n".join(_lines(declared_parameters(module)))
    return CommandParser(name, f"{text}\n\nparameters:\n{listed}", EPILOG)


def _lines(parameters: Sequence[DeclaredParameter]) -> Iterator[str]:
    for parameter in parameters:
        bounds = f", {parameter.bounds.replace(', ', ' to ')}" if parameter.bounds else ""
        yield f"  {parameter.name} (default {parameter.default}{bounds})"
        yield f"      {parameter.description}"


def split_ros_arguments(words: Sequence[str]) -> tuple[list[str], list[str]]:
    """Split a command line into a program's own words and those for ROS."""
    own: list[str] = []
    ros: list[str] = []
    inside = False
    for word in words:
        if word == ROS_ARGS:
            inside = True
        elif inside and word == END:
            inside = False
        else:
            (ros if inside else own).append(word)
    return own, ros


def given_parameters(name: str, ros: Sequence[str]) -> list[str]:
    """Return the names of the parameters that ROS arguments give to a node, in their order.

    Args:
        name: of the node; what is meant for others is left out.
        ros: words for ROS, as split_ros_arguments returns them.
    """
    return [parameter for parameter, _ in _given(name, ros)]


def given_files(name: str, ros: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Yield the parameters that name a file which is not there, with the file.

    Args:
        name: of the node; what is meant for others is left out.
        ros: words for ROS, as split_ros_arguments returns them.
    """
    for parameter, value in _given(name, ros):
        named = parameter.endswith(FILE) and isinstance(value, str) and value
        if named and not Path(value).is_file():
            yield parameter, value


def _occupied(folder: Path) -> bool:
    return folder.is_dir() and any(folder.iterdir())


def _given(name: str, ros: Sequence[str]) -> Iterator[tuple[str, Any]]:
    words = iter(ros)
    for word in words:
        if word in ("-p", "--param"):
            left, _, value = next(words, "").partition(RULE)
            target, _, parameter = left.rpartition(":")
            if target in ("", name):
                yield parameter, _parsed(value)
        elif word == "--params-file":
            yield from _in_file(name, Path(next(words, "")))


def _parsed(value: str) -> Any:
    try:
        return yaml.safe_load(value)
    except yaml.YAMLError:
        # rcl reads it again, and says what is wrong with it.
        return None


def _in_file(name: str, path: Path) -> Iterator[tuple[str, Any]]:
    """Yield what a parameter file has for this node alone; for all nodes it may have more."""
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError):
        # rcl reads it again, and says what is wrong with it.
        return
    for target, section in content.items() if isinstance(content, dict) else ():
        last = str(target).rpartition("/")[2]
        if last == name and isinstance(section, dict):
            yield from (section.get("ros__parameters") or {}).items()
