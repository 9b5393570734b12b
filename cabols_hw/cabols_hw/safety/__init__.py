# SPDX-License-Identifier: Apache-2.0
"""The safety envelope, and the guard that acts on it."""
