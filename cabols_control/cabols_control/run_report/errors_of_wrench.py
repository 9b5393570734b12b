"""Error of the wrench against what the user commanded, and against the curve that was meant."""

from __future__ import annotations

import numpy as np

from cabols_control.checks import BoolArray, FloatArray
from cabols_control.run_report.run import BenchRun

IDLE = 1e-9
"""Command below which an axis counts as idle: it is commanded to zero [N, N m]."""
KINDS = (("force_n", slice(0, 3)), ("torque_nm", slice(3, 6)))


def error_numbers(run: BenchRun) -> dict[str, float]:
    """Reduce the errors of a run to numbers; NaN where no programme ran.

    Each is the length of the vector of force, or of torque: rms over the samples, 95th percentile
    and largest. `idle` are the axes that command and smoothed curve leave at zero at a sample,
    `asked` the others.

    Args:
        run: from load_run.
    """
    program = run.program
    ran = run.loading & np.isfinite(run.measured).all(axis=1)
    ran &= np.isfinite(program.command).all(axis=1) & np.isfinite(program.smoothed).all(axis=1)
    # In the frame in which it was asked for: the axes that the user commanded, and left at zero.
    measured, command, smoothed = (
        program.in_its_frame(wrench)[ran]
        for wrench in (run.measured, program.command, program.smoothed)
    )
    error, deviation = measured - command, measured - smoothed
    idle = (np.abs(command) < IDLE) & (np.abs(smoothed) < IDLE)
    found: dict[str, float] = {"preview_lead_s": program.lead}
    for kind, axes in KINDS:
        found |= _numbers("command", kind, _lengths(error[:, axes]))
        asked = ~idle[:, axes]
        found |= _numbers("asked", kind, _lengths_where(error[:, axes], asked))
        found |= _numbers("idle", kind, _lengths_where(error[:, axes], idle[:, axes]))
        found |= _numbers("smoothed", kind, _lengths(deviation[:, axes]))
        for axis, letter in enumerate("xyz"):
            found[f"command_error_rms_{letter}_{kind}"] = _rms(error[:, axes][:, axis])
    return found


def _lengths(error: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(error, axis=1))


def _lengths_where(error: FloatArray, chosen: BoolArray) -> FloatArray:
    """Lengths in the chosen axes alone, of the samples that have one."""
    return _lengths(np.where(chosen, error, 0.0)[chosen.any(axis=1)])


def _rms(error: FloatArray) -> float:
    return float(np.sqrt(np.mean(error**2))) if error.size else float("nan")


def _numbers(name: str, kind: str, error: FloatArray) -> dict[str, float]:
    if not error.size:
        return {f"{name}_error_{part}_{kind}": float("nan") for part in ("rms", "p95", "max")}
    size = np.abs(error)
    return {
        f"{name}_error_rms_{kind}": _rms(size),
        f"{name}_error_p95_{kind}": float(np.percentile(size, 95.0)),
        f"{name}_error_max_{kind}": float(size.max()),
    }
