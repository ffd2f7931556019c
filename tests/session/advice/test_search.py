"""What an optimiser is told of the inputs of a session."""

from __future__ import annotations

import numpy as np
import pytest

from hdsafebo.optimizers.core.proposal import Proposal, realise
from hdsafebo.search.space import SearchSpace
from hdsafebo.session.advice.informed import informed_optimizer
from hdsafebo.session.advice.search import BoxSearch
from hdsafebo.session.definition import parse_definition
from hdsafebo.session.log.state import LoggedTrial
from hdsafebo.session.spaces.generic import GenericSpace
from tests.session.small import bowl, box_definition


class Lossy:
    """Codes are half the inputs, and the encoder does not undo the decoder, as that of an autoencoder."""

    def encode(self, x: np.ndarray, /) -> np.ndarray:
        return 0.45 * x

    def decode(self, z: np.ndarray, /) -> np.ndarray:
        return 2.0 * z


@pytest.mark.parametrize("embedding", [None, Lossy()])
def test_a_proposal_that_is_moved_within_reach_is_believed_where_it_will_be(embedding: Lossy | None) -> None:
    search = BoxSearch(GenericSpace(parse_definition(box_definition())), embedding)  # type: ignore[arg-type]
    search.restrict({"values": [0.5, 0.5, 0.0]})
    assert search.embedding is not None
    z = search.embedding.encode(np.array([[0.6, 0.5, 0.1], [1.0, 0.5, 0.1]]))
    space = SearchSpace(np.array([[-2.0] * 3, [2.0] * 3]), isotropic=True)
    made = realise(
        Proposal(points=space.to_unit(z)),
        search.problem("speed"),
        search.embedding,
        space,
        taken=np.empty(0, int),
        first_id=0,
        round=1,
    )
    np.testing.assert_allclose(made.x[1, 0], 0.8)  # out of reach: the largest step is 0.3
    np.testing.assert_array_equal(made.z[1], search.embedding.encode(made.x[1:])[0])
    np.testing.assert_allclose(made.z[0], z[0])  # within reach: the code that was decoded


def test_searched_codes_go_along_to_the_next_target() -> None:
    definition = parse_definition(box_definition())
    search = BoxSearch(GenericSpace(definition), Lossy())  # type: ignore[arg-type]
    trials = [done(i, [0.4 + 0.02 * i, 0.5, 0.1 * (i % 3)]) for i in range(8)]
    first = informed_optimizer(definition, search, "speed", 0, trials)
    asked = first.ask(1)
    first.tell(asked, [1.0], [[0.1]])
    trials.append(done(8, asked.x[0].tolist()))
    second = informed_optimizer(definition, search, "economy", 0, trials, before=first)
    np.testing.assert_array_equal(second.trials.z, first.trials.z)
    assert not np.allclose(second.trials.z[8], 0.45 * asked.x[0])
    np.testing.assert_array_equal(second.trials.z[:8], 0.45 * second.trials.x[:8])


def done(number: int, values: list[float]) -> LoggedTrial:
    """A trial of the bowl with a record."""
    found = bowl(values)
    return LoggedTrial(
        number=number,
        point={"values": values},
        origin="initial",
        status="completed",
        outcomes={name: found[name] for name in ("speed", "economy")},
        safety={"margin": found["margin"]},
    )
