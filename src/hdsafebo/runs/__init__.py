"""The format of run files, `data/runs/<task>-<method>.parquet`: written, read, and turned into curves."""
