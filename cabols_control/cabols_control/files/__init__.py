# SPDX-License-Identifier: Apache-2.0
"""Files that survive a crash, folders that are ours, YAML and numbers that mean what they say."""
