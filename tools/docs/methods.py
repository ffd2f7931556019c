"""A page for each method, and a table of all: from docstrings, settings, departures and kept runs."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

from hdsafebo.optimizers.base import Optimizer
from hdsafebo.optimizers.registry import METHODS, method_class
from hdsafebo.optimizers.settings import ModelSettings, SafeSetSettings
from hdsafebo.report.data.departures import Departure, read_departures
from hdsafebo.report.data.methods import style
from hdsafebo.session.advice.methods import SHORTLIST, session_method
from tools.docs import curves
from tools.docs.docstrings import text
from tools.docs.settings import settings_of, table

LOOKS = {
    "hdsafebo": ("Wei et al., CoRL 2024, Algorithms 1 and 2", "a trust region around the incumbent"),
    "hdsafebo_local": (
        "this project",
        "around the incumbent, by the [search that suits the problem](../local.md)",
    ),
    "linebo": ("Kirschner et al., ICML 2019", "a random line through the incumbent"),
    "safeopt": ("Sui et al., ICML 2015", "maximisers and expanders of a certified set"),
    "scbo": ("Eriksson and Poloczek, AISTATS 2021", "a trust region"),
    "config": ("Xu et al., ICML 2023", "everywhere"),
    "cei": ("Ament et al., NeurIPS 2023", "everywhere"),
    "cei_prob": ("Schonlau et al. 1998; Gardner et al., ICML 2014", "everywhere"),
    "cmaes": ("Hansen and Ostermeier 2001 (pycma)", "a Gaussian that adapts"),
    "turbo": ("Eriksson et al., NeurIPS 2019", "a trust region"),
    "hesbo": ("Nayebi et al., ICML 2019", "a random subspace"),
    "baxus": ("Papenmeier et al., NeurIPS 2022", "a trust region in a growing subspace"),
    "ars": ("Mania, Guy and Recht, NeurIPS 2018", "random directions of a policy's weights"),
    "thompson_rows": ("control", "rows drawn from the whole candidate set"),
    "sobol": ("control", "everywhere, evenly"),
    "local_random": ("control", "random steps around the incumbent"),
    "random_lowest": ("control", "the weakest rows of a candidate set"),
    SHORTLIST: (
        "this project; sessions of stimulation only",
        "neighbours of the best trials, and a shortlist",
    ),
}
"""Source of each method, and where it looks, for the table."""


_OF_ONE_METHOD = {"hdsafebo.optimizers.local"}


@dataclass(frozen=True)
class Page:
    """A class of methods.

    Attributes:
        names: that stand for it, the plain one first.
        kind: the class.
    """

    names: tuple[str, ...]
    kind: type[Optimizer]

    @property
    def name(self) -> str:
        """The plain name, which the file has."""
        return self.names[0]


def method_pages() -> list[Page]:
    """One for each class, in the order of the registry."""
    names: dict[type[Optimizer], list[str]] = {}
    for name in METHODS:
        names.setdefault(method_class(name)[0], []).append(name)
    names[session_method(SHORTLIST)[0]] = [SHORTLIST]
    return [Page(tuple(group), kind) for kind, group in names.items()]


def write(root: Path) -> dict[str, str]:
    """Texts by path below the project's root."""
    names = [page.name for page in method_pages()]
    pages = {f"docs/methods/{page.name}.md": _page(page, root) for page in method_pages()}
    return pages | curves.write(root, names)


def method_table() -> str:
    """All methods, a line each."""
    lines = ["| method | source | what it promises of a trial | where it looks |", "|---|---|---|---|"]
    for page in method_pages():
        source, looks = LOOKS[page.name]
        lines.append(f"| [`{page.name}`]({page.name}.md) | {source} | {_promise(page.kind)} | {looks} |")
    return "\n".join(lines)


def _promise(kind: type[Optimizer]) -> str:
    """What its settings say of safety."""
    fields = kind.Settings.model_fields
    if issubclass(kind.Settings, SafeSetSettings):
        return f"in the safe set, beta = {fields['beta'].default:g}, or marked"
    if issubclass(kind.Settings, ModelSettings):
        return "nothing; the surrogate predicts it"
    return "nothing; the surrogate is not asked"


def _page(page: Page, root: Path) -> str:
    source, looks = LOOKS[page.name]
    module = sys.modules[page.kind.__module__]
    path = Path(str(module.__file__)).resolve().relative_to(root.resolve())
    parts = [
        f"# {style(page.name).label}",
        f"`{page.name}`, from: {source}. Where it looks: {looks}.",
        text(_about(page.kind)),
        text(page.kind.__doc__),
    ]
    parts += [*_names(page), *curves.shown(root, page.name), *_departures(page)]
    settings = settings_of(page.kind.Settings)
    parts += ["## Settings", table(settings) if settings else "None."]
    parts += ["## Code", f"`{path}`, class `{page.kind.__name__}`"]
    return "\n\n".join(part for part in parts if part) + "\n"


def _about(kind: type[Optimizer]) -> str:
    """Docstring of the method's module, or of its package where it has one to itself."""
    package = kind.__module__.rpartition(".")[0]
    return str(sys.modules[package if package in _OF_ONE_METHOD else kind.__module__].__doc__)


def _names(page: Page) -> list[str]:
    """Names with settings of their own."""
    rows = []
    for name in page.names[1:]:
        fixed = METHODS[name].settings
        values = ", ".join(f"`{key}={value!r}`" for key, value in fixed.items()) or "as above; set per task"
        rows.append(f"| `{name}` | {style(name).label} | {values} |")
    if not rows:
        return []
    return ["## Other names", "\n".join(["| name | label | settings |", "|---|---|---|", *rows])]


def _departures(page: Page) -> list[str]:
    """Where the implementation differs from the paper of HdSafeBO."""
    found = [d for d in read_departures() if _concerns(d, page)]
    if not found:
        return []
    lines = [f"- **{d.where}.** {d.here} {d.changes}" for d in found]
    return ["## Where it differs from the paper", "\n".join(lines), "All: [departures](../departures.md)."]


def _concerns(departure: Departure, page: Page) -> bool:
    mentioned = any(f"`{name}`" in departure.where + departure.here for name in page.names)
    return mentioned or style(page.name).label in departure.where.split(" and ")
