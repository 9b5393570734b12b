# SPDX-License-Identifier: Apache-2.0
"""Physics of the simulated rig behind a simulated card."""
