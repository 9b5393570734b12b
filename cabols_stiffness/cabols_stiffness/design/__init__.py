# SPDX-License-Identifier: Apache-2.0
"""Design of experiments: configurations and tensions for the smallest parameter covariance."""

from cabols_stiffness.design.candidates import (
    Candidates,
    candidate_configurations,
    candidate_loads,
)
from cabols_stiffness.design.information import Information, Setup
from cabols_stiffness.design.search import Design, choose
from cabols_stiffness.design.tensions import optimal_tensions, tensions_of

__all__ = [
    "Candidates",
    "Design",
    "Information",
    "Setup",
    "candidate_configurations",
    "candidate_loads",
    "choose",
    "optimal_tensions",
    "tensions_of",
]
