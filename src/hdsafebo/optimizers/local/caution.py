"""Correction of beta where violations are more frequent than it promises.

What a Gaussian process believes is as good as its assumptions: where a safety function falls off a cliff that
no trial has met, whole batches are believed safe that are not. As in safe optimisation by online conformal
prediction (Zhang, Park and Simeone, IEEE J. Sel. Top. Signal Process. 2024, arXiv:2306.17815), the outcomes
correct it: each violation makes the safe set smaller and each safe trial a little larger, so that the
share of violations tends to the promised one whatever the safety function is. Here the set never becomes
larger than the posterior with the given beta says.
"""

from __future__ import annotations

from dataclasses import dataclass

from hdsafebo.gp.safe_set import alpha_of

_CREDIT = 1.0
"""Violations that safe trials can earn in advance; with one, what beta promises changes nothing."""


@dataclass(frozen=True)
class Caution:
    """Where the correction stands.

    Attributes:
        excess: violations so far beyond the promised number, at least -1.
    """

    excess: float = 0.0

    def after(self, violations: int, trials: int, beta: float) -> Caution:
        """The correction after `violations` in so many `trials` that `beta` promised to be safe."""
        promised = (1.0 - alpha_of(beta)) * trials
        return Caution(max(self.excess + violations - promised, -_CREDIT))

    def corrected(self, beta: float, rate: float) -> float:
        """Beta, less `rate` for each violation in excess."""
        return beta - rate * max(self.excess, 0.0)
