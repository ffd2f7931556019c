"""What the page is made of, read from files: results, inputs of the pipeline, numbers of the paper."""
