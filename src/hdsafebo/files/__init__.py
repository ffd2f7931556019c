"""Files of any kind: parquet and YAML handed in by somebody, read safely; one writer that replaces a file."""
