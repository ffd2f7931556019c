"""How methods and tasks are called and drawn; one colour, marker and line per method everywhere."""

from __future__ import annotations

from dataclasses import dataclass, replace

# Okabe and Ito (2008): distinguishable with every common colour vision deficiency.
BLACK, ORANGE, SKY, GREEN, YELLOW, BLUE, VERMILLION, PURPLE = (
    "#000000", "#E69F00", "#56B4E9", "#009E73", "#F0E442", "#0072B2", "#D55E00", "#CC79A7",
)  # fmt: skip

INFORMED = "_informed"


@dataclass(frozen=True)
class MethodStyle:
    """Label, panel and line of a method.

    Attributes:
        label: name on the page.
        family: the small multiple it is drawn in.
        colour, marker, dash: of its line; markers and dashes carry the figure in black and white.
        needs_threshold: False when the method ignores the safety functions.
    """

    label: str
    family: str
    colour: str
    marker: str
    dash: str = "-"
    needs_threshold: bool = True


FAMILIES = {
    "ours": "HdSafeBO, and this project's local variant",
    "readings": "other readings of the paper",
    "local": "local and line search",
    "global": "global constrained BO",
    "free": "no model",
    "embedding": "no constraint",
    "original": "original space (O)",
    "reduced": "fewer parameters of the body",
    "ablation": "ablations",
    "other": "other methods",
}

_DASHED, _DOTTED, _DASHDOT = (0, (5, 2)), (0, (1, 1.5)), (0, (5, 1.5, 1, 1.5))
DASHES: dict[str, object] = {"-": "-", "dashed": _DASHED, "dotted": _DOTTED, "dashdot": _DASHDOT}

_METHODS = {
    "hdsafebo": MethodStyle("HdSafeBO", "ours", BLACK, "o"),
    "hdsafebo_local": MethodStyle("HdSafeBO-local", "ours", VERMILLION, "s"),
    "hdsafebo_printed": MethodStyle("HdSafeBO as listed", "readings", SKY, "X", "dashed"),
    "hdsafebo_length_scales": MethodStyle("HdSafeBO in length scales", "readings", BLUE, "^", "dashdot"),
    "linebo": MethodStyle("LineBO", "local", BLUE, "^", "dashed"),
    "linebo_lower": MethodStyle("LineBO, lower bound", "local", PURPLE, "v", "dotted"),
    "scbo": MethodStyle("SCBO", "local", GREEN, "D", "dashdot"),
    "config": MethodStyle("CONFIG", "global", BLUE, "^", "dashed"),
    "cei": MethodStyle("cEI", "global", GREEN, "D", "dashdot"),
    "cei_botorch": MethodStyle("cEI, BoTorch's kernel", "global", GREEN, "X", "dotted"),
    "cei_prob": MethodStyle("cEI-Prob", "global", PURPLE, "v", "dotted"),
    "cei_prob_botorch": MethodStyle("cEI-Prob, BoTorch's kernel", "global", PURPLE, "*", "dashed"),
    "safeopt": MethodStyle("SafeOpt", "global", ORANGE, "P", "dashed"),
    "cmaes": MethodStyle("CMA-ES", "free", BLUE, "^", "dashed"),
    "cmaes_tuned": MethodStyle("CMA-ES, tuned step", "free", SKY, "X", "dashdot"),
    "cmaes_centre": MethodStyle("CMA-ES, from centre", "free", ORANGE, "P", "dotted"),
    "sobol": MethodStyle("Sobol search", "free", GREEN, "D", "dotted"),
    "local_random": MethodStyle("Local random steps", "free", PURPLE, "v", "dashdot"),
    "random_lowest": MethodStyle("Random, lowest current", "free", ORANGE, "P", "dashed"),
    "thompson_rows": MethodStyle("Thompson sampling, all rows", "global", SKY, "X", "dashdot"),
    "turbo": MethodStyle("TuRBO", "embedding", GREEN, "D", "dashdot", needs_threshold=False),
    "hesbo": MethodStyle("HesBO", "embedding", BLUE, "^", "dashed", needs_threshold=False),
    "ars": MethodStyle("ARS", "free", PURPLE, "v", "dotted"),
    "baxus": MethodStyle("BAxUS", "embedding", PURPLE, "v", "dotted", needs_threshold=False),
    "hdsafebo_global": MethodStyle("no local search", "ablation", BLUE, "^", "dashed"),
    "hdsafebo_pessimistic": MethodStyle("no optimism", "ablation", GREEN, "D", "dashdot"),
    "hdsafebo_beta0": MethodStyle("HdSafeBO, β = 0", "ablation", PURPLE, "v", "dotted"),
    "hdsafebo_beta4": MethodStyle("HdSafeBO, β = 4", "ablation", ORANGE, "P", "dashed"),
    "hdsafebo_beta8": MethodStyle("HdSafeBO, β = 8", "ablation", SKY, "X", "dashdot"),
    "hdsafebo_beta16": MethodStyle("HdSafeBO, β = 16", "ablation", BLUE, "*", "dotted"),
}
# Methods in the problem's own space, by the names of their blocks in the profiles, as (O) of these methods.
_IN_ORIGINAL_SPACE = {
    "hdsafebo_local_original": ("hdsafebo_local", VERMILLION, "*", "dotted"),
    "linebo_original": ("linebo", BLUE, "^", "dashed"),
    "scbo_original": ("scbo", GREEN, "D", "dashdot"),
    "config_original": ("config", PURPLE, "v", "dotted"),
    "cei_original": ("cei", ORANGE, "P", "dashed"),
    "cmaes_original": ("cmaes", SKY, "X", "dashdot"),
    "cmaes_tuned_original": ("cmaes_tuned", SKY, "h", "dotted"),
    "sobol_original": ("sobol", GREEN, "p", "dotted"),
}
# Methods that search a body through synergies, or the gains of its reflex.
_METHODS |= {
    "scbo_torques": MethodStyle("SCBO, joint torques", "reduced", GREEN, "D", "dashdot"),
    "hdsafebo_local_gains": MethodStyle("HdSafeBO-local, reflex gains", "reduced", ORANGE, "P", "dotted"),
    "cmaes_gains": MethodStyle("CMA-ES, reflex gains", "reduced", BLUE, "^", "dashed"),
    "reflex": MethodStyle("Best initial reflex", "reduced", BLACK, "*", "dotted"),
}
_METHODS |= {
    name: replace(
        _METHODS[latent],
        label=f"{_METHODS[latent].label} (O)",
        family="original",
        colour=colour,
        marker=marker,
        dash=dash,
    )
    for name, (latent, colour, marker, dash) in _IN_ORIGINAL_SPACE.items()
}
_OTHER_LINES = (
    (BLUE, "^", "dashed"),
    (GREEN, "D", "dashdot"),
    (PURPLE, "v", "dotted"),
    (ORANGE, "P", "dashed"),
    (SKY, "X", "dashdot"),
)

