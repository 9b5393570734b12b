"""The nodes of a graph, and how they are started and ended."""
