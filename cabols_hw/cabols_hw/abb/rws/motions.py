# SPDX-License-Identifier: Apache-2.0
"""Moves the robot to its stored configurations, over Robot Web Services of either version."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import suppress

from cabols_control.naming import configuration_name
from cabols_hw.abb.errors import MoveAbortedError, RobotError, RwsError, RwsFailure
from cabols_hw.abb.rws.client import RwsLane, RwsSession
from cabols_hw.abb.rws.rapid_handshake import RapidHandshake, judge_motion
from cabols_hw.abb.rws.stop import StopAttempts
from cabols_hw.robot.interface import Leg

__all__ = ["RobotMover", "judge_motion"]

POLL_S = 0.2
"""Shortest period of asking the controller whether the motion is done."""

LOG_OUT_S = 0.2


class RobotMover:
    """Starts, watches and aborts motions, one at a time.

    The controller's version is found by asking it. abort() may come from any thread.
    """

    def __init__(
        self,
        url: str,
        user: str,
        password: str,
        timeout_s: float = 2.0,
        certificate: str = "",
    ) -> None:
        """Prepare; nothing is sent yet.

        Args:
            url: of the controller, e.g. http://192.168.125.1:80 or https://192.168.125.1.
            user: of the controller.
            password: its password; never logged.
            timeout_s: of every request with its retries, and of the program's start.
            certificate: PEM file for https; empty: the controller's own is taken as it is.

        Raises:
            RobotError: if the address or the certificate cannot be used.
        """
        self._timeout_s = timeout_s
        self._session = RwsSession(url, user, password, certificate)
        self._program = self._new_program()

    def _new_program(self, timeout_s: float = 0.0) -> RapidHandshake:
        return RapidHandshake(RwsLane(self._session, timeout_s or self._timeout_s), self._timeout_s)

    @property
    def version(self) -> str:
        """Version of Robot Web Services; asks the controller at first."""
        return self._program.lane.dialect().version

    def running(self) -> bool:
        """Whether RAPID runs."""
        return self._program.running()

    def check_ready(self) -> None:
        """Raise RobotError unless the controller is in AUTO with its motors on."""
        self._program.check_ready()

    def start_move(self, index: int | Leg) -> None:
        """Demand a motion; starts the program where it does not run. See RapidHandshake.demand."""
        self._program.demand(index)

    def done(self) -> bool:
        """Whether the demanded motion is complete.

        Raises:
            RobotError: if it can no longer be completed.
        """
        return self._program.done()

    def abort(self) -> None:
        """Stop RAPID, and with it the robot; withdraw the demand.

        Raises:
            RobotError: if the controller did not accept it: use its emergency stop.
        """
        stop = StopAttempts(self._session)
        stopped = _failure_of(stop.run)
        # The demand is withdrawn after a stop that failed, too: it would be obeyed later.
        program = self._new_program()
        withdrawn = _failure_of(program.withdraw)
        program.lane.close()
        if stopped is not None:
            raise RobotError(
                f"{stopped}; THE ROBOT MAY STILL MOVE: use its emergency stop"
            ) from stopped
        if withdrawn is not None:
            raise RobotError(
                f"{withdrawn}; RAPID is stopped, but its old demand was not withdrawn"
            ) from withdrawn

    def move(
        self,
        index: int | Leg,
        timeout_s: float,
        interrupted: Callable[[], str],
        poll_s: float = 0.1,
    ) -> None:
        """Move and wait for the end; after any failure stop the robot first.

        The requests run in a thread of their own, so that one which hangs holds up no stop. What
        was not begun is not stopped: another program may run.

        Args:
            index: of the stored configuration, or a leg of a path.
            timeout_s: for the whole motion.
            interrupted: called every poll_s; a reason, to abort for it, or an empty string.
            poll_s: its period; the controller is asked less often, see POLL_S.

        Raises:
            MoveAbortedError: after an interruption or the time-out; the robot has been stopped.
            RobotError: for everything else.
        """
        goal = configuration_name(index) if isinstance(index, int) else "the path's next point"
        motion = f"robot: motion to {goal}"
        reason = interrupted()
        if reason:
            raise MoveAbortedError(f"{motion} not begun: {reason}")
        give_up = time.monotonic() + timeout_s
        errand = _Errand(self._program, index)
        while not errand.ended.wait(poll_s):
            try:
                reason = interrupted()
            except BaseException as error:
                errand.cancel()
                self._give_up(errand, RobotError(f"{motion} aborted: {error!r}"))
            if not reason and time.monotonic() > give_up:
                reason = f"not done within {timeout_s:g} s"
            if reason:
                errand.cancel()
                self._give_up(errand, MoveAbortedError(f"{motion} aborted: {reason}"))
        if errand.failure is not None:
            self._give_up(errand, errand.failure)
        self._program.give_mastership()

    def _give_up(self, errand: _Errand, error: RobotError) -> None:
        """Stop the robot if its motion was begun; raise the error."""
        self._program = self._new_program()
        try:
            if errand.begun:
                self.abort()
                errand.ended.wait(self._timeout_s)
                # What the errand had sent before may have been obeyed after the stop.
                if self._program.running():
                    self.abort()
        except RobotError as second:
            raise RobotError(f"{error}; {second}") from error
        finally:
            with suppress(RobotError):
                self._program.give_mastership()
        raise error

    def close(self) -> None:
        """Log out, as controllers have few sessions."""
        self._program.lane.close()
        if self._session.logged_in:
            lane = RwsLane(self._session, LOG_OUT_S)
            # A session that stays ends by itself after some minutes.
            with suppress(RwsError):
                lane.ask(lane.dialect().log_out())
            lane.close()
            self._session.forget()


def _failure_of(action: Callable[[], None]) -> RobotError | None:
    try:
        action()
    except RobotError as error:
        return error
    return None


class _Errand:
    """The requests of one motion, in a thread.

    Attributes:
        ended: set at its end.
        failure: what ended it; None for a motion that is done.
        begun: whether a request was made that may move the robot.
    """

    def __init__(self, program: RapidHandshake, index: int | Leg) -> None:
        self._program, self._index = program, index
        self._lock = threading.Lock()
        self._cancelled = False
        self.begun = False
        self.failure: RobotError | None = None
        self.ended = threading.Event()
        threading.Thread(target=self._run, name="rws_move", daemon=True).start()

    def cancel(self) -> None:
        """End it; from then on `begun` does not change."""
        with self._lock:
            self._cancelled = True
        self._program.lane.cancel()

    def _begin(self) -> None:
        with self._lock:
            if self._cancelled:
                raise RwsError(RwsFailure.CANCELLED, "robot: the motion was given up")
            self.begun = True

    def _run(self) -> None:
        try:
            self._program.check_ready()
            if not self._program.demand(self._index, self._begin):
                self._await_taken()
            self._poll()
        except RobotError as error:
            self.failure = error
        except Exception as error:
            # Whatever it is: a robot that moves unwatched must be stopped.
            self.failure = RobotError(f"robot: {type(error).__name__}: {error}")
        finally:
            self.ended.set()

    def _await_taken(self) -> None:
        """Wait until the program takes the demand; withdraw it if another program runs."""
        program = self._program
        give_up = time.monotonic() + program.start_timeout_s
        while program.flag("cabols_go"):
            if time.monotonic() > give_up:
                if program.take_back():
                    self._not_begun()
                    raise RobotError(
                        "robot: RAPID runs, but not the program of cabols.mod: nobody took the "
                        "demand, which is withdrawn; stop the other program, then ask again"
                    )
                return
            program.lane.cancelled.wait(POLL_S)

    def _not_begun(self) -> None:
        with self._lock:
            self.begun = self.begun and self._cancelled

    def _poll(self) -> None:
        program, looks = self._program, 0
        while not program.flag("cabols_done"):
            # Errors and stops are rarer than ends: a controller has few requests to spare.
            if looks % 2 == 0:
                judge_motion(int(program.number("cabols_error")), done=False, running=True)
            elif looks % 4 == 1 and not program.running() and program.done():
                return
            looks += 1
            program.lane.cancelled.wait(POLL_S)
        judge_motion(int(program.number("cabols_error")), done=True, running=True)
