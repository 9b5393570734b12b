# SPDX-License-Identifier: Apache-2.0
"""A bridge whose platform hangs on its cables: where it is, what it may do, what ends it."""
