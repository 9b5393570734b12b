# SPDX-License-Identifier: Apache-2.0
"""The command `workspace`: maps, designs, files and figures."""
