# SPDX-License-Identifier: Apache-2.0
"""From a desired and a measured wrench to the limbs' tensions."""
