# SPDX-License-Identifier: Apache-2.0
"""Workspace of a cable robot: poses with the required wrenches and without interference."""
