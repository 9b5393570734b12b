# SPDX-License-Identifier: Apache-2.0
"""The laser tracker: its service (tracker.proto), our client, its noise and configuration."""
