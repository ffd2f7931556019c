"""One's own system: described with names and units, asked and told in tables, stored in a folder.

What may live here: the description (parameters, contexts, constraints, outcomes), the map between the user's
values and the box that optimisers see, tables in and out, the stored study, and readers of other libraries'
descriptions. Nothing here knows how a method chooses.

    parameters, constraints, outcomes   the parts of a description
    description                         `System`, to and from YAML and JSON
    codec, candidates, problem          how an optimiser sees it
    tables, reading                     by name, never by position; from tables to the box
    study, storage, beliefs             ask, tell, observe, predict, best; one folder per study
    interop                             Xopt's VOCS, Ax's search space
"""
