# SPDX-License-Identifier: Apache-2.0
"""Actions on one limb: commissioning, and what is recorded meanwhile."""
