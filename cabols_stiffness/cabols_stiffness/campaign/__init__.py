"""The automatic test of figure 4.5: what is asked, in which order, what was measured."""
