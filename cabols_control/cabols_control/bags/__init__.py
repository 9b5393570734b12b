# SPDX-License-Identifier: Apache-2.0
"""Rosbags on disk: writing, recovering, reading."""
