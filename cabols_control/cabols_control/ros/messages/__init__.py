# SPDX-License-Identifier: Apache-2.0
"""Messages of the graph: their bytes, topics, quality of service and transport."""
