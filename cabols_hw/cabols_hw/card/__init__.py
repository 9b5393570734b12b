# SPDX-License-Identifier: Apache-2.0
"""The data acquisition card: configuration, wiring, back ends."""
