# SPDX-License-Identifier: Apache-2.0
"""Robot files of other programs: read into this project's robot file, and written from it."""
