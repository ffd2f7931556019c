"""What this project says of its own method, held to rules as strict as those of the paper's claims."""

from __future__ import annotations

from collections.abc import Collection

from hdsafebo.report.claims.base import NOT_RUN, Claim, Verdict, grade
from hdsafebo.report.data.methods import style, task_label
from hdsafebo.report.data.results import Results
from hdsafebo.report.formatting import interval, number, signed, with_error
from hdsafebo.report.stats.regret import regret
from hdsafebo.report.stats.statistics import MIN_PAIRS, Comparison
from hdsafebo.runs.best_trial import SAFE_ENOUGH

OWN = "hdsafebo_local"
SHARE_AT = "share_600"


def own_claims(results: Results, planned: Collection[tuple[str, str]] | None = None) -> list[Claim]:
    """Stimulation: ahead of every other method at equal information; hand: the highest safe return.

    Args:
        results: of all runs.
        planned: tasks and methods that are to run; None: those that have run. A claim over every other method
            holds in part only while one of them is missing.
    """
    scs = [task for task in results.tasks if task.startswith("scs_")]
    hand = [task for task in results.tasks if task in ("hand", "hand_informed")]
    missing = {
        task: [m for t, m in planned or () if t == task and _competes(m) and m not in results.methods(task)]
        for task in (*scs, *hand)
    }
    return [
        *(_ahead(results, task, missing[task]) for task in scs),
        *(_highest_return(results, task, missing[task]) for task in hand),
    ]


def _competes(method: str) -> bool:
    return method != OWN and style(method).family != "ablation"


def _others(results: Results, task: str) -> list[str]:
    return [m for m in results.methods(task) if _competes(m)]


def _ahead(results: Results, task: str, missing: list[str]) -> Claim:
    verdict = NOT_RUN
    if OWN in results.methods(task) and _others(results, task):
        behind, tied = [], []
        others = _others(results, task)
        for other in others:
            found = _three(results, task, other)
            worse = [name for name, c in found.items() if c.worse]
            if worse:
                behind.append(f"{style(other).label} ({', '.join(worse)})")
            elif not any(c.better for c in found.values()):
                tied.append(style(other).label)
        parts = [
            f"ahead of {len(others) - len(behind) - len(tied)} of {len(others)} (significantly better in a "
            "measure, worse in none)"
        ]
        parts += [f"significantly worse than {', '.join(behind)}"] if behind else []
        parts += [f"undecided against {', '.join(tied)}"] if tied else []
        if len(results.metrics(task, OWN)) < MIN_PAIRS:
            parts.append(f"a test needs at least {MIN_PAIRS} pairs")
        parts += _not_run(missing)
        verdict = Verdict(grade(not behind and not tied and not missing, not behind), "; ".join(parts))
    return Claim(
        f"own_{task}",
        f"{task_label(task)}: with the same information as every other method, "
        f"{style(OWN).label} is ahead of each.",
        "this project",
        "Three measures: share of the optimum at 600 trials, trials until 95 % of it, violation. Holds: "
        "significantly better than every other method in at least one and significantly worse in none. In "
        "part: significantly worse than none.",
        "stimulation",
        {"": verdict},
    )


def _not_run(missing: list[str]) -> list[str]:
    return [f"not run: {', '.join(style(m).label for m in missing)}"] if missing else []


def _three(results: Results, task: str, other: str) -> dict[str, Comparison]:
    """The comparisons with another method that have a value."""
    tables = {m: regret(results.runs[task, m], results.series(task, m)) for m in (OWN, other)}
    found = {"violation": results.compare(task, OWN, other, "violation")}
    mine, theirs = tables[OWN], tables[other]
    if mine is not None and theirs is not None:
        never = float(results.meta(task, OWN).n_trials + 1)  # later than any trial
        for name, column, higher, missing in (
            ("share", SHARE_AT, True, float("-inf")),
            ("trials to 95 %", "trials_to_95", False, never),
        ):
            if mine[column].notna().any() or theirs[column].notna().any():
                found[name] = results.compare_values(
                    f"{task}/{OWN}/{other}/{column}",
                    mine[column].fillna(missing),
                    theirs[column].fillna(missing),
                    higher_is_better=higher,
                )
    return found


def _highest_return(results: Results, task: str, missing: list[str]) -> Claim:
    verdict = NOT_RUN
    if OWN in results.methods(task):
        safe = [m for m in _others(results, task) if results.estimate(task, m, "safety").mean >= SAFE_ENOUGH]
        own = results.estimate(task, OWN, "objective")
        enough = results.estimate(task, OWN, "safety").mean >= SAFE_ENOUGH
        found = {m: results.compare(task, OWN, m, "objective") for m in safe}
        ties = [m for m, c in found.items() if not c.better]
        highest = enough and all(own.mean > results.estimate(task, m, "objective").mean for m in safe)
        parts = [f"return {with_error(own)}, safety {number(results.estimate(task, OWN, 'safety').mean)}"]
        parts += [f"{signed(found[m].difference)} over {style(m).label} ({interval(found[m])})" for m in ties]
        parts += [] if safe else [f"no other method has a safety of {SAFE_ENOUGH}"]
        parts += _not_run(missing)
        holds = enough and bool(safe) and not ties and not missing
        verdict = Verdict(grade(holds, highest), "; ".join(parts))
    return Claim(
        f"own_{task}",
        f"{task_label(task)}: {style(OWN).label} has the highest return among methods "
        f"with a safety of {SAFE_ENOUGH}.",
        "this project",
        "Holds: significantly higher than that of every other method whose mean safety is at least "
        f"{SAFE_ENOUGH}. In part: highest in the mean. The figure of return against safety shows all "
        "methods, so that the limit hides none.",
        "hand",
        {"": verdict},
    )
