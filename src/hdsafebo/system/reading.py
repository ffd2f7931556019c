"""Between the tables of a study's user and the box [0, 1]^D that the optimiser sees.

What the user passes is checked here by name; the step itself (who may take it, and when it is on the disk) is
`study.py`'s.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hdsafebo.system import beliefs
from hdsafebo.system.beliefs import SAFE_PROBABILITY
from hdsafebo.system.codec import BoxCodec
from hdsafebo.system.description import System
from hdsafebo.system.errors import TableError
from hdsafebo.system.problem import SystemProblem
from hdsafebo.system.tables import NOISE, STATUS, TRIAL, by_name, columns_of, require, result_names
from hdsafebo.system.values import finite
from hdsafebo.trials import Status, Trials
from hdsafebo.typing import BoolArray, FloatArray

if TYPE_CHECKING:
    import pandas as pd

    from hdsafebo.system.tables import Table

_STATES = {Status.PENDING: "pending", Status.COMPLETED: "completed", Status.FAILED: "failed"}
MARKED = "marked_unsafe"
_SAME = 1e-9
"""Largest difference, in the box, between an input that was asked and the same input read from a table."""


@dataclass(frozen=True)
class Suggestion:
    """A trial to run.

    Attributes:
        trial: its id, to tell its results under.
        setting: values of the parameters, ready to be passed on as they are.
        context: values of the contexts it was asked for.
        safe_probability: that every limit is kept, as believed of exactly this setting; NaN while nothing is
            known. Methods without a model are told nothing of it: it is the common model's, shown here and
            not kept.
        marked_unsafe: nothing was believed safe, and `empty_safe_set="mark"` asked for it all the same.
    """

    trial: int
    setting: dict[str, Any]
    context: dict[str, Any]
    safe_probability: float
    marked_unsafe: bool


def context_columns(codec: BoxCodec, context: Mapping[str, Any] | None) -> FloatArray:
    """(c,) columns of the box that hold the contexts.

    Raises:
        TableError: a context is missing, unknown or out of range.
    """
    columns = one_of_each(context, "the context")
    contexts = codec.system.contexts
    require(columns, [c.name for c in contexts], [], "the context")
    if not contexts:
        return np.empty(0)
    return codec.encode(codec.check(columns, contexts), contexts)[0]


def one_of_each(values: Any, what: str) -> dict[str, list[Any]]:
    """Columns of one value each, by name; none for None.

    Raises:
        TableError: they have no names, or one name has no value or several.
    """
    try:
        # Pairs and a Series may hold a name twice, of which `dict` would keep the last.
        pairs = [] if values is None else [(n, v) for n, v in getattr(values, "items", lambda: values)()]
    except (TypeError, ValueError):
        raise TableError(f"{what} is {type(values).__name__}; expected values by name") from None
    columns = columns_of(by_name(pairs, what), what)
    for name, column in columns.items():
        if len(column) != 1:
            raise TableError(f"{what} has {len(column)} values of {name!r}; expected one")
    return columns


def with_context(
    system: System, columns: Mapping[str, list[Any]], context: Mapping[str, Any] | None, n: int
) -> dict[str, list[Any]]:
    """Columns of a table of n settings, with the contexts that are given for all of them.

    Raises:
        TableError: something else than a context is given, or one that the table has as well: of two values
            nobody knows which was meant.
    """
    given = one_of_each(context, "the context")
    require(given, [], [c.name for c in system.contexts], "the context")
    twice = [name for name in given if name in columns]
    if twice:
        raise TableError(f"{twice[0]!r} is in the table and in the context; expected it in one of them")
    return {**columns, **{name: column * n for name, column in given.items()}}


def encoded(codec: BoxCodec, columns: Mapping[str, Sequence[Any]], n: int) -> FloatArray:
    """(n, D) points of the box; parameters of one value may be left out.

    Raises:
        TableError: a value is out of range.
    """
    fixed = {p.name: [p.python(0)] * n for p in codec.system.parameters if p.width == 0}
    return codec.encode(codec.check(fixed | dict(columns), codec.parts))


def inputs_run(
    codec: BoxCodec, x: FloatArray, ids: Sequence[int], instead: Mapping[str, Any]
) -> FloatArray | None:
    """(n, D) inputs that were really run; None when they are those that were asked.

    Args:
        codec: between the user's values and the box.
        x: (N, D) inputs of all trials so far, by id.
        ids: of the n trials that are told.
        instead: values, or columns of values, of the inputs that the user gives.
    """
    if not instead or any(not 0 <= i < len(x) for i in ids):  # tell refuses unknown trials
        return None
    asked = x[list(ids)]
    given = {name: v if isinstance(v, list) else [v] for name, v in instead.items()}
    run = encoded(codec, codec.table(asked) | given, len(ids))
    # A table that gives back what was asked must not move the input by a rounding error.
    return np.where(np.abs(run - asked) <= _SAME, asked, run)


def results_of_one(
    system: System, results: Table | None, failed: bool, noise: Mapping[str, float] | None
) -> dict[str, list[Any]]:
    """Columns of results of a single trial, with its noise and status.

    Raises:
        TableError: a result is missing or unknown, or the results are of several trials.
    """
    if not isinstance(failed, bool | np.bool_):  # "no" would be true
        raise TableError(f"failed is {failed!r}; expected True or False")
    if failed:
        if results:
            raise TableError("a failed trial has no results; leave them out, or tell it as completed")
        return {STATUS: ["failed"]}
    if results is None:
        raise TableError(f"results are missing; expected {', '.join(system.outcomes)}, or failed=True")
    columns = columns_of(results, "results")
    for name, value in mapping(noise, "noise").items():
        if name + NOISE in columns:
            raise TableError(f"the noise of {name!r} is in the results and in `noise`; expected it once")
        columns[name + NOISE] = [value]
    require(columns, system.outcomes, result_names(system), "results")
    if len(columns[system.outcomes[0]]) != 1:
        raise TableError("results have several rows for one trial; tell a table with the column 'trial'")
    return columns


def results_of_many(system: System, table: Table) -> tuple[list[int], dict[str, list[Any]]]:
    """Ids of trials, and the columns of results and inputs that a table has for them.

    Raises:
        TableError: a column is missing or unknown, or an id is no whole number.
    """
    columns = columns_of(table, "the table")
    index: Any = getattr(table, "index", None)
    if TRIAL not in columns and getattr(index, "name", None) == TRIAL:
        columns[TRIAL] = list(index)
    outcomes = [] if STATUS in columns else list(system.outcomes)
    shown = [*system.inputs, SAFE_PROBABILITY, MARKED]
    require(columns, [TRIAL, *outcomes], [*result_names(system), *shown], "the table")
    ids = [_id_of(value, i) for i, value in enumerate(columns.pop(TRIAL))]
    return ids, {n: v for n, v in columns.items() if n not in (SAFE_PROBABILITY, MARKED)}


def _id_of(value: Any, row: int) -> int:
    """The number of a trial; a column of whole numbers may be one of floats in pandas."""
    number = finite(value, f"row {row}: trial", TableError)
    if number != int(number):
        raise TableError(f"row {row}: trial is {value!r}; expected the number of a trial")
    return int(value)


def check_asked(codec: BoxCodec, trials: Trials, suggestion: Suggestion) -> None:
    """Refuse a suggestion that is not what was asked under its number: of another study, or changed since.

    Raises:
        TableError: names what differs. Of a trial that was told before, the results say it.
    """
    number = suggestion.trial
    if not 0 <= number < len(trials) or trials.status[number] != Status.PENDING:
        return  # tell refuses unknown trials
    asked = codec.records(trials.x[[number]])[0]
    for name, value in {**suggestion.setting, **suggestion.context}.items():
        if name not in asked or asked[name] != value:
            raise TableError(
                f"the suggestion has {name} = {value!r}, but trial {number} of this study was asked with "
                f"{asked}; tell what was really run as ran={{...}}"
            )


def mapping(values: Any, what: str) -> dict[str, Any]:
    """Values by name; nothing for None.

    Raises:
        TableError: they have no names.
    """
    if values is None:
        return {}
    if not isinstance(values, Mapping):
        raise TableError(f"{what} is {type(values).__name__}; expected values by name")
    return dict(values)


def suggested(codec: BoxCodec, trials: Trials) -> pd.DataFrame:
    """Trials to run as a table indexed by trial: inputs, `safe_probability` and `marked_unsafe`."""
    import pandas as pd

    table = pd.DataFrame(codec.table(trials.x), index=pd.Index(trials.id, name=TRIAL))
    table[SAFE_PROBABILITY] = trials.predicted_safe_probability
    table[MARKED] = trials.marked_unsafe
    return table


def history(problem: SystemProblem, trials: Trials, safe: BoolArray) -> pd.DataFrame:
    """All trials as a table indexed by trial; `Study.to_dataframe` names the columns.

    Args:
        problem: how the optimiser sees the system.
        trials: n of them.
        safe: (n,) every limit was kept.
    """
    import pandas as pd

    rows = beliefs.outcomes(problem, trials)
    table = pd.DataFrame(problem.codec.table(trials.x), index=pd.Index(trials.id, name=TRIAL))
    for name in problem.codec.system.outcomes:
        table[name] = [row[name] for row in rows]
    table[STATUS] = [_STATES[Status(s)] for s in trials.status]
    table["safe"] = safe
    table["initial"] = trials.initial
    table["round"] = trials.round
    table[SAFE_PROBABILITY] = trials.predicted_safe_probability
    table[MARKED] = trials.marked_unsafe
    return table
