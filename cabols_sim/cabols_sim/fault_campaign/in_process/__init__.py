# SPDX-License-Identifier: Apache-2.0
"""The generated fault campaign in one process: states of the rig, each broken in every way."""
