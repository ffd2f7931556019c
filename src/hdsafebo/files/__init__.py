"""Files of any kind: parquet and YAML that somebody hands in, read safely; one writer for whole files."""
