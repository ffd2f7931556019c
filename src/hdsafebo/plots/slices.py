"""What is believed along one parameter, or over two, with all others held."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from hdsafebo.errors import NoSafePointError
from hdsafebo.plots.style import BAND, LINE, UNSAFE, done, labelled, mark_trials, new_figure, varying
from hdsafebo.system.errors import TableError
from hdsafebo.system.parameters import Choice, Parameter, Real
from hdsafebo.system.study import Study

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_POINTS = 81
_GRID = 41
_LEVELS = (0.5, 0.9, 0.99)


def slices(
    study: Study,
    names: Sequence[str] | None = None,
    *,
    at: Mapping[str, Any] | None = None,
    context: Mapping[str, Any] | None = None,
) -> Figure:
    """Objective (mean and two standard deviations) and safe probability along each parameter.

    Args:
        study: with results.
        names: of parameters; None takes all, the first eight.
        at: values of the others; None takes the setting that is believed best.
        context: value of every context; None takes those of that setting's trial.

    Raises:
        TableError: a name or value that the system does not have.
        NoSafePointError: no trial kept every limit, and `at` is not given.
    """
    parameters = _named(study, names)[:8]
    held = _held(study, at, context)
    trials = done(study.to_dataframe())
    objective = study.system.objective
    figure = new_figure(max(3.4, 2.4 * len(parameters)), 4.6)
    panels = figure.subplots(2, len(parameters), sharey="row", sharex="col", squeeze=False)
    for (above, below), parameter in zip(panels.T, parameters, strict=True):
        values = _values(parameter, _POINTS)
        table = study.predict({n: [v] * len(values) for n, v in held.items()} | {parameter.name: values})
        x = _places(parameter, values)
        mean, sd = table[objective.name].to_numpy(), table[objective.name + "_sd"].to_numpy()
        above.plot(x, mean, color=LINE, marker="o" if isinstance(parameter, Choice) else "", zorder=2)
        above.fill_between(x, mean - 2 * sd, mean + 2 * sd, color=BAND, alpha=0.18, linewidth=0)
        mark_trials(
            above, trials, _places(parameter, trials[parameter.name]), trials[objective.name], size=14
        )
        below.plot(
            x, table["safe_probability"], color=UNSAFE, marker="o" if isinstance(parameter, Choice) else ""
        )
        below.set_ylim(-0.04, 1.04)
        _scale(below, parameter)
        for axes in (above, below):
            axes.axvline(
                _places(parameter, [held[parameter.name]])[0], color=LINE, linewidth=0.7, linestyle=":"
            )
    panels[0, 0].set_ylabel(labelled(objective))
    panels[1, 0].set_ylabel("safe probability")
    figure.suptitle(
        _title(held, [p.name for p in parameters] if len(parameters) == 1 else []), fontsize="small"
    )
    return figure


def slice_map(
    study: Study,
    x: str,
    y: str,
    *,
    at: Mapping[str, Any] | None = None,
    context: Mapping[str, Any] | None = None,
) -> Figure:
    """Objective and safe probability over two parameters, with the trials.

    Args:
        study: with results.
        x: name of a parameter that is a number.
        y: another one.
        at: values of the others; None takes the setting that is believed best.
        context: value of every context; None takes those of that setting's trial.

    Raises:
        TableError: a name or value that the system does not have, or a parameter that is no number.
        NoSafePointError: no trial kept every limit, and `at` is not given.
    """
    across, up = _named(study, [x, y])
    for parameter in (across, up):
        if not isinstance(parameter, Real):
            raise TableError(f"{parameter.name} is no number; a map needs two parameters that are")
    held = _held(study, at, context)
    columns, rows = np.meshgrid(_values(across, _GRID), _values(up, _GRID))
    flat = {n: [v] * columns.size for n, v in held.items()}
    table = study.predict(flat | {x: columns.ravel().tolist(), y: rows.ravel().tolist()})
    trials = done(study.to_dataframe())
    objective = study.system.objective
    figure = new_figure(9.0, 3.9)
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    for axes, column, title, colours in (
        (panels[0], objective.name, labelled(objective), "viridis" if objective.sign > 0 else "viridis_r"),
        (panels[1], "safe_probability", "safe probability", "Blues"),
    ):
        heights = table[column].to_numpy().reshape(columns.shape)
        limits = {"vmin": 0.0, "vmax": 1.0} if axes is panels[1] else {}
        drawn = axes.pcolormesh(columns, rows, heights, cmap=colours, shading="nearest", **limits)
        figure.colorbar(drawn, ax=axes)
        safe = table["safe_probability"].to_numpy().reshape(columns.shape)
        if safe.min() < _LEVELS[-1] and safe.max() > _LEVELS[0]:
            lines = axes.contour(columns, rows, safe, levels=_LEVELS, colors=LINE, linewidths=(0.6, 0.9, 1.3))
            axes.clabel(lines, fontsize="x-small")
        mark_trials(axes, trials, trials[x], trials[y], size=18)
        axes.set_title(title, fontsize="medium")
        _scale(axes, across)
    _scale(panels[0], up, vertical=True)
    figure.suptitle(_title(held, [x, y]), fontsize="small")
    return figure


def _named(study: Study, names: Sequence[str] | None) -> list[Parameter]:
    known = {p.name: p for p in varying(study)}
    chosen = list(known) if names is None else list(names)
    for name in chosen:
        if name not in known:
            raise TableError(f"{name!r} is no parameter that varies; expected some of {', '.join(known)}")
    return [known[name] for name in chosen]


def _held(study: Study, at: Mapping[str, Any] | None, context: Mapping[str, Any] | None) -> dict[str, Any]:
    """Value of every parameter and context."""
    best = study.best(context=context)
    if best is None and at is None:
        raise NoSafePointError("no trial kept every limit yet; say with `at` where to look")
    held = {} if best is None else dict(best.believed.setting)
    held |= dict(at or {}) | dict(context or {})
    unknown = sorted(set(held) - set(study.system.inputs))
    missing = sorted(set(study.system.inputs) - set(held))
    if unknown or missing:
        raise TableError(
            f"at: unknown {unknown}, missing {missing}; expected {', '.join(study.system.inputs)}"
        )
    return held


def _values(parameter: Parameter, most: int) -> list[Any]:
    """Values along a parameter, at most so many, or all of a choice."""
    if isinstance(parameter, Choice):
        return list(parameter.values)
    assert isinstance(parameter, Real)
    columns = parameter.land(np.linspace(0.0, 1.0, most)[:, None])
    return [parameter.python(v) for v in np.unique(parameter.decode(columns))]


def _places(parameter: Parameter, values: Any) -> list[float]:
    """Where values stand on an axis."""
    if isinstance(parameter, Choice):
        return parameter.check(list(values)).tolist()
    return [float(v) for v in values]


def _scale(axes: Axes, parameter: Parameter, *, vertical: bool = False) -> None:
    """Name an axis, and give it the parameter's scale."""
    label, scale, ticks = (
        (axes.set_ylabel, axes.set_yscale, axes.set_yticks)
        if vertical
        else (axes.set_xlabel, axes.set_xscale, axes.set_xticks)
    )
    label(labelled(parameter))
    if isinstance(parameter, Choice):
        ticks(range(len(parameter.values)), [str(v) for v in parameter.values])
    elif isinstance(parameter, Real) and parameter.log:
        scale("log")


def _title(held: Mapping[str, Any], without: Sequence[str]) -> str:
    parts = [
        f"{n} = {v:.4g}" if isinstance(v, float) else f"{n} = {v}"
        for n, v in held.items()
        if n not in without
    ]
    return "at " + ", ".join(parts[:10]) + (" ..." if len(parts) > 10 else "") if parts else ""
