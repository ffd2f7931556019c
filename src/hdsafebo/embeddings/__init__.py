"""Embeddings between the input space and the latent space that is searched.

`make_embedding(name, **settings)` makes one, `.fit(x, rng=...)` learns it, `.encode` and `.decode` map back
and forth, `.save(path)` and `load_embedding(path)` keep it as numbers and a card.
"""

from hdsafebo.embeddings.base import Embedding, Source
from hdsafebo.embeddings.registry import embedding_names, load_embedding, make_embedding

__all__ = ["Embedding", "Source", "embedding_names", "load_embedding", "make_embedding"]
