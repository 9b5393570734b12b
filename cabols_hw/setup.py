# SPDX-License-Identifier: Apache-2.0
"""Everything is declared in setup.cfg; colcon needs this file to exist."""

from setuptools import setup

setup()
