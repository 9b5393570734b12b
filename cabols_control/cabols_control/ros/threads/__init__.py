# SPDX-License-Identifier: Apache-2.0
"""Threads of a node beside its executor, and work handed to it."""
