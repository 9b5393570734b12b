# SPDX-License-Identifier: Apache-2.0
"""Commands that run the simulated rig through the real nodes."""
