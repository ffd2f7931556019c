"""Each rule gives each of its verdicts on runs made for it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.stats import norm

from hdsafebo.report.claims.base import NOT_RUN, Claim, Verdict, superiority, worst_of
from hdsafebo.report.claims.paper import paper_claims
from hdsafebo.report.data.inputs import Isometry, Stimulation
from hdsafebo.report.data.results import Results, Uncertainty
from hdsafebo.runs.read import read_runs
from report.run_files import NO_FAULTS, trial_table, write_run

SEEDS = 8


def flat(root: Path, task: str, method: str, value: float, *, seeds: int = SEEDS, **metadata: object) -> None:
    """Runs whose objective is `value` plus a small number that depends on the seed; initial ones 0."""
    tables = []
    for seed in range(seeds):
        objective = np.where(np.arange(8) < 4, 0.0, value + 0.01 * seed)
        tables.append(trial_table(seed, objective, np.ones(8), n_initial=4, batch=2, bound=0.1))
    write_run(root, task, method, tables, n_initial=4, batch=2, **metadata)


def results(root: Path) -> Results:
    return Results(read_runs(root / "data/runs"), Uncertainty(bootstrap_samples=200))


def claim(root: Path, name: str) -> Claim:
    return next(c for c in paper_claims(results(root), None, None) if c.name == name)


def test_superiority_over_all_is_reproduced(tmp_path: Path) -> None:
    for method, value in {"hdsafebo": 2.0, "scbo": 1.0, "cei": 0.5}.items():
        flat(tmp_path, "toy", method, value)
    verdict = superiority(results(tmp_path), ["toy"], "hdsafebo", "objective", ["scbo", "cei"])
    assert verdict.status == "reproduced"
    assert "2 of 2" in verdict.text
    assert "+1.00 over SCBO" in verdict.text
    assert f"{SEEDS} pairs" in verdict.text


def test_a_baseline_that_was_not_run_leaves_it_partly(tmp_path: Path) -> None:
    flat(tmp_path, "toy", "hdsafebo", 2.0)
    flat(tmp_path, "toy", "scbo", 1.0)
    verdict = superiority(results(tmp_path), ["toy"], "hdsafebo", "objective", ["scbo", "cei"])
    assert verdict.status == "partly"
    assert "not run: cEI" in verdict.text


def test_too_few_seeds_leave_it_partly(tmp_path: Path) -> None:
    flat(tmp_path, "toy", "hdsafebo", 2.0, seeds=5)
    flat(tmp_path, "toy", "scbo", 1.0, seeds=5)
    verdict = superiority(results(tmp_path), ["toy"], "hdsafebo", "objective", ["scbo"])
    assert verdict.status == "partly"
    assert "at least 6 pairs" in verdict.text


def test_a_worse_result_is_not_reproduced(tmp_path: Path) -> None:
    for method, value in {"hdsafebo": 1.0, "scbo": 2.0, "cei": 0.5, "config": 0.5}.items():
        flat(tmp_path, "toy", method, value)
    verdict = superiority(results(tmp_path), ["toy"], "hdsafebo", "objective", ["scbo", "cei", "config"])
    assert verdict.status == "not"
    assert "significantly worse than SCBO" in verdict.text


def test_a_tie_is_not_superiority(tmp_path: Path) -> None:
    flat(tmp_path, "toy", "hdsafebo", 1.0)
    flat(tmp_path, "toy", "scbo", 1.0)
    assert superiority(results(tmp_path), ["toy"], "hdsafebo", "objective", ["scbo"]).status == "not"


def test_original_space_counts_as_the_baseline(tmp_path: Path) -> None:
    flat(tmp_path, "toy", "hdsafebo", 2.0)
    flat(tmp_path, "toy", "scbo_original", 1.0, space="original", algorithm="scbo")
    verdict = superiority(results(tmp_path), ["toy"], "hdsafebo", "objective", ["scbo"])
    assert verdict.status == "reproduced"
    assert "SCBO (O)" in verdict.text


def test_nothing_run_is_not_run(tmp_path: Path) -> None:
    assert superiority(results(tmp_path), ["toy"], "hdsafebo", "objective", ["scbo"]) == NOT_RUN
    for c in paper_claims(results(tmp_path), None, None):
        assert {v.status for v in c.verdicts.values()} == {"not run"}, c.name


def test_the_bound_is_held_against_what_was_modelled(tmp_path: Path) -> None:
    """On the hand the reported violation is in m/s and the model's is not."""
    g = np.where(np.arange(8) == 5, -0.3, 1.0)
    table = trial_table(0, np.ones(8), g, n_initial=4, batch=2, bound=0.1)
    table["violation"] = 100 * table["violation"]
    promise = {"beta": 2.0, "guaranteed_alpha": float(norm.sf(2.0))}
    write_run(tmp_path, "toy", "hdsafebo", [table], n_initial=4, batch=2, **promise)
    verdict = claim(tmp_path, "one_step_bound").verdicts["hdsafebo"]
    assert verdict.status == "reproduced"
    assert "observed 0.300, sum of bounds 0.400" in verdict.text


