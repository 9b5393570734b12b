# SPDX-License-Identifier: Apache-2.0
"""What the recorder records: topics, bags, the parameters that ran."""
