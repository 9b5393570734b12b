# SPDX-License-Identifier: Apache-2.0
"""A node's own state: diagnostics, durations, log lines."""
