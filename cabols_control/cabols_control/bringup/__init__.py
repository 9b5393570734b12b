# SPDX-License-Identifier: Apache-2.0
"""The nodes of a graph, and how they are started and ended."""
