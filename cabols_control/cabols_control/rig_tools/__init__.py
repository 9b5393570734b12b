# SPDX-License-Identifier: Apache-2.0
"""Makes, migrates and describes the folders of rigs."""