def test_proposition_3(tmp_path: Path) -> None:
    check = Isometry(distance_correlation=0.99, gp_mean_difference=1.0, gp_variance_difference=1.0)
    for beta, status in ((2.0, "empty"), (-2.0, "partly")):
        flat(tmp_path, "toy", "hdsafebo", 1.0, beta=beta, guaranteed_alpha=float(norm.sf(beta)))
        claims = paper_claims(results(tmp_path), {"irvae": check}, None)
        assert next(c for c in claims if c.name == "proposition_3").verdicts[""].status == status


def test_worst_of() -> None:
    empty = Verdict("empty", "d")
    good, part, bad = Verdict("reproduced", "a"), Verdict("partly", "b"), Verdict("not", "c")
    assert worst_of([good, good]).status == "reproduced"
    assert worst_of([good, part]).status == "partly"
    assert worst_of([good, empty]).status == "empty"
    assert worst_of([part, empty]).status == "partly"
    assert worst_of([good, bad, NOT_RUN]).status == "not"
    assert worst_of([good, NOT_RUN]).status == "partly"
    assert worst_of([NOT_RUN]) == NOT_RUN


@pytest.mark.parametrize(
    ("again", "certified", "status"), [(True, 0, "reproduced"), (True, 7, "not"), (False, 0, "not")]
)
def test_safeopt_is_judged_by_new_and_certified_points(
    tmp_path: Path, again: bool, certified: int, status: str
) -> None:
    """The best value rises in every run, by repeated noise."""
    tables = [
        trial_table(
            s, [1.0, 0.5, 1.1, 0.1], np.ones(4), n_initial=2, batch=2, repeated=[False, False, True, again]
        )
        for s in range(4)
    ]
    counts = [NO_FAULTS | {"certified": certified}] * 4
    write_run(tmp_path, "synthetic", "safeopt", tables, n_initial=2, batch=2, counts=counts)
    verdict = claim(tmp_path, "synthetic_safeopt").verdicts[""]
    assert verdict.status == status
    assert f"{0 if again else 4} of 8 trials at a point that was not tried before" in verdict.text


def test_a_variant_of_a_baseline_counts_too(tmp_path: Path) -> None:
    for method, value in {"hdsafebo": 2.0, "cmaes": 1.0, "cmaes_tuned": 3.0}.items():
        flat(tmp_path, "toy", method, value)
    verdict = superiority(results(tmp_path), ["toy"], "hdsafebo", "objective", ["cmaes"])
    assert verdict.status == "not"
    assert "significantly worse than CMA-ES, tuned step" in verdict.text


@pytest.mark.parametrize(("unconstrained", "status"), [(0.5, "reproduced"), (3.0, "not")])
def test_random_embeddings_are_judged_by_their_best_value_safe_or_not(
    tmp_path: Path, unconstrained: float, status: str
) -> None:
    for task in ("scs_st", "scs_ga"):
        flat(tmp_path, task, "hdsafebo", 1.0)
        for method in ("hesbo", "baxus"):
            tables = [
                trial_table(s, [0.0, unconstrained + 0.01 * s], [1.0, -1.0], n_initial=1, batch=1)
                for s in range(SEEDS)
            ]
            write_run(tmp_path, task, method, tables, n_initial=1, batch=1)
    assert claim(tmp_path, "scs_random_embeddings").verdicts["hdsafebo"].status == status


@pytest.mark.parametrize(("value", "status"), [(-1.0, "reproduced"), (5.0, "not")])
def test_no_positive_reward(tmp_path: Path, value: float, status: str) -> None:
    for method in ("scbo", "linebo"):
        tables = [trial_table(0, [-9.0, value], [1.0, 1.0], n_initial=1, batch=1)]
        write_run(tmp_path, "hand", method, tables, n_initial=1, batch=1)
    assert claim(tmp_path, "hand_no_reward").verdicts[""].status == status


def test_a_beta_that_changes_no_trial_says_nothing(tmp_path: Path) -> None:
    for method in ("hdsafebo", "hdsafebo_beta0", "hdsafebo_beta16"):
        flat(tmp_path, "hand", method, 1.0, beta=2.0)
    verdict = claim(tmp_path, "hand_beta").verdicts[""]
    assert verdict.status == "empty"
    assert "every trial is the same" in verdict.text


@pytest.mark.parametrize(("gain", "status"), [(0.0, "reproduced"), (0.9, "not")])
def test_original_space_fails_on_the_hand(tmp_path: Path, gain: float, status: str) -> None:
    flat(tmp_path, "hand", "hdsafebo", 1.0)
    flat(tmp_path, "hand", "cei_original", gain, space="original", algorithm="cei")
    ours = {"space": "original", "algorithm": "hdsafebo_local"}  # no baseline
    flat(tmp_path, "hand", "hdsafebo_local_original", 1.0, **ours)
    assert claim(tmp_path, "hand_original").verdicts[""].status == status


