"""Fits are counted when a round is asked with them, and by nothing else."""

from hdsafebo.optimizers.core.fits import FitCounts
from hdsafebo.optimizers.hdsafebo import HdSafeBO
from optimizers.toy import bowl, bowl_problem, observe_initial


def test_asking_counts_a_fit_of_each_function() -> None:
    made = HdSafeBO(bowl_problem(), seed=0, candidates=64)
    observe_initial(made)
    assert made.fit_counts == FitCounts()
    for rounds in (1, 2, 3):
        before = made.fit_counts
        assert made.surrogate.objective.hyper.fits == rounds
        assert made.fit_counts == before, "reading a model is no fit"
        trials = made.ask(2)
        assert made.fit_counts == FitCounts(fits=2 * rounds)
        made.tell(trials, *bowl(trials.x))
        assert made.fit_counts == FitCounts(fits=2 * rounds)
