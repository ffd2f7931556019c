"""Constrained ascents of warped models: `search` is the round, a page to read first.

`chart` says in which coordinates, `batch` is what its trials share, `ascent` one climb within the safe set,
`expectations` the record of errors by which the models are trusted.
"""
