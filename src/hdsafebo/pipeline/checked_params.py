"""Parameters whose names of methods and embeddings are known to exist, with settings that these take.

`params` knows no method; whoever has the registries asks here.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hdsafebo.embeddings.registry import embedding_class
from hdsafebo.errors import ParamsError, UnknownNameError
from hdsafebo.files.yaml import read_mapping
from hdsafebo.optimizers.registry import method_names
from hdsafebo.params import Params, parse_params


def load_checked_params(path: Path) -> Params:
    """Read a parameter file; see `params.load_params`, and `check_names` for what is checked beyond.

    Raises:
        ParamsError: the message names file, key, value and what was expected.
    """
    return parse_checked_params(read_mapping(path, ParamsError), source=str(path))


def parse_checked_params(data: dict[str, Any], *, source: str = "params") -> Params:
    """Check parameters that were already read; see `load_checked_params`."""
    params = parse_params(data, source=source)
    check_names(params, source)
    return params


def check_names(params: Params, source: str) -> None:
    """Refuse names that no registry has, and settings that an embedding does not take.

    Args:
        params: of the right form.
        source: file, for messages.

    Raises:
        ParamsError: the first unknown name or setting, with the valid ones.
    """
    known = method_names()
    for name, method in params.methods.items():
        if method.algorithm not in known:
            raise ParamsError(
                f"{source}: methods.{name}: unknown method {method.algorithm!r}; "
                f"valid names: {', '.join(sorted(known))}; a block of another name gives one of them "
                "as its algorithm, as in {algorithm: scbo, space: original}"
            )
    for name, settings in params.embeddings.models.items():
        try:
            embedding_class(name).check_settings(settings)
        except (ParamsError, UnknownNameError) as error:
            raise ParamsError(f"{source}: embeddings: models: {error}") from None
