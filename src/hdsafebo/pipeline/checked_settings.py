"""What stages would refuse later: settings of methods, and names that one block takes from another.

A stage checks what it uses itself, after those before it may have computed for hours; an edit is checked
whole. All methods are imported for this, which no stage has to wait for.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from hdsafebo.embeddings.registry import embedding_class
from hdsafebo.errors import HdSafeBOError, ParamsError
from hdsafebo.optimizers.registry import method_class
from hdsafebo.params import Params
from hdsafebo.params.base import MethodSettings
from hdsafebo.params.spinal import Spinal
from hdsafebo.params.tasks import Family, InformedFamily

if TYPE_CHECKING:
    from hdsafebo.optimizers.settings import OptimizerSettings


def check_settings(params: Params, source: str) -> None:
    """Refuse settings that a method does not take, and names that nothing has.

    Args:
        params: checked by `checked_params.load_checked_params`.
        source: file, for messages.

    Raises:
        ParamsError: the message names file and key, and what is allowed.
    """
    for name, method in params.methods.items():
        with _within(f"{source}: methods.{name}"):
            _check_method(method.algorithm, method.settings)
    for family, task in params.tasks:
        _check_task(params, f"{source}: tasks.{family}", task)
    with _within(f"{source}: digits.embedding"):
        embedding_class(params.digits.embedding).check_settings(params.digits.embedding_settings)
    embeddings = params.embeddings.models
    _require(
        [params.tasks.scs.problem.embedding],
        embeddings,
        f"{source}: tasks.scs.problem.embedding",
        "embedding",
    )
    _require(params.isometry.floors, embeddings, f"{source}: isometry.floors", "embedding")
    _check_spinal(params.spinal, source)


def _check_task(params: Params, at: str, task: Family) -> None:
    """Settings of methods on one family of tasks, and what its lists name."""
    _once(task.methods, f"{at}.methods")
    _once(getattr(task, "tasks", ()), f"{at}.tasks")
    _require(task.budget.seeds_of, params.methods, f"{at}.budget.seeds_of", "method")
    for name, own in task.settings.items():
        method = params.methods[name]
        with _within(f"{at}.settings.{name}"):
            _check_method(method.algorithm, method.settings | own)
    _distinct(params, at, task, informed=False)
    if isinstance(task, InformedFamily):
        for name in task.informed.settings:
            method = params.methods[name]
            with _within(f"{at}.informed.settings.{name}"):
                _check_method(method.algorithm, method.settings | task.settings_for(name, informed=True))
        _distinct(params, at, task, informed=True)


def _check_method(algorithm: str, settings: MethodSettings) -> OptimizerSettings:
    """All settings of a method, with their defaults."""
    from hdsafebo.optimizers.settings import check_settings as check

    kind, fixed = method_class(algorithm)
    return check(kind.Settings, algorithm, None, fixed | settings)


def _distinct(params: Params, at: str, task: Family, *, informed: bool) -> None:
    """Refuse two methods that compute the same: one result under two names looks like two."""
    where = " in the informed setting" if informed else ""
    runs: dict[str, Any] = {}
    for name in task.methods:
        method = params.methods[name]
        own = task.settings_for(name, informed=informed)
        settings = _check_method(method.algorithm, method.settings | own)
        run = method_class(method.algorithm)[0], task.searched(method.space), settings
        for other, earlier in runs.items():
            if run == earlier:
                raise ParamsError(
                    f"{at}.methods: {name!r} is the same run as {other!r}{where}: the same algorithm, "
                    "space and settings; leave one out, or give it settings of its own"
                )
        runs[name] = run


def _check_spinal(spinal: Spinal, source: str) -> None:
    from hdsafebo.spinal.geometry.anatomy import Anatomy
    from hdsafebo.spinal.geometry.conductivity import conductivity_table
    from hdsafebo.spinal.muscles import districts

    with _within(f"{source}: spinal.anatomy"):
        anatomy = Anatomy().overridden(spinal.anatomy)
    with _within(f"{source}: spinal.conductivity"):
        conductivity_table(spinal.conductivity)
    with _within(f"{source}: spinal.districts"):
        districts(anatomy, spinal.districts)


def _require(names: Iterable[str], known: Iterable[str], at: str, what: str) -> None:
    """Refuse names that are not known."""
    valid = list(known)
    for name in names:
        if name not in valid:
            raise ParamsError(f"{at}: unknown {what} {name!r}; these parameters have {', '.join(valid)}")


def _once(names: Sequence[str], at: str) -> None:
    """Refuse a name that a list has twice."""
    for name in names:
        if names.count(name) > 1:
            raise ParamsError(f"{at}: {name!r} appears twice")


@contextmanager
def _within(at: str) -> Iterator[None]:
    """Let errors say where in the file the value is."""
    try:
        yield
    except HdSafeBOError as error:
        raise ParamsError(f"{at}: {error}") from None
