# SPDX-License-Identifier: Apache-2.0
"""Elastic model of a robot, with prediction, compensation and compliance."""