MUSCLES = {"il": "IL", "vlrf": "VL&RF", "ta": "TA", "bfgm": "BF&GM", "st": "ST", "ga": "GA"}


def style(method: str) -> MethodStyle:
    """Style of a method; names that are not known keep their own name as label."""
    if method in _METHODS:
        return _METHODS[method]
    beta = beta_of_ablation(method)
    colour, marker, dash = _OTHER_LINES[sum(map(ord, method)) % len(_OTHER_LINES)]
    if beta is not None:
        return MethodStyle(f"HdSafeBO, β = {beta:g}", "ablation", colour, marker, dash)
    return MethodStyle(method, "other", colour, marker, dash)


def beta_of_ablation(method: str) -> float | None:
    """Beta of a method named `hdsafebo_beta<number>`, None for other names."""
    text = method.removeprefix("hdsafebo_beta")
    if text == method:
        return None
    try:
        return float(text)
    except ValueError:
        return None


def order(methods: list[str]) -> list[str]:
    """Methods in the order of tables and legends: by family, then as listed above."""
    families, known = list(FAMILIES), list(_METHODS)

    def key(method: str) -> tuple[int, int, str]:
        beta = beta_of_ablation(method)
        last = len(known) + int(beta if beta is not None else 10**6)
        rank = known.index(method) if method in known else last
        return families.index(style(method).family), rank, method

    return sorted(methods, key=key)


def by_family(methods: list[str]) -> dict[str, list[str]]:
    """Baselines by family, each with this project's methods in front; else these methods alone."""
    ours = [m for m in order(methods) if style(m).family == "ours"]
    groups: dict[str, list[str]] = {}
    for method in order(methods):
        if style(method).family != "ours":
            groups.setdefault(style(method).family, list(ours)).append(method)
    return groups or {"ours": ours}


def is_informed(task: str) -> bool:
    """Whether a task is in the informed setting; the others are in the paper's."""
    return task.endswith(INFORMED)


def task_label(task: str) -> str:
    """Name of a task on the page, with its setting."""
    if is_informed(task):
        return f"{task_label(task.removesuffix(INFORMED))}, informed"
    if task.startswith("scs_"):
        muscle = task.removeprefix("scs_")
        return f"Stimulation, {MUSCLES.get(muscle, muscle.upper())}"
    if task.startswith("digits_"):
        return f"Digit {task.removeprefix('digits_')}"
    return {
        "synthetic": "Synthetic functions",
        "hand": "Musculoskeletal hand",
        "body": "Whole body after a push",
        "digits": "Digits (mean of all)",
    }.get(task, task)
