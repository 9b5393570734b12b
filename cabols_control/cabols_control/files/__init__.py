# SPDX-License-Identifier: Apache-2.0
"""Files that survive a crash, that never end, folders that are ours, YAML and plain numbers."""
