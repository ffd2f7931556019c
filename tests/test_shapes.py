"""The check of shapes itself: it is on while tests run, and off for those who use the package."""

import subprocess
import sys

import numpy as np
import pytest
from jaxtyping import TypeCheckError

from hdsafebo.gp.kernel import exact_distances, matern52
from hdsafebo.gp.safe_set import safe_probabilities
from hdsafebo.search.space import SearchSpace


def test_arrays_of_other_shapes_are_refused() -> None:
    with pytest.raises(TypeCheckError):
        exact_distances(np.zeros((3, 2)), np.zeros((3, 4)))
    with pytest.raises(TypeCheckError):
        safe_probabilities(np.zeros((3, 2)), np.ones((3, 2)), np.zeros(3))
    with pytest.raises(TypeCheckError):
        matern52(np.zeros((3, 2), np.int64), 1.0)
    with pytest.raises(TypeCheckError):
        SearchSpace(np.array([[0.0], [1.0]]), isotropic=True).to_unit(np.zeros(3))


def test_users_import_no_checker() -> None:
    code = (
        "import sys, hdsafebo.search.metric, hdsafebo.gp.surrogate;"
        "print([m for m in ('jaxtyping', 'beartype') if m in sys.modules])"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"
