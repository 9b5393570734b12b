"""Command line of the workspace: workers, files, figures. The maths is in `workspace`."""
