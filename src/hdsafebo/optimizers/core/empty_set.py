"""What to propose when fewer points are believed safe than trials were asked for."""

from __future__ import annotations

import numpy as np

from hdsafebo.errors import NoSafePointError
from hdsafebo.gp.surrogate import Beliefs
from hdsafebo.optimizers.settings import EmptySafeSet
from hdsafebo.typing import FloatArray, IntArray


def complete_batch(
    chosen: IntArray, n: int, inputs: FloatArray, surrogate: Beliefs, policy: EmptySafeSet
) -> IntArray:
    """Rows for a batch of n: those chosen from the safe set, and what the policy adds to them.

    Args:
        chosen: rows that were chosen from the safe set, which holds no others when they are fewer than n.
        n: size of the batch.
        inputs: (k, p) kernel inputs of all candidates.
        surrogate: what is believed of them.
        policy: "mark" adds the most probably safe of the other candidates; "abstain" adds none.

    Raises:
        NoSafePointError: nothing was chosen and the policy is "abstain".
    """
    missing = n - len(chosen)
    if missing <= 0:
        return chosen
    if policy == "abstain":
        if len(chosen) == 0:
            raise NoSafePointError(
                f"none of {len(inputs)} candidates is believed safe; report more trials near a safe one, "
                "choose a larger beta (or a smaller alpha), or set empty_safe_set to 'mark', which proposes "
                "the most probably safe ones and marks them"
            )
        return chosen
    others = np.setdiff1d(np.arange(len(inputs)), chosen)
    ranked = others[np.argsort(-surrogate.safe_probability(inputs[others]), kind="stable")]
    return np.concatenate([chosen, ranked[:missing]])
