# SPDX-License-Identifier: Apache-2.0
"""Tool: commissions limbs of a running rig, writes limbs.yaml, gains.yaml, a table and figures."""

from __future__ import annotations

import argparse
import sys
import time
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib.recfunctions import structured_to_unstructured
from rclpy.utilities import remove_ros_args

from cabols_control.command_line import (
    DONE,
    FAILED,
    INTERRUPTED,
    command,
    fail,
    interrupt_once,
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
from cabols_control.files.output_folder import MARKER, output_folder
from cabols_control.kinematics import structure_matrix
from cabols_control.naming import limb_index, limb_name, number
from cabols_control.rig import Rig, load_rig
from cabols_control.rig_folder import rig_file
from cabols_control.ros.limb_actions.commissioning import commission_limb
from cabols_control.ros.limb_actions.trace import LimbTrace
from cabols_control.ros.rig_client import RigClient

PHASES = ("", "pre-tightening", "slacken", "stand", "step", "coast", "brake", "back", "ramp")
WITH_BACKLASH = (
    "limbs.yaml tells the gears' play: with it the loop's own delay is smaller, so that "
    "control.yaml has `preview_delay: 0.0`: take both (docs/moving.md)"
)
LIMB_S = 180.0
"""Longest commissioning of one limb [s]."""


class Tool:
    """Commissions limbs through a client, with a trace of what they did."""

    def __init__(self, client: RigClient, rig: Rig, speed: float) -> None:
        """Use a client; nothing moves yet.

        Args:
            client: of the running rig; its owner closes it.
            rig: as configured.
            speed: rate of the rig's time; below 1 in simulated slow motion.
        """
        self._rig = rig
        self._client = client
        self._trace = LimbTrace(client.node, rig)
        self._trace.start()
        self._began = time.monotonic()
        self._limb_s = LIMB_S / speed
        self._phase = ""

    def close(self) -> None:
        """End the trace."""
        self._trace.stop()

    def say(self, text: str) -> None:
        """Print a line with the time since start."""
        print(f"  {time.monotonic() - self._began:5.1f} s  {text}", flush=True)

    def run(self, limb: int, **goal: Any) -> tuple[bool, LimbResult]:
        """Commission one limb.

        Args:
            limb: from 0.
            goal: other fields of CommissionLimb's goal.

        Returns:
            Whether it succeeded, and what was found.

        Raises:
            RigError: if the rig does not carry it out.
        """
        self._phase = ""
        self._trace.begin(limb)
        result = commission_limb(
            self._client, self._limb_s, self._wait, self._hear, limb=limb, **goal
        )
        found = LimbResult(
            limb,
            result.gain,
            result.time_constant,
            result.fit,
            result.stiffness,
            result.stiffness_fit,
            result.message,
            result.backlash,
        )
        return bool(result.success), found

    def _wait(self, reason: str) -> None:
        self._trace.restart()
        self.say(f"waiting: {reason}")

    def _hear(self, feedback: Any) -> None:
        phase = feedback.phase
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
    interrupt_once()
    results: dict[int, LimbResult] = {}
    try:
        with (
            RigClient(name="commission", speed=arguments.speed) as client,
            closing(Tool(client, rig, arguments.speed)) as tool,
        ):
            code = _commission(tool, rig, limbs, arguments, results)
    except KeyboardInterrupt:
        print(f"interrupted: {len(results)} of {len(limbs)} limbs done", file=sys.stderr)
        code = INTERRUPTED
    except CabolsError as error:
        code = fail(str(error), FAILED)
    if results:
        print(table(rig, results))
        if arguments.backlash:
            print(WITH_BACKLASH)
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
    control = rig_file("control.yaml", arguments.control_file, arguments.rig)
    control_text = control.read_text(encoding="utf-8")
    for limb in limbs:
        tool.say(f"{limb_name(limb)} of {rig.geometry.cables}")
        done, result = tool.run(
            limb,
            step=not arguments.no_step,
            ramp=not arguments.no_ramp,
            step_current=arguments.step_current,
            ramp_tension=arguments.ramp_tension,
        )
        tool.say(f"{limb_name(limb)}: {result.message}")
        if not done:
            return fail(f"{limb_name(limb)}: {result.message}", FAILED)
        results[limb] = result
        # After each limb, so that an interruption keeps the results so far.
        write_results(arguments.output, rig, results, arguments.backlash, control_text)
        tool.draw(result, arguments.output)
        save(draw_overview(rig, results), arguments.output / "overview.png")
    return DONE


if __name__ == "__main__":
    sys.exit(main())
