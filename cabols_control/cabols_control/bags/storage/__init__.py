# SPDX-License-Identifier: Apache-2.0
"""Files of a bag as they lie on disk: MCAP, whole or damaged, and sqlite3."""
