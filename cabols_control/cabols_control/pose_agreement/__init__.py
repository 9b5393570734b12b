# SPDX-License-Identifier: Apache-2.0
"""Sources of the platform's pose against each other: which of them disagrees."""

from .estimator import Estimate, Measured, PoseEstimator, State, rig_noise
from .hypotheses import Fault, Suspect
from .moments import LimbSample
from .monitor import Agreement, AgreementMonitor
from .noise import AgreementNoise
from .tracker import TrackerNoise

__all__ = [
    "Agreement",
    "AgreementMonitor",
    "AgreementNoise",
    "Estimate",
    "Fault",
    "LimbSample",
    "Measured",
    "PoseEstimator",
    "State",
    "Suspect",
    "TrackerNoise",
    "rig_noise",
]
