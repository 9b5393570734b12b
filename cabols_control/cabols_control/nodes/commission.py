"""Tool: commissions limbs of a running rig, writes limbs.yaml, gains.yaml, a table and figures."""

from __future__ import annotations

import argparse
import signal
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from cabols_msgs.action import CommissionLimb
from numpy.lib.recfunctions import structured_to_unstructured
from rclpy.action import ActionClient
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from cabols_control.command_line import (
    DONE,
    FAILED,
    INTERRUPTED,
    command,
    fail,
)
from cabols_control.commissioning.command import commission_parser
from cabols_control.commissioning.figures import draw_limb, draw_overview, modelled_step, save
from cabols_control.commissioning.results import (
    LimbResult,
    cable_tension_by_wrench,
    evaluate_step,
    table,
    write_results,
)
from cabols_control.errors import CabolsError, UsageError
from cabols_control.kinematics import structure_matrix
from cabols_control.naming import limb_index, limb_name, number
from cabols_control.output_folder import MARKER, output_folder
from cabols_control.result_code import NOT_YET, ResultCode
from cabols_control.rig import Rig, load_rig
from cabols_control.ros import transport
from cabols_control.ros.limb_trace import LimbTrace
from cabols_control.ros.threads.node_executor import NodeExecutor
from cabols_control.topics import NAMESPACE

PHASES = ("", "pre-tightening", "slacken", "stand", "step", "coast", "brake", "back", "ramp")
FOUND_S = 180.0
"""Longest wait for the action; a first start compiles for a minute or two [s]."""
LIMB_S = 180.0
"""Longest commissioning of one limb [s]."""
START_S = 60.0
"""Time for which a refusal is tried again [s]: nodes that compile at first start are silent."""
AT_ONCE_S = 2.0
"""Longest time to a refusal that comes before any motion [s]."""


class Tool:
    """Client of commission_limb with a trace of what it did."""

    def __init__(self, rig: Rig, speed: float) -> None:
        """Make a node; nothing moves yet.

        Args:
            rig: as configured.
            speed: rate of the rig's time; below 1 in simulated slow motion.
        """
        self._rig = rig
        self._node = rclpy.create_node("commission", namespace=NAMESPACE)
        self._client = ActionClient(self._node, CommissionLimb, "commission_limb")
        self._executor = NodeExecutor()
        self._executor.add_node(self._node)
        self._trace = LimbTrace(self._node, rig)
        self._trace.start()
        self._began = time.monotonic()
        self._limb_s = LIMB_S / speed
        self._phase = ""

    def close(self) -> None:
        """End."""
        self._trace.stop()
        self._executor.remove_node(self._node)
        self._client.destroy()
        self._node.destroy_node()

    def say(self, text: str) -> None:
        """Print a line with the time since start."""
        print(f"  {time.monotonic() - self._began:5.1f} s  {text}", flush=True)

    def find(self) -> bool:
        """Wait for the action; return whether it is available."""
        while not self._client.server_is_ready():
            if time.monotonic() - self._began > FOUND_S:
                return False
            self._executor.spin_once(timeout_sec=0.2)
        return True

    def run(self, goal: CommissionLimb.Goal) -> tuple[bool, LimbResult]:
        """Commission one limb; a refusal before any motion is tried again for a while."""
        give_up = time.monotonic() + START_S
        told = ""
        while True:
            sent = time.monotonic()
            result = self._run_once(goal)
            now = time.monotonic()
            refused = result.code in (*NOT_YET, ResultCode.FAULT_REPORTED)
            if not refused or now - sent > AT_ONCE_S or now > give_up:
                break
            if result.message != told:
                told = result.message
                self.say(f"waiting: {told}")
            self._wait(0.5)
        found = LimbResult(
            goal.limb,
            result.gain,
            result.time_constant,
            result.fit,
            result.stiffness,
            result.stiffness_fit,
            result.message,
        )
        return bool(result.success), found

    def _wait(self, seconds: float) -> None:
        until = time.monotonic() + seconds
        while (left := until - time.monotonic()) > 0.0:
            self._executor.spin_once(timeout_sec=left)

    def _run_once(self, goal: CommissionLimb.Goal) -> Any:
        self._phase = ""
        self._trace.begin(goal.limb)
        handle = self._result(self._client.send_goal_async(goal, self._hear), 10.0)
        future = handle.get_result_async()
        try:
            return self._result(future, self._limb_s).result
        except (KeyboardInterrupt, TimeoutError):
            self.say("cancelling")
            handle.cancel_goal_async()
            until = time.monotonic() + 2.0
            while not future.done() and time.monotonic() < until:
                self._executor.spin_once(timeout_sec=0.1)
            raise

    def _result(self, future: Any, seconds: float) -> Any:
        until = time.monotonic() + seconds
        while not future.done():
            if time.monotonic() > until:
                raise TimeoutError(f"commission_limb: no answer within {seconds:g} s")
            self._executor.spin_once(timeout_sec=0.2)
        return future.result()

    def _hear(self, message: Any) -> None:
        phase = message.feedback.phase
        if phase != self._phase and phase in PHASES:
            self._phase = phase
            self._trace.phase = PHASES.index(phase)
            self.say(phase)

    def draw(self, result: LimbResult, folder: Path) -> None:
        """Draw a limb's step and ramp from the trace."""
        rows = self._trace.rows()
        step = _step_of(rows) if np.isfinite(result.gain) else None
        ramp = _ramp_of(rows, self._rig, result.limb) if np.isfinite(result.stiffness) else None
        save(draw_limb(result, step, ramp), folder / f"limb_{number(result.limb)}.png")


