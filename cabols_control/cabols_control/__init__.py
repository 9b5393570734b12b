# SPDX-License-Identifier: Apache-2.0
"""Control of cable-driven loading simulators."""
