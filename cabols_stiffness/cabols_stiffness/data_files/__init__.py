"""Tables as text: cells of CSV and Parquet files, words of units."""