def _step_of(rows: np.ndarray) -> dict[str, np.ndarray] | None:
    """Trace from just before the step's current to the end of the coasting."""
    moving = np.isin(rows["phase"], [PHASES.index(name) for name in ("step", "coast", "brake")])
    if moving.sum() < 100:
        return None
    first, last = np.flatnonzero(moving)[[0, -1]]
    part = rows[max(first - 200, 0) : last + 1]
    # A row's current was on the motor until then; the model needs the current from then on.
    record = {
        "time": part["time"][:-1] - part["time"][0],
        "current": part["current"][1:],
        "wound_length": part["wound_length"][:-1],
    }
    found = evaluate_step(record)
    record["modelled"] = modelled_step(*record.values(), found.model, found.friction)
    return record


def _ramp_of(rows: np.ndarray, rig: Rig, limb: int) -> dict[str, np.ndarray] | None:
    part = rows[rows["phase"] == PHASES.index("ramp")]
    part = part[np.isfinite(structured_to_unstructured(part)).all(axis=1)]
    if part.shape[0] < 100:
        return None
    geometry = rig.geometry
    turn = geometry.reference_rotation
    wrench = np.hstack([part["wrench"][:, :3] @ turn.T, part["wrench"][:, 3:] @ turn.T])
    matrix = structure_matrix(geometry, geometry.reference_position, turn)
    change = wrench - wrench[:100].mean(axis=0)
    tension = cable_tension_by_wrench(matrix, limb, change, rig.control.rated)
    return {"elongation": part["elongation"], "tension": part["tension"][:100].mean() + tension}


def _arguments() -> argparse.Namespace:
    parser = commission_parser()
    arguments = parser.parse_args(remove_ros_args(sys.argv)[1:])
    if not 0.01 <= arguments.speed <= 1.0:
        parser.error(f"--speed: expected 0.01 to 1, got {arguments.speed:g}")
    if arguments.no_step and arguments.no_ramp:
        parser.error("--no-step and --no-ramp leave nothing to do")
    return arguments


def _interrupt(*_: object) -> None:
    raise KeyboardInterrupt


@command
def main() -> int:
    """Commission; returns 0, 1 after a failure, 2 for bad arguments, 130 after Ctrl-C."""
    arguments = _arguments()
    files = (arguments.geometry_file, arguments.limbs_file, arguments.control_file)
    rig = load_rig(arguments.rig, *files)
    cables = rig.geometry.cables
    try:
        limbs = [limb_index(typed, cables) for typed in arguments.limb or ()]
    except CabolsError as error:
        raise UsageError(f"--{error}") from error
    limbs = limbs or list(range(cables))
    # The tool may run inside commission_bench, which has claimed the folder.
    with output_folder(arguments.output, "commission", keep=True, shared=True) as folder:
        code = _run(arguments, rig, limbs)
        if code == DONE:
            folder.finish()
    return code


def _run(arguments: argparse.Namespace, rig: Rig, limbs: list[int]) -> int:
    """Join the graph, commission the limbs, print what was found."""
    for which in (signal.SIGINT, signal.SIGTERM):
        signal.signal(which, _interrupt)
    transport.init(args=sys.argv, signal_handler_options=SignalHandlerOptions.NO)
    tool = Tool(rig, arguments.speed)
    results: dict[int, LimbResult] = {}
    try:
        code = _commission(tool, rig, limbs, arguments, results)
    except KeyboardInterrupt:
        print(f"interrupted: {len(results)} of {len(limbs)} limbs done", file=sys.stderr)
        code = INTERRUPTED
    except (CabolsError, TimeoutError) as error:
        code = fail(str(error), FAILED)
    finally:
        tool.close()
        rclpy.try_shutdown()
    if results:
        print(table(rig, results))
        for path in sorted(arguments.output.iterdir()):
            if path.name != MARKER:
                print(f"  {path}")
    return code


def _commission(
    tool: Tool,
    rig: Rig,
    limbs: list[int],
    arguments: argparse.Namespace,
    results: dict[int, LimbResult],
) -> int:
    if not tool.find():
        return fail("no action commission_limb: is the rig running?", FAILED)
    for limb in limbs:
        tool.say(f"{limb_name(limb)} of {rig.geometry.cables}")
        goal = CommissionLimb.Goal(
            limb=limb,
            step=not arguments.no_step,
            ramp=not arguments.no_ramp,
            step_current=arguments.step_current,
            ramp_tension=arguments.ramp_tension,
        )
        done, result = tool.run(goal)
        tool.say(f"{limb_name(limb)}: {result.message}")
        if not done:
            return fail(f"{limb_name(limb)}: {result.message}", FAILED)
        results[limb] = result
        # After each limb, so that an interruption keeps the results so far.
        write_results(arguments.output, rig, results)
        tool.draw(result, arguments.output)
        save(draw_overview(rig, results), arguments.output / "overview.png")
    return DONE


if __name__ == "__main__":
    sys.exit(main())
