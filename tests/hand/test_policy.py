"""Linear policies: shapes, the two spaces, and bad input."""

from __future__ import annotations

import numpy as np
import pytest

from hdsafebo.errors import HandModelError
from hdsafebo.hand.policy import LinearPolicySpace


@pytest.fixture
def synergies() -> LinearPolicySpace:
    rng = np.random.default_rng(0)
    basis = np.linalg.qr(rng.standard_normal((55, 5)))[0].T
    return LinearPolicySpace(rng.random(55), basis, 65)


def test_dimensions_are_those_of_the_paper(synergies: LinearPolicySpace) -> None:
    assert synergies.dimension == 325
    assert LinearPolicySpace.original(synergies.base, 65).dimension == 3575


def test_a_policy_over_synergies_is_the_same_in_the_original_space(synergies: LinearPolicySpace) -> None:
    rng = np.random.default_rng(1)
    original = LinearPolicySpace.original(synergies.base, 65)
    codes = rng.uniform(-3, 3, (4, 325))
    observation = rng.standard_normal(65)
    for code, policy in zip(codes, synergies.to_original(codes), strict=True):
        one = synergies.excitation(synergies.weights(code[None])[0], observation)
        other = original.excitation(original.weights(policy[None])[0], observation)
        np.testing.assert_allclose(one, other, atol=1e-12)
        assert one.min() >= 0
        assert one.max() <= 1


def test_the_zero_policy_is_the_base(synergies: LinearPolicySpace) -> None:
    zero = synergies.weights(np.zeros((1, 325)))[0]
    np.testing.assert_array_equal(synergies.excitation(zero, np.ones(65)), synergies.base)


def test_bad_policies_are_refused(synergies: LinearPolicySpace) -> None:
    with pytest.raises(HandModelError, match=r"shape \(2, 324\); expected \(n, 325\): 5 x 65 weights each"):
        synergies.weights(np.zeros((2, 324)))
    with pytest.raises(HandModelError, match="shape"):
        synergies.weights(np.zeros(325))
    broken = np.zeros((3, 325))
    broken[1, 5] = np.inf
    with pytest.raises(HandModelError, match=r"policies \[1\] have weights that are not finite"):
        synergies.weights(broken)
    with pytest.raises(HandModelError, match="do not fit"):
        LinearPolicySpace(np.zeros(55), np.zeros((5, 43)), 65)
    with pytest.raises(HandModelError, match="not finite"):
        LinearPolicySpace(np.full(3, np.nan), np.eye(3), 65)
