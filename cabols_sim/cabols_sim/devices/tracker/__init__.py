# SPDX-License-Identifier: Apache-2.0
"""The simulated laser tracker: its physics, and a server that speaks tracker.proto."""
