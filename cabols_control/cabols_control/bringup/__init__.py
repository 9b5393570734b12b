"""Which nodes a graph has, and how they are started and ended."""
