"""The enumeration of the contact configurations."""

from __future__ import annotations

from collections import Counter

import numpy as np

from hdsafebo.spinal.configurations import current_shares, enumerate_configurations


def test_the_papers_numbers() -> None:
    polarity = enumerate_configurations()
    assert polarity.shape == (21_800, 16)
    assert polarity.dtype == np.int8
    assert len(np.unique(polarity, axis=0)) == 21_800
    pattern = Counter(
        zip((polarity < 0).sum(axis=1).tolist(), (polarity > 0).sum(axis=1).tolist(), strict=True)
    )
    assert pattern == {
        (1, 1): 16 * 15,
        (1, 2): 16 * 105,
        (1, 3): 16 * 455,
        (2, 1): 120 * 14,
        (2, 2): 120 * 91,
    }


def test_currents_balance_and_split_evenly() -> None:
    polarity = enumerate_configurations()
    shares = current_shares(polarity)
    np.testing.assert_allclose(shares.sum(axis=1), 0.0, atol=1e-12)
    np.testing.assert_allclose(np.abs(shares).sum(axis=1), 2.0)
    assert np.array_equal(np.sign(shares), polarity)
    row = polarity[-1]
    assert set(shares[-1][row < 0]) == {-0.5}
    assert set(shares[-1][row > 0]) == {0.5}
