"""The local method, `hdsafebo_local`: one optimiser, and the search that suits the problem.

| what is searched | search | module |
|---|---|---|
| a finite candidate set | Thompson sampling over regions of rows | `rows` |
| a continuous space | ascents of an isotropic model | `ascents` |
| a box with steps, choices, linear constraints or contexts | Thompson sampling over a pool | `pools` |
| a continuous space of which features hide directions | ascents and random steps | `hidden` |

`optimizer` makes the search once and asks it; `base` says what every search provides. Single trials in a
continuous space climb one top after another (`restarts`). `caution`, `recombination` and `row_regions` are
parts of these searches; `settings` holds what can be set. A method with the same frame gives
`base.SearchingOptimizer` a search of its own, as the sessions' shortlist does.
"""
