# SPDX-License-Identifier: Apache-2.0
"""Error of the wrench against what the user commanded, and against the curve that was meant."""

from __future__ import annotations

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.run_report.judgement.vector_errors import (
    IDLE,
    KINDS,
    lengths,
    lengths_where,
    rms,
    sizes,
)
from cabols_control.run_report.run import BenchRun


def error_numbers(run: BenchRun) -> dict[str, float]:
    """Reduce the errors of a run to numbers; NaN where no programme ran.

    Each is the length of the vector of force, or of torque: rms over the samples, 95th percentile
    and largest; `uncertainty` is that of the worst axis of each sample. `idle` are the axes that
    command and smoothed curve leave at zero at a sample, `asked` the others.

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
        found |= _numbers("command", kind, lengths(error[:, axes]))
        asked = ~idle[:, axes]
        found |= _numbers("asked", kind, lengths_where(error[:, axes], asked))
        found |= _numbers("idle", kind, lengths_where(error[:, axes], idle[:, axes]))
        found |= _numbers("smoothed", kind, lengths(deviation[:, axes]))
        known = run.uncertainty[ran][:, axes]
        known = known[np.isfinite(known).all(axis=1)]
        # One number beside the errors' lengths: the worst axis of each sample.
        worst = sizes(known.max(axis=1, initial=0.0))
        found |= {
            f"uncertainty_p95_{kind}": worst.p95,
            f"uncertainty_max_{kind}": worst.largest,
        }
        for axis, letter in enumerate("xyz"):
            found[f"command_error_rms_{letter}_{kind}"] = rms(error[:, axes][:, axis])
    return found


def _numbers(name: str, kind: str, error: FloatArray) -> dict[str, float]:
    found = sizes(error)
    return {
        f"{name}_error_rms_{kind}": found.rms,
        f"{name}_error_p95_{kind}": found.p95,
        f"{name}_error_max_{kind}": found.largest,
    }
