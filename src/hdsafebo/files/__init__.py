"""Files of any kind: parquet and YAML, read safely; one writer that replaces a file whole."""
