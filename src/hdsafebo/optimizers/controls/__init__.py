"""Controls without a model: what does not beat them has learnt nothing."""
