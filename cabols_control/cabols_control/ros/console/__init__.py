"""The console's calls to the graph, and what it reads of it."""
