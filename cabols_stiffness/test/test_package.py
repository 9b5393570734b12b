# SPDX-License-Identifier: Apache-2.0
"""Run this package's tests, of the repository's tests/ folder, with `colcon test`."""

from package_tests import test_package  # noqa: F401
