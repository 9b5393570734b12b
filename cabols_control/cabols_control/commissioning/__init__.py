# SPDX-License-Identifier: Apache-2.0
"""Test signals for limbs, and the models, gains and figures that result from them."""
