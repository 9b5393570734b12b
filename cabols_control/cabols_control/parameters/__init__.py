# SPDX-License-Identifier: Apache-2.0
"""Parameters of nodes: what a node declares, and one YAML file for all of a graph."""
