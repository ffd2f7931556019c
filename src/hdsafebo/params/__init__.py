"""`params.yaml` as frozen models: every key typed, every range checked, every error named."""

from hdsafebo.params.base import Block, Count, Positive, Scalar
from hdsafebo.params.embeddings import Digits, Embeddings, IsometryFloors, IsometryParams
from hdsafebo.params.hand import Hand
from hdsafebo.params.methods import MethodBlock, Space
from hdsafebo.params.model import Params
from hdsafebo.params.reading import load_params, parse_params
from hdsafebo.params.spinal import Spinal
from hdsafebo.params.tasks import BodyProblem, Budget, HandProblem, SyntheticParams

__all__ = [
    "Block",
    "BodyProblem",
    "Budget",
    "Count",
    "Digits",
    "Embeddings",
    "Hand",
    "HandProblem",
    "IsometryFloors",
    "IsometryParams",
    "MethodBlock",
    "Params",
    "Positive",
    "Scalar",
    "Space",
    "Spinal",
    "SyntheticParams",
    "load_params",
    "parse_params",
]
