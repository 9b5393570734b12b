# SPDX-License-Identifier: Apache-2.0
"""The console's calls to the graph, and what it reads of it."""
