"""The methods: ask for trials, tell their results. `registry` finds them by name.

`hdsafebo.py` is Algorithm 1 of the paper; `local/` is this project's own method; `baselines/` has a file per
paper that both are compared with; `controls/` has methods without a model. `base` is what all share, and
`core/` is the machinery behind ask and tell.
"""
