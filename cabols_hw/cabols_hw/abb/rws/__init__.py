# SPDX-License-Identifier: Apache-2.0
"""Robot Web Services: motions, stops, and the HTTP under them."""
