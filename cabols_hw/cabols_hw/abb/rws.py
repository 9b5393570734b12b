"""Moves the robot to its stored configurations: RAPID variables over Robot Web Services.

The program on the controller is rapid/cabols.mod. Its handshake: the rig writes cabols_target,
cabols_done := FALSE and cabols_go := TRUE; the program takes cabols_go back, moves, and sets
cabols_done, or cabols_error. Before it starts the program the rig sets cabols_error := -1 and
waits until main has cleared it: only then has the program dropped old demands and accepts new ones.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, TypeVar

import requests
from abb_robot_client.rws import RWS, ABBException
from requests.adapters import HTTPAdapter

from cabols_control.naming import configuration_name
from cabols_hw.abb.errors import MoveAbortedError, RobotError

T = TypeVar("T")

STARTING = -1
REASONS = {
    1: "the RAPID program has no such configuration: are both files of the same version?",
    2: "the motion failed on the controller: read its event log",
}


def judge_motion(error: int, done: bool, running: bool) -> bool:
    """Whether the demanded motion is complete.

    Args:
        error: cabols_error.
        done: cabols_done.
        running: whether RAPID runs.

    Raises:
        RobotError: if it can no longer be completed.
    """
    if error:
        raise RobotError(f"robot: {REASONS.get(error, f'RAPID program reports error {error}')}")
    if done:
        return True
    if not running:
        raise RobotError(
            "robot: RAPID has stopped before the motion was done (emergency stop, operator or a "
            "program error): clear it on the controller, then ask again"
        )
    return False


class _TimedAdapter(HTTPAdapter):
    """Gives every request a time-out; abb_robot_client sets none and would wait without end."""

    def __init__(self, timeout_s: float) -> None:
        self._timeout_s = timeout_s
        super().__init__()

    def send(self, *args: Any, **options: Any) -> Any:
        if options.get("timeout") is None:
            options["timeout"] = self._timeout_s
        return super().send(*args, **options)


class RobotMover:
    """Starts, watches and aborts motions; one at a time, from one thread."""

    def __init__(self, url: str, user: str, password: str, timeout_s: float = 2.0) -> None:
        """Prepare; nothing is sent yet.

        Args:
            url: of the controller, e.g. http://192.168.125.1:80.
            user: of the controller.
            password: its password; never logged.
            timeout_s: of every request, and of the program's start.
        """
        self._url = url
        self._timeout_s = timeout_s
        self._rws = RWS(url, user, password)
        self._rws._session.mount("http://", _TimedAdapter(timeout_s))

    def _ask(self, what: str, request: Callable[[], T]) -> T:
        """Make a request; turn every failure into a RobotError that says what to do."""
        try:
            return request()
        except ABBException as error:
            raise RobotError(f"robot: {what} refused: {error} (code {error.code})") from error
        except requests.exceptions.RequestException as error:
            raise RobotError(
                f"robot: no answer from {self._url} within {self._timeout_s:g} s "
                f"({type(error).__name__}): check address, cable and controller"
            ) from error
        except RobotError:
            raise
        # abb_robot_client raises a plain Exception for a non-JSON answer, e.g. a wrong password.
        except Exception as error:
            text = str(error)
            if "401" in text:
                raise RobotError(
                    f"robot: {self._url} does not accept this user and password: check them"
                ) from error
            raise RobotError(f"robot: {what} failed: {text}") from error

    def _number(self, name: str) -> float:
        return self._ask(f"reading {name}", lambda: float(self._rws.get_rapid_variable(name)))

    def _flag(self, name: str) -> bool:
        text = self._ask(f"reading {name}", lambda: str(self._rws.get_rapid_variable(name)))
        return text.strip().upper() == "TRUE"

    def _write(self, name: str, value: str) -> None:
        self._ask(f"writing {name}", lambda: self._rws.set_rapid_variable(name, value))

    def running(self) -> bool:
        """Whether RAPID runs."""
        state = self._ask("reading the execution state", self._rws.get_execution_state)
        return bool(state.ctrlexecstate == "running")

    def check_ready(self) -> None:
        """Raise RobotError unless the controller is in AUTO with its motors on."""
        mode = self._ask("reading the operation mode", self._rws.get_operation_mode)
        if mode != "AUTO":
            raise RobotError(f"robot: controller is in {mode}: turn its key to AUTO")
        state = self._ask("reading the controller's state", self._rws.get_controller_state)
        if state != "motoron":
            raise RobotError(
                f"robot: controller is in state {state}: release emergency stops, press motors on"
            )

    def start_move(self, index: int) -> None:
        """Demand a motion; starts the program where it does not run.

        Args:
            index: of the stored configuration.

        Raises:
            RobotError: if the controller cannot be reached or refuses; see check_ready.
        """
        if not self.running():
            self._start_program()
        self._write("cabols_target", str(int(index)))
        self._write("cabols_done", "FALSE")
        self._write("cabols_error", "0")
        self._write("cabols_go", "TRUE")

    def _start_program(self) -> None:
        """Start the program from main: continuing would complete the aborted motion."""
        self._write("cabols_error", str(STARTING))
        self._ask("program pointer to main", self._rws.resetpp)
        self._ask("starting RAPID", lambda: self._rws.start(cycle="forever"))
        give_up = time.monotonic() + self._timeout_s
        while self._number("cabols_error") == STARTING:
            if time.monotonic() > give_up:
                self.abort()
                raise RobotError(
                    f"robot: the RAPID program did not begin within {self._timeout_s:g} s; "
                    "is cabols.mod loaded, with its main?"
                )
            time.sleep(0.02)

    def done(self) -> bool:
        """Whether the demanded motion is complete.

        Raises:
            RobotError: if it can no longer be completed.
        """
        # Read done before running: the motion may end, and RAPID stop, between the two reads.
        done = self._flag("cabols_done")
        return judge_motion(int(self._number("cabols_error")), done, done or self.running())

    def abort(self) -> None:
        """Stop RAPID, and with it the robot; withdraw the demand.

        Raises:
            RobotError: if the controller did not accept it: use its emergency stop.
        """
        try:
            self._ask("stopping RAPID", self._rws.stop)
        except RobotError as error:
            raise RobotError(
                f"{error}; THE ROBOT MAY STILL MOVE: use its emergency stop"
            ) from error
        self._write("cabols_go", "FALSE")

    def move(
        self,
        index: int,
        timeout_s: float,
        interrupted: Callable[[], str],
        poll_s: float = 0.1,
    ) -> None:
        """Move and wait for the end; after any failure stop the robot first.

        Args:
            index: of the stored configuration.
            timeout_s: for the whole motion.
            interrupted: called between polls; a reason, to abort for it, or an empty string.
            poll_s: period of reading the done flag.

        Raises:
            MoveAbortedError: after an interruption or the time-out; the robot has been stopped.
            RobotError: for everything else.
        """
        motion = f"robot: motion to {configuration_name(index)}"
        reason = interrupted()
        if reason:
            raise MoveAbortedError(f"{motion} not begun: {reason}")
        give_up = time.monotonic() + timeout_s
        self.check_ready()
        try:
            self.start_move(index)
            while not self.done():
                reason = interrupted()
                if not reason and time.monotonic() > give_up:
                    reason = f"not done within {timeout_s:g} s"
                if reason:
                    raise MoveAbortedError(f"{motion} aborted: {reason}")
                time.sleep(poll_s)
        except RobotError as error:
            self._abort_after(error)
            raise

    def _abort_after(self, error: RobotError) -> None:
        try:
            self.abort()
        except RobotError as second:
            raise RobotError(f"{error}; {second}") from error

    def close(self) -> None:
        """Log out, as controllers have few sessions."""
        self._rws.close()
