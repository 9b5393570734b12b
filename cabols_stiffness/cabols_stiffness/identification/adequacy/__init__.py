# SPDX-License-Identifier: Apache-2.0
"""Judgement of a fit: does the model explain the data, and what is wrong if it does not."""
