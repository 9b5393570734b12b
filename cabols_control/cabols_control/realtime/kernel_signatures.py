# SPDX-License-Identifier: Apache-2.0
"""Count of compiled kernels and their kinds of arguments.

A kernel that gets a new kind of argument (a read-only array, say) is compiled at once, which takes
a tenth of a second and more. That would stall a control loop: every kernel of the loop must have
been called before it begins.
"""

from __future__ import annotations

import sys

from numba.core.dispatcher import Dispatcher


def specialisations(prefix: str = "cabols_") -> dict[str, int]:
    """Count the compiled signatures of every kernel in the loaded modules of that prefix."""
    kernels = [
        value
        for name, module in list(sys.modules.items())
        if name.startswith(prefix)
        for value in list(vars(module).values())
        if isinstance(value, Dispatcher)
    ]
    return {f"{k.py_func.__module__}.{k.py_func.__name__}": len(k.signatures) for k in kernels}


def compiled_since(before: dict[str, int], prefix: str = "cabols_") -> list[str]:
    """Return the names of the kernels that were compiled or loaded after that count, sorted.

    Args:
        before: signatures of each kernel, as counted earlier.
        prefix: modules whose kernels count.
    """
    now = specialisations(prefix)
    return sorted(name for name, count in now.items() if count > before.get(name, 0))
