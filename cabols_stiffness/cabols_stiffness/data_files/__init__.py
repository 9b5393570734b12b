# SPDX-License-Identifier: Apache-2.0
"""Tables as text: cells of CSV and Parquet files, words of units."""
