"""Result files of the size of the largest profile, with random content."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.stats import norm

from report.run_files import random_runs

BETA_METHODS = ("hdsafebo", "hdsafebo_local", "linebo", "config")
QUALITY = {
    "hdsafebo": (2.5, 0.85),
    "hdsafebo_local": (4.0, 0.97),
    "linebo": (1.0, 0.8),
    "scbo": (1.5, 0.7),
    "config": (0.8, 0.7),
    "cei": (0.7, 0.7),
    "cei_prob": (0.7, 0.75),
    "cmaes": (0.6, 0.7),
    "sobol": (0.2, 0.6),
    "safeopt": (0.0, 0.9),
}
ORIGINAL = {f"{name}_original": name for name in ("linebo", "scbo", "config", "cei", "cmaes")}
ABLATIONS = {
    "hdsafebo_global": 1.0,
    "hdsafebo_pessimistic": 2.0,
    "hdsafebo_beta0": 2.4,
    "hdsafebo_beta4": 2.5,
    "hdsafebo_beta8": 2.4,
    "hdsafebo_beta16": 2.3,
}
RANDOM_EMBEDDINGS = ("turbo", "hesbo", "baxus")


def write_everything(
    root: Path, *, seeds_divided_by: int = 1, only: tuple[tuple[str, ...], tuple[str, ...]] | None = None
) -> None:
    """Every input of the report; runs of all tasks and methods, or `only` of the tasks and methods named."""
    rng = np.random.default_rng(0)

    def runs(task: str, method: str, seeds: int, sizes: tuple[int, int, int], **metadata: object) -> None:
        if only is not None and (task not in only[0] or method not in only[1]):
            return
        base = ORIGINAL.get(method, method)
        gain, share = QUALITY.get(base, (ABLATIONS.get(base, 1.2), 0.75))
        beta = 2.0 if base in BETA_METHODS or base in ABLATIONS else None
        extra = {} if beta is None else {"beta": beta, "guaranteed_alpha": float(norm.sf(beta))}
        n_initial, n_trials, batch = sizes
        space = "original" if method in ORIGINAL else "latent"
        random_runs(
            root,
            task,
            method,
            seeds=max(1, seeds // seeds_divided_by),
            n_initial=n_initial,
            n_trials=n_trials,
            batch=batch,
            gain=gain,
            safe_share=share,
            rng=rng,
            space=space,
            algorithm=base,
            **extra,
            **metadata,
        )

    for method in (*QUALITY, *ORIGINAL):
        runs(
            "synthetic",
            method,
            100 if method in ("hdsafebo", "hdsafebo_local", "sobol") else 20,
            (200, 500, 10),
            thresholds=[-0.75],
        )
    for method in (*QUALITY, *ORIGINAL, *ABLATIONS, "local_random"):
        runs("hand", method, 5, (200, 1000, 10))
    for task in ("scs_st", "scs_ga", "scs_il", "scs_st_informed", "scs_ga_informed", "scs_il_informed"):
        for method in (*QUALITY, *RANDOM_EMBEDDINGS):
            runs(task, method, 10, (200, 1000, 10), optimum=6.0)
    for digit in range(10):
        for task in (f"digits_{digit}", f"digits_{digit}_informed"):
            for method in ("hdsafebo", "hdsafebo_local", "scbo", "config", "cei", "cmaes", "sobol"):
                runs(task, method, 3, (20, 200, 1))
    write_inputs(root, rng)


def write_inputs(root: Path, rng: np.random.Generator) -> None:
    """Everything besides run files."""
    check = {
        "distance_correlation": 0.97,
        "gp_mean_difference": 1.3,
        "gp_variance_difference": 3.0,
        "round_trip": 0.5,
    }
    worse = check | {"distance_correlation": 0.89, "gp_mean_difference": 2.2, "gp_variance_difference": 4.6}
    for name in ("reports", "models/synergies", "data/rollouts", "data/spinal"):
        (root / name).mkdir(parents=True, exist_ok=True)
    (root / "reports/isometry.json").write_text(json.dumps({"irvae": check, "vae": worse, "residual": check}))
    x = rng.gamma(4, 1, 3000)
    pairs = {name: 2 * x + rng.normal(0, spread, 3000) for name, spread in (("irvae", 0.8), ("vae", 2.0))}
    pd.DataFrame({"original": x} | pairs).to_parquet(root / "reports/isometry_pairs.parquet")
    (root / "models/synergies/pca.json").write_text(
        json.dumps({"variance_accounted_for": (1 - 0.7 ** np.arange(1, 11)).tolist()})
    )
    steps = np.arange(0, 20_000, 120)
    curve = pd.DataFrame(
        {
            "setting": "full",
            "step": steps,
            "total_reward": rng.normal(-500 + steps / 30, 80),
            "dropped": False,
        }
    )
    curve.to_parquet(root / "data/rollouts/learning_curve.parquet")
    counts = rng.integers(0, 5000, 80).tolist()
    muscles = ("IL", "VL&RF", "TA", "BF&GM", "ST", "GA")
    stimulation = {
        "rows": 218_000,
        "threshold": 0.05,
        "safe_share": 0.5,
        "edges": np.linspace(-1, 1, 81).tolist(),
        "selectivity": {m: {"safe": counts, "unsafe": counts, "best_safe": 0.4} for m in muscles},
        "example": {"pixels": np.linspace(0, 1, 52 * 14).reshape(52, 14).tolist(), "title": "an example"},
    }
    (root / "data/spinal/selectivity.json").write_text(json.dumps(stimulation))
    _write_body(root)


def _write_body(root: Path) -> None:
    """Policies of the body beside a reflex, with pictures and a film."""
    folder = root / "data/body/policies"
    folder.mkdir(parents=True, exist_ok=True)
    policies = []
    for name, seconds in (("reflex", 2.0), ("hdsafebo_local", 5.0), ("cmaes_gains", 4.0)):
        outcome = {"seconds": [seconds] * 2, "loads": [50.0] * 2, "total": 40 * seconds, "failure": None}
        policies.append(
            {
                "method": name,
                "seed": 0,
                "trial": 7,
                "objective": 40 * seconds,
                "known": outcome,
                "unseen": outcome,
                "picture": f"{name}.png",
            }
        )
        (folder / f"{name}.png").write_bytes(b"\x89PNG " + name.encode())
    content = {"horizon_s": 5.0, "pushes": [1, 4], "unseen_pushes": [101, 102], "missing": None}
    (folder / "policies.json").write_text(json.dumps(content | {"policies": policies}))
    (folder / "best_beside_reflex.mp4").write_bytes(b"a film")
