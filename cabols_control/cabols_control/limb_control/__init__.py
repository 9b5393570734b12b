# SPDX-License-Identifier: Apache-2.0
"""From a desired tension to a motor current, limb by limb."""