@pytest.mark.parametrize(
    ("values", "status"),
    [((1.0, 1.001, 1.0), "partly"), ((1.0, 1.1, 0.9), "partly"), ((1.0, 0.2, 0.9), "not")],
)
def test_beta(tmp_path: Path, values: tuple[float, ...], status: str) -> None:
    for method, value in zip(("hdsafebo", "hdsafebo_beta0", "hdsafebo_beta16"), values, strict=True):
        flat(tmp_path, "hand", method, value, beta=2.0)
    assert claim(tmp_path, "hand_beta").verdicts[""].status == status


def test_components(tmp_path: Path) -> None:
    def runs(method: str, objective: float, unsafe: int) -> None:
        g = np.where(np.isin(np.arange(44), range(4, 4 + unsafe)), -1.0, 1.0)
        values = np.where(np.arange(44) < 4, 0.0, objective)
        tables = [trial_table(s, values + 0.01 * s, g, n_initial=4, batch=2) for s in range(SEEDS)]
        write_run(tmp_path, "hand", method, tables, n_initial=4, batch=2)

    runs("hdsafebo", 2.0, 1)
    runs("hdsafebo_global", 1.0, 5)
    runs("hdsafebo_pessimistic", 2.0, 5)
    assert claim(tmp_path, "hand_components").verdicts[""].status == "reproduced"
    runs("hdsafebo_pessimistic", 2.0, 1)
    assert claim(tmp_path, "hand_components").verdicts[""].status == "partly"
    runs("hdsafebo_global", 3.0, 5)
    assert claim(tmp_path, "hand_components").verdicts[""].status == "not"


@pytest.mark.parametrize(
    ("beta", "unsafe", "guarantee", "bound"),
    [
        (2.0, 0, "empty", "empty"),  # alpha 0.023, and a bound above nothing at all
        (2.0, 1, "empty", "reproduced"),
        (-2.0, 0, "reproduced", "empty"),
        (-2.0, 1, "not", "reproduced"),
        (2.0, 4, "not", "not"),
    ],
)
def test_theory(tmp_path: Path, beta: float, unsafe: int, guarantee: str, bound: str) -> None:
    g = np.where(np.isin(np.arange(8), range(4, 4 + unsafe)), -0.3, 1.0)
    tables = [trial_table(s, np.ones(8), g, n_initial=4, batch=2, bound=0.1) for s in range(3)]
    alpha = float(norm.sf(beta))
    write_run(tmp_path, "toy", "hdsafebo", tables, n_initial=4, batch=2, beta=beta, guaranteed_alpha=alpha)
    assert claim(tmp_path, "guarantee").verdicts["hdsafebo"].status == guarantee
    assert claim(tmp_path, "one_step_bound").verdicts["hdsafebo"].status == bound
    assert ("vacuous" in claim(tmp_path, "guarantee").verdicts["hdsafebo"].text) == (beta > 0)
    assert claim(tmp_path, "theorem_1").verdicts[""].status == "partly"


@pytest.mark.parametrize(("wins", "status"), [(3, "reproduced"), (1, "partly"), (0, "not")])
def test_isometry(tmp_path: Path, wins: int, status: str) -> None:
    good = {"distance_correlation": 0.9, "gp_mean_difference": 1.0, "gp_variance_difference": 1.0}
    bad = {"distance_correlation": 0.8, "gp_mean_difference": 2.0, "gp_variance_difference": 2.0}
    names = list(good)[:wins]
    first = Isometry(**{k: (good if k in names else bad)[k] for k in good})
    second = Isometry(**{k: (bad if k in names else good)[k] for k in good})
    claims = paper_claims(results(tmp_path), {"irvae": first, "vae": second}, None)
    assert next(c for c in claims if c.name == "embedding_isometry").verdicts[""].status == status


@pytest.mark.parametrize(
    ("rows", "share", "status"), [(218_000, 0.5, "reproduced"), (100, 0.5, "partly"), (1, 0.9, "not")]
)
def test_dataset(tmp_path: Path, rows: int, share: float, status: str) -> None:
    claims = paper_claims(results(tmp_path), None, Stimulation(rows=rows, threshold=0.05, safe_share=share))
    assert next(c for c in claims if c.name == "scs_dataset").verdicts[""].status == status


@pytest.mark.parametrize(("seconds", "status"), [(1.0, "reproduced"), (12.0, "partly"), (60.0, "not")])
def test_round_time(tmp_path: Path, seconds: float, status: str) -> None:
    table = trial_table(0, np.ones(4), np.ones(4), n_initial=2, batch=1, seconds=seconds)
    write_run(tmp_path, "scs_st", "hdsafebo", [table], n_initial=2, batch=1)
    assert claim(tmp_path, "round_time").verdicts[""].status == status
