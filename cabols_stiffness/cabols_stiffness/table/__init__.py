# SPDX-License-Identifier: Apache-2.0
"""A laboratory's own table of loads and deflections, without a rig and without ROS."""
