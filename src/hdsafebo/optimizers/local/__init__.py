"""The local method, `hdsafebo_local`: one optimiser, and the search that suits the problem.

| what is searched | search | module |
|---|---|---|
| a finite candidate set | Thompson sampling over regions of rows | `rows` |
| a box with steps, choices, linear constraints or contexts | Thompson sampling over a pool | `pools` |
| a box of up to 100 inputs, the inputs themselves | constrained ascents of warped models | `constrained` |
| up to 100 features, in which alone initial trials differ | the same, of the features | `constrained` |
| codes of an embedding, or through features | ascents of an isotropic model | `ascents` |
| features that hide directions in which initial trials differ | ascents and random steps | `hidden` |

A box of more than 100 inputs is left to `ascents`, and so is any box from the first failed trial on, where
failures teach: warped models have no place for a failure. `optimizer` makes the search and asks it; `base`
says what every search provides. Single trials of `ascents` and `hidden` climb one top after another
(`restarts`). `caution`, `recombination` and `row_regions` are parts of the isotropic searches. `settings`
holds what can be set. A method with the same frame gives `base.SearchingOptimizer` a search of its own, as
the sessions' shortlist does.
"""
