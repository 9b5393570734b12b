# SPDX-License-Identifier: Apache-2.0
"""Common parts of all commands: options, exit codes, errors on one line.

Exit codes: 0 done; 1 a target was not met, or a run failed; 2 the command line cannot be used (an
unknown option, a missing file, an occupied output folder); 130 after Ctrl-C.
"""

from __future__ import annotations

import argparse
import difflib
import functools
import signal
import sys
from collections.abc import Callable, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, NoReturn, ParamSpec

from cabols_control.errors import CabolsError, UsageError
from cabols_control.rig_folder import BENCH, find_rig

DONE, FAILED, USAGE, INTERRUPTED = 0, 1, 2, 130
EPILOG = (
    "Exit code: 0 done, 1 a target not met or a run failed, 2 a wrong command line, 130 Ctrl-C."
)
USER_ERRORS = (FileNotFoundError, IsADirectoryError, NotADirectoryError, PermissionError)
"""Of the operating system, about what the user named."""
Parameters = ParamSpec("Parameters")


class CommandParser(argparse.ArgumentParser):
    """Parser of one command: `--version`, no abbreviations, suggestions for misspelt options."""

    def __init__(
        self, prog: str, description: str | None = None, epilog: str = EPILOG, **options: Any
    ) -> None:
        """Make a parser; the description is the command's docstring."""
        super().__init__(
            prog=prog,
            description=description,
            epilog=epilog,
            allow_abbrev=False,
            formatter_class=argparse.RawDescriptionHelpFormatter,
            **options,
        )
        self.add_argument("--version", action="version", version=f"{prog} of cabols {_version()}")

    def parse_args(  # type: ignore[override]
        self, args: Sequence[str] | None = None, namespace: argparse.Namespace | None = None
    ) -> argparse.Namespace:
        """Parse a command line.

        Args:
            args: words after the command's name; None: those of this process.
            namespace: takes the values, as in argparse; None: a new one.

        Raises:
            SystemExit: 2 for what is not known, with a suggestion, or is missing; 0 after help
                or version.
        """
        words = list(sys.argv[1:] if args is None else args)
        # Before argparse itself, which complains of missing arguments first.
        if misspelt := self._misspelt(words):
            self.error(unknown_options(misspelt, self.option_names()))
        found, unknown = self.parse_known_args(words, namespace)
        if unknown:
            self.error(unknown_options(unknown, self.option_names()))
        return found

    def _misspelt(self, words: Sequence[str]) -> list[str]:
        own = words[: words.index("--")] if "--" in words else words
        known = self.option_names()
        return [
            word for word in own if word.startswith("--") and word.partition("=")[0] not in known
        ]

    def option_names(self) -> list[str]:
        """Names of all options, those of subcommands among them."""
        names = list(self._option_string_actions)
        for action in self._actions:
            if isinstance(action, argparse._SubParsersAction):
                for parser in action.choices.values():
                    names += parser._option_string_actions
        return names

    def error(self, message: str) -> NoReturn:
        """Print one line and where there is more; exit with 2."""
        self.exit(USAGE, f"error: {message}\n`{self.prog} --help` lists the options\n")


def rig_option(parser: argparse.ArgumentParser) -> None:
    """Add `--rig`, whose value is the rig's folder."""
    parser.add_argument(
        "--rig",
        type=_rig,
        default=BENCH,
        help="name of an installed rig, or folder of a rig (default: %(default)s)",
    )


def text_option(parser: argparse.ArgumentParser) -> None:
    """Add `--output`, for a command whose result is one text."""
    parser.add_argument("--output", type=Path, default=None, help="file; default: print it")


def give_out(text: str, output: Path | None) -> None:
    """Print a command's result, or write it to a file.

    Args:
        text: with its last line's end.
        output: file that `--output` names; None: print.
    """
    if output is None:
        print(text, end="")
    else:
        output.write_text(text, encoding="utf-8")


def _rig(text: str) -> str:
    try:
        folder = find_rig(text)
    except CabolsError as error:
        raise argparse.ArgumentTypeError(str(error)) from error
    return text if text == BENCH else str(folder.path)


def unknown_options(unknown: Sequence[str], known: Sequence[str]) -> str:
    """Return the unknown words with suggestions.

    Args:
        unknown: words that the parser did not take.
        known: options that it has.
    """
    said = []
    for word in unknown:
        name = word.partition("=")[0]
        if name.startswith("-"):
            said.append(f"unknown option {name}{did_you_mean(name, known)}")
    return "; ".join(said) or f"unexpected argument {unknown[0]!r}"


def existing_file(text: str) -> str:
    """Type of an option that names a file to read; empty: none."""
    if text and not Path(text).is_file():
        raise argparse.ArgumentTypeError(f"{text}: expected a file, found none; check the path")
    return text


def existing_path(text: str) -> Path:
    """Type of an option that names a file to read, as a path."""
    return Path(existing_file(text))


def did_you_mean(word: str, known: Sequence[str]) -> str:
    """Return ` (did you mean ...?)`, or nothing if nothing known is like the word.

    Args:
        word: that nobody knows.
        known: words that exist.
    """
    close = difflib.get_close_matches(word, known, n=1)
    return f" (did you mean {close[0]}?)" if close else ""


def command(main: Callable[Parameters, int]) -> Callable[Parameters, int]:
    """Decorate a command's main: a user's mistake becomes one line and an exit code."""

    @functools.wraps(main)
    def guarded(*args: Parameters.args, **kwargs: Parameters.kwargs) -> int:
        try:
            return main(*args, **kwargs)
        except CabolsError as error:
            return fail(str(error), USAGE if isinstance(error, UsageError) else FAILED)
        except BrokenPipeError:
            # The reader of the output has ended, as `| head` does.
            return FAILED
        except OSError as error:
            return fail(
                f"{error.filename}: {error.strerror}" if error.filename else str(error),
                USAGE if isinstance(error, USER_ERRORS) else FAILED,
            )
        except KeyboardInterrupt:
            return fail("interrupted", INTERRUPTED)

    return guarded


def interrupt_once() -> None:
    """Let the first SIGINT or SIGTERM raise a KeyboardInterrupt; later ones do nothing."""
    signals = (signal.SIGINT, signal.SIGTERM)

    def interrupt(*_: object) -> None:
        for each in signals:
            signal.signal(each, lambda *_: None)
        raise KeyboardInterrupt

    for each in signals:
        signal.signal(each, interrupt)


def fail(text: str, code: int) -> int:
    """Print an error on one line and return the exit code.

    Args:
        text: what was expected, what came, what to do.
        code: exit code to return.
    """
    print(f"error: {' '.join(text.split())}", file=sys.stderr, flush=True)
    return code


def _version() -> str:
    try:
        return version("cabols_control")
    except PackageNotFoundError:
        return "not installed"
