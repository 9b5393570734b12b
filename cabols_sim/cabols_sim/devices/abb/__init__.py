# SPDX-License-Identifier: Apache-2.0
"""The simulated ABB controller: RAPID program, EGM and Robot Web Services."""
