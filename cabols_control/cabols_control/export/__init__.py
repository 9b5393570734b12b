"""Bags as tables for other programs: csv, parquet, mat, hdf5."""
