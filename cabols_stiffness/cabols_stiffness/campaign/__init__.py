"""The automatic test of figure 4.5: plan, flow, requests, journal."""
