# SPDX-License-Identifier: Apache-2.0
"""Slow second opinions: enumeration of active sets, and DAQP."""
