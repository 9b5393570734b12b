# SPDX-License-Identifier: Apache-2.0
"""The automatic test of figure 4.5: plan, flow, requests, journal."""
