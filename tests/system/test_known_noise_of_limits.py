"""Known noise of a limit is in what is promised, whatever the kind of the system and the method."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.special import ndtr

from hdsafebo import Choice, Integer, Limit, Real, Study
from hdsafebo.errors import NoSafePointError
from system.small import box_system, run_box

NOISE = 1.5
_AB = (Real("a", 0, 10), Real("b", 0, 10))
_ROWS = pd.DataFrame(np.random.default_rng(5).uniform(0, 10, (80, 2)).round(2), columns=["a", "b"])
KINDS: dict[str, dict[str, Any]] = {
    "box": {},
    "steps": {"parameters": [Real("a", 0, 10, step=0.01), _AB[1]]},
    "integer": {"parameters": [*_AB, Integer("pulses", 1, 4)]},
    "choice": {"parameters": [*_AB, Choice("pad", ["soft", "hard"])]},
    "constraint": {"constraints": ["a + 2*b <= 25"]},
    "context": {"contexts": [Real("wind", 0, 1)]},
    "list": {"settings": _ROWS},
    "list in a context": {"settings": _ROWS, "contexts": [Real("wind", 0, 1)]},
}


def study_of(kind: str, method: str, per_trial: bool) -> tuple[Study, dict[str, float]]:
    """A study that knows the noise of its limit, with 15 careful trials; and the context of the next one."""
    noise = None if per_trial else NOISE
    study = Study(
        box_system(limits=[Limit("load", at_most=12, noise=noise)], **KINDS[kind]), method=method, alpha=0.9
    )
    rng = np.random.default_rng(2)
    careful = _ROWS[_ROWS.sum(axis=1) < 8].head(15).to_dict("records")
    context = {"wind": 0.5} if "context" in kind else {}
    rows = []
    for i, setting in enumerate(careful):
        other = {"integer": {"pulses": 1 + i % 4}, "choice": {"pad": "soft"}}.get(kind, {})
        results = run_box(setting)
        results["load"] += NOISE * rng.standard_normal()
        rows.append(setting | other | context | results | ({"load_noise": NOISE} if per_trial else {}))
    study.observe(rows)
    return study, context


@pytest.mark.parametrize("per_trial", [False, True], ids=["of the limit", "of each trial"])
@pytest.mark.parametrize(
    ("kind", "method"),
    [(kind, "hdsafebo_local") for kind in KINDS] + [("box", m) for m in ("hdsafebo", "linebo", "cei")],
)
def test_a_measurement_is_promised_not_the_function(kind: str, method: str, per_trial: bool) -> None:
    study, context = study_of(kind, method, per_trial)
    settings = _ROWS.assign(
        **({"pulses": 2} if kind == "integer" else {"pad": "soft"} if kind == "choice" else {})
    )
    predicted = study.predict(settings, context=context or None)
    assert (predicted["load_sd"] >= 0.999 * NOISE).all(), "no measurement is more certain than its noise"
    below = predicted[predicted["load"] < 12]
    assert len(below) >= 10
    assert (below["load_safe"] <= ndtr((12 - below["load"]) / NOISE) + 1e-3).all()
    np.testing.assert_allclose(predicted["safe_probability"], predicted["load_safe"])
    try:
        suggestion = study.ask(context=context or None)
    except NoSafePointError:
        return  # with this noise nothing needs to be
    of_it = study.predict(suggestion.setting, context=context or None)
    assert suggestion.safe_probability == pytest.approx(of_it["safe_probability"][0], abs=1e-6)
