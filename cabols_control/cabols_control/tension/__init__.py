"""Redundancy resolution: cable tensions for a wrench.

`distribute` for one call, `TensionResolver` for many wrenches at one pose, `RigTensionResolver`
for new poses. Compiled loops use `pack_pose` once per pose and `solve_packed` per wrench.
"""

from .distribution import DEFAULT_WEIGHTS, METHODS, distribute
from .kernels.basis import pack_pose
from .kernels.dispatch import detect_packed, solve_batch, solve_packed, solve_pose_batch
from .kernels.work_array import pack_size
from .methods import CHOICES, check_method, choose_packed, set_method
from .resolver import RigTensionResolver, TensionResolver
from .solution import FEASIBLE, INFEASIBLE, INVALID, TensionSolution

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
    "choose_packed",
    "detect_packed",
    "distribute",
    "pack_pose",
    "pack_size",
    "set_method",
    "solve_batch",
    "solve_packed",
    "solve_pose_batch",
]
