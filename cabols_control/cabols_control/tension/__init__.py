# SPDX-License-Identifier: Apache-2.0
"""Redundancy resolution: cable tensions for a wrench.

`distribute` for one call, `TensionResolver` for many wrenches at one pose, `RigTensionResolver`
for new poses. Compiled loops use `prepare_pose` once per pose and `solve_prepared` per wrench.
"""

from .arguments import DEFAULT_WEIGHTS
from .distribution import METHODS, distribute
from .kernels.basis import prepare_pose
from .kernels.dispatch import detect_prepared, solve_batch, solve_pose_batch, solve_prepared
from .kernels.work_array import FEASIBLE, INFEASIBLE, INVALID, work_size
from .methods import CHOICES, check_method, choose_prepared, set_method
from .resolver import RigTensionResolver, TensionResolver
from .solution import TensionSolution

__all__ = [
    "CHOICES",
    "DEFAULT_WEIGHTS",
    "FEASIBLE",
    "INFEASIBLE",
    "INVALID",
    "METHODS",
    "RigTensionResolver",
    "TensionResolver",
    "TensionSolution",
    "check_method",
    "choose_prepared",
    "detect_prepared",
    "distribute",
    "prepare_pose",
    "set_method",
    "solve_batch",
    "solve_pose_batch",
    "solve_prepared",
    "work_size",
]
