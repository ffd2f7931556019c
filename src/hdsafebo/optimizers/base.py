"""Ask and tell: what every optimiser shares.

A proposal travels from the unit cube to a code z and to an input x = decode(z). When only a finite set can be
evaluated it goes on to the nearest candidate and back to the code of that: models are told of, and safety is
predicted for, the point that will really be evaluated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from hdsafebo.errors import NoSafePointError, TrialError
from hdsafebo.optimizers.core.contexts import checked_context
from hdsafebo.optimizers.core.persistence import load_optimizer, save_optimizer
from hdsafebo.optimizers.core.proposal import Proposal, candidates_left, encode, realise
from hdsafebo.optimizers.core.results import (
    check_noise,
    check_points,
    check_results,
    check_rows,
    check_within,
    run_instead,
)
from hdsafebo.optimizers.core.transaction import all_or_nothing, one_at_a_time
from hdsafebo.optimizers.knowledge import Knowledge
from hdsafebo.optimizers.settings import OptimizerSettings
from hdsafebo.problem import Codec, Problem
from hdsafebo.trials import Trials
from hdsafebo.typing import IntArray

S = TypeVar("S", bound=OptimizerSettings)
_FEW_TRIALS = 8
"""Trials that tell whether kernel inputs are codes."""
_ATTEMPTS = 20
"""Proposals after which a method abstains when none of them is believed safe where it would be evaluated."""


class Optimizer(Knowledge[S]):
    """Proposes trials (`ask`) and learns from their results (`tell`).

    Several threads may use one optimiser: calls that change it wait for each other. A call that fails or is
    interrupted leaves it as it was.

    Args:
        problem: what is optimised; it is never evaluated from here.
        embedding: map between inputs and the codes that are searched; None searches the inputs themselves.
        seed: of the optimiser's random generator.
        bounds: (2, d) box of codes that is searched. None takes the limits of the codes of the initial trials
            (paper, appendix), or the problem's own bounds when there is no embedding.
        settings: an instance of the method's `Settings`; None takes the defaults, or the keywords.
        keywords: settings of the method by name, in place of `settings`.

    Attributes:
        name: name of the method.
        Settings: its settings.
        consults_model: the method has the settings of the Gaussian processes (`ModelSettings`), and says of
            each trial what they believe.
        uses_initial_data: False for methods that ask for initial trials of their own.
        uses: what a task gives and the method can use, as `problems.knowledge.Knowledge` names it.
        holds_contexts: True for methods that choose and judge points under the contexts of the moment: they
            pass what they choose from through `space.pinned`, or leave the context columns alone.
        searches_codes: False for methods that bring an embedding of their own: they leave embedding and
            bounds aside, and search the problem's box.
        settings: the checked settings.
        codec: the embedding that was handed in, whether the method searches its codes or not.
        rng: the only source of randomness.
        round: number of rounds asked so far.
        elsewhere: rows of the candidate set that are under evaluation elsewhere.

    Raises:
        ProblemError: the problem or the box is ill-posed.
        ParamsError: a setting is unknown, of the wrong type or out of range.
    """

    @all_or_nothing
    def ask(self, n: int = 1, *, pending: Trials | None = None, context: ArrayLike | None = None) -> Trials:
        """Propose trials.

        Args:
            n: how many.
            pending: trials under evaluation elsewhere, which this optimiser does not know: their candidate
                rows are not proposed. Its own trials without a result are never proposed again anyway.
            context: (c,) values of the problem's context columns, in which the trials will be run.

        Returns:
            At most n trials without results; fewer when the candidates run out, or when the method abstains
            from points that it does not believe safe.

        Raises:
            NoSafePointError: the method abstains altogether.
            TrialError: n is no positive whole number, every candidate has been proposed, or the context is
                missing, of another length or out of bounds.
            SurrogateError: no Gaussian process could be fitted.
        """
        if isinstance(n, bool) or not isinstance(n, (int, np.integer)) or n < 1:
            raise TrialError(f"n is {n!r}; expected a whole number of trials, at least 1")
        self.hold(checked_context(self.problem, context))
        self.elsewhere = np.empty(0, np.int64) if pending is None else pending.candidate
        if candidates_left(self.problem, self.taken) == 0:
            total = len(self.taken)
            raise TrialError(f"all {total} candidates of {self.problem.name!r} have been proposed or tried")
        trials = self._next_trials(int(n))
        self._ledger.append(trials)
        self.round += 1
        self._fits.use()
        return trials

    @all_or_nothing
    def tell(
        self,
        trials: Trials | Sequence[int] | IntArray,
        objective: ArrayLike,
        safety: ArrayLike,
        *,
        status: ArrayLike | None = None,
        x: ArrayLike | None = None,
        noise: ArrayLike | None = None,
    ) -> None:
        """Report results of asked trials: all or some of them, in any order.

        Telling the same result again changes nothing. Either everything in the call is taken in, or nothing.

        Args:
            trials: trials from `ask`, or their ids.
            objective: (n,) values.
            safety: (n, m) values, or (n,) when there is one safety function; or a table (DataFrame, mapping)
                with a column for each, which its name finds.
            status: (n,) `Status.COMPLETED` or `Status.FAILED`; values of failed trials are ignored. None
                means that all are completed.
            x: (n, D) inputs that were really run; None means those that were asked. What is on record of a
                trial, its predicted safety too, is then of what was run.
            noise: (n, 1 + m) known standard deviations of objective and safety values, NaN where unknown.

        Raises:
            TrialError: an unknown trial, a result that conflicts with an earlier one (which stays), a wrong
                shape, or a value that is no finite number.
        """
        ids = self._ledger.ids_of(trials)
        results = check_results(self.problem, len(ids), objective, safety, status)
        known = check_noise(self.problem, noise, len(ids))
        run = None if x is None else self._run_instead(ids, x)
        before = self._ledger.trials.status
        finished = self._ledger.record(ids, results, noise=known, run=run)
        if not np.array_equal(before, self._ledger.trials.status):
            self._fits.forget()
        for number in finished:
            self.finish_round(self._ledger.round(int(number)))

    @all_or_nothing
    def observe(
        self,
        x: ArrayLike,
        objective: ArrayLike,
        safety: ArrayLike,
        *,
        status: ArrayLike | None = None,
        candidate: ArrayLike | None = None,
        codes: ArrayLike | None = None,
        noise: ArrayLike | None = None,
        initial: bool = False,
    ) -> Trials:
        """Take in results of inputs not proposed here (initial data, trials set by hand), as of round 0.

        Args:
            x: (n, D) inputs.
            objective: (n,) values.
            safety: as in `tell`.
            status: as in `tell`.
            candidate: (n,) rows of the finite candidate set, -1 for inputs not in it; None means no row.
            codes: (n, d) codes that the inputs were decoded from; rows of NaN, and None, are encoded.
            noise: (n, 1 + m) known standard deviations of objective and safety values, NaN where unknown.
            initial: the data was there before the first `ask`.

        Raises:
            TrialError: a wrong shape, a value that is no finite number, a point outside the bounds, or a row
                that does not exist or is of another input.
        """
        points = check_points("x", x, self.problem.bounds.shape[1])
        check_within(self.problem, points)
        results = check_results(self.problem, len(points), objective, safety, status)
        trials = Trials.pending(
            points,
            encode(self.embedding, points, codes),
            len(self.problem.safety),
            first_id=len(self._ledger),
            candidate=check_rows(self.problem, candidate, points),
            initial=np.full(len(points), initial),
            objective=results.objective,
            safety=results.safety,
            status=results.status,
            noise=check_noise(self.problem, noise, len(points)),
        )
        self._ledger.append(trials)
        self._fits.forget()
        return trials

    # --- model, save and load

    @property
    def model(self) -> Any:
        """The surrogate as a BoTorch `ModelListGP`: objective first, then each modelled safety function.

        Its inputs are codes z (kernel inputs, for methods with kernel inputs of their own); its outputs have
        the units of the outcomes, after each safety function's transform.
        """
        from hdsafebo.optimizers.export.botorch_model import to_botorch

        return to_botorch(self.surrogate, self.space if self._kernel_measures_codes() else None)

    def _kernel_measures_codes(self) -> bool:
        """Whether kernel inputs are the codes in the space's own metric."""
        if len(self.trials) == 0:
            return False
        some = self.trials[:_FEW_TRIALS]
        inputs, plain = self.kernel_inputs(some), self.space.kernel_inputs(self.space.to_unit(some.z))
        return inputs.shape == plain.shape and np.array_equal(inputs, plain)

    @one_at_a_time
    def save(self, path: str | Path) -> None:
        """Write the whole state to one file, atomically; what `load` returns goes on as this optimiser would.

        Raises:
            StateFileError: the file cannot be written.
        """
        save_optimizer(self, Path(path))

    @classmethod
    def load(cls, path: str | Path, problem: Problem, embedding: Codec | None = None) -> Self:
        """The optimiser of this method that was saved to `path`.

        Raises:
            StateFileError: the file is missing, damaged, or belongs to another method, problem or embedding.
        """
        return load_optimizer(cls, Path(path), problem, embedding)

    # --- from a proposal to trials

    def _next_trials(self, n: int) -> Trials:
        """Trials of a proposal, each believed safe where it will be evaluated, or marked, or left out.

        A proposal may have been moved since the method judged it: to the nearest candidate, or to where an
        embedding permits.
        """
        for _ in range(_ATTEMPTS):
            left = candidates_left(self.problem, self.taken)
            if left == 0:
                break
            trials = self._realised(self.propose(min(n, left)))
            broken = ~trials.marked_unsafe & ~self.keeps_promise(trials)
            if not self._abstains:
                return replace(trials, marked_unsafe=trials.marked_unsafe | broken)
            if not broken.all():
                kept = trials[~broken]
                return replace(kept, id=len(self._ledger) + np.arange(len(kept)))
            self.elsewhere = np.concatenate([self.elsewhere, trials.candidate])
        raise NoSafePointError(
            f"{self.name} believes nothing safe where it would be evaluated; report more trials near a safe "
            "one, choose a larger beta (or a smaller alpha), or set empty_safe_set to 'mark'"
        )

    def _realised(self, proposal: Proposal) -> Trials:
        """The trials that a proposal stands for, with what is believed of them."""
        trials = realise(
            proposal,
            self.problem,
            self.embedding,
            self.space,
            taken=self.taken,
            first_id=len(self._ledger),
            round=self.round + 1,
        )
        probability, bound = self.believe(trials)
        return replace(trials, predicted_safe_probability=probability, violation_bound=bound)

    def _run_instead(self, ids: IntArray, x: ArrayLike) -> Trials:
        """The trials `ids` with the inputs that were really run, and what was believed of those."""
        asked = self.trials[ids]
        run = run_instead(self.problem, self.embedding, asked, x)
        other = (run.x != asked.x).any(axis=1)
        if not other.any() or not self.trials.completed.any():
            return run
        probability, bound = self.believe(run)
        return replace(
            run,
            predicted_safe_probability=np.where(other, probability, asked.predicted_safe_probability),
            violation_bound=np.where(other, bound, asked.violation_bound),
        )
