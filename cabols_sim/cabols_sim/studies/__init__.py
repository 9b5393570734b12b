# SPDX-License-Identifier: Apache-2.0
"""Studies by computation: dynamics, vibration, gains."""
