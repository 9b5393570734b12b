# SPDX-License-Identifier: Apache-2.0
"""The operator's console: access, command, views and the page; without ROS."""
