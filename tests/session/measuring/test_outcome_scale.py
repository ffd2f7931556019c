"""The scale on which outcomes are modelled."""

from __future__ import annotations

import numpy as np
import pytest

from hdsafebo.session.measuring.outcome_scale import LogScale, OutcomeScale


@pytest.mark.parametrize("scale", [OutcomeScale(), LogScale(0.02)])
def test_shown_undoes_modelled_to_first_order(scale: OutcomeScale) -> None:
    outcome = np.array([0.0, 0.05, 0.3])
    mean = scale.modelled(outcome)
    value, deviation = scale.shown(mean, np.full(3, 1e-6))
    np.testing.assert_allclose(value, outcome, atol=1e-15)
    higher, _ = scale.shown(mean + 1e-6, np.zeros(3))
    np.testing.assert_allclose(higher - value, deviation, rtol=1e-5)


def test_gains_add_on_the_logarithmic_scale() -> None:
    outcome = np.array([0.1, 0.4])
    added = LogScale(1e-9).modelled(1.2 * outcome) - LogScale(1e-9).modelled(outcome)
    np.testing.assert_allclose(added, np.log(1.2))
