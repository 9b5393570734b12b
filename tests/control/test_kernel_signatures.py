# SPDX-License-Identifier: Apache-2.0
"""The count of compiled kernels that tells a node what its warm-up forgot."""

import numpy as np
from numba import njit
from numba.core.dispatcher import Dispatcher

from cabols_control.cable_kernels import cable_lengths_into
from cabols_control.realtime.kernel_signatures import compiled_since, specialisations


@njit
def doubled(values):
    return 2.0 * values


def test_a_new_kind_of_argument_is_reported():
    doubled(np.ones(2))
    before = specialisations(__name__)
    doubled(np.zeros(3))
    assert compiled_since(before, __name__) == []
    read_only = np.frombuffer(np.ones(2).tobytes())
    assert doubled(read_only).tolist() == [2.0, 2.0]
    assert compiled_since(before, __name__) == [f"{__name__}.doubled"]


def test_kernels_of_the_packages_are_seen():
    found = specialisations()
    assert isinstance(cable_lengths_into, Dispatcher)
    assert "cabols_control.cable_kernels.cable_lengths_into" in found
    assert compiled_since(found) == []
    assert compiled_since({}) == sorted(name for name, count in found.items() if count > 0)
