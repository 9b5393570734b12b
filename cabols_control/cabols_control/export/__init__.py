# SPDX-License-Identifier: Apache-2.0
"""Bags as tables for other programs: csv, parquet, mat, hdf5."""
