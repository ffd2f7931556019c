"""The paper's claims, each with a stated rule and a verdict computed from the result files."""
