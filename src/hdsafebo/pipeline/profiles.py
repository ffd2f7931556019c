"""Profiles set the size of the pipeline: each is a set of changes to the standard parameters."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from hdsafebo.errors import ParamsError, UnknownNameError
from hdsafebo.files.atomic import replacing
from hdsafebo.files.bounded import read_bytes
from hdsafebo.files.yaml import parse_mapping, read_mapping
from hdsafebo.pipeline.checked_params import parse_checked_params

if TYPE_CHECKING:
    from ruamel.yaml import YAML

STANDARD = "standard"


def profile_names(root: Path) -> list[str]:
    """Names of the profiles in `profiles/`."""
    return sorted(path.stem for path in (root / "profiles").glob("*.yaml"))


def profile_text(root: Path, name: str) -> str:
    """The text of `params.yaml` under a profile: the standard one with the profile's changes, checked.

    Raises:
        UnknownNameError: no profile has that name; the message lists the names.
        ParamsError: a profile cannot be read, or the result is not valid.
    """
    import io

    from ruamel.yaml import YAML

    if name not in profile_names(root):
        raise UnknownNameError("profile", name, profile_names(root))
    yaml = YAML()
    yaml.width = 110
    yaml.preserve_quotes = True
    merged = _with_comments(yaml, root / "profiles" / f"{STANDARD}.yaml")
    if name != STANDARD:
        _merge(merged, _with_comments(yaml, root / "profiles" / f"{name}.yaml"))
    merged["profile"] = name
    buffer = io.StringIO()
    yaml.dump(merged, buffer)
    text = buffer.getvalue()
    source = f"profiles/{name}.yaml"
    parse_checked_params(parse_mapping(text, source, ParamsError), source=source)
    return text


def apply_profile(root: Path, name: str, *, force: bool = False) -> bool:
    """Write `params.yaml` under a profile.

    Args:
        root: the project's directory.
        name: the profile.
        force: overwrite a `params.yaml` that holds changes of its own.

    Returns:
        True when the file changed.

    Raises:
        ParamsError: `params.yaml` differs from every profile, so that changes would be lost.
        WriteError: `params.yaml` cannot be written, and is unchanged.
    """
    target = root / "params.yaml"
    text = profile_text(root, name)
    if target.is_file():
        present = read_bytes(target)
        if present == text.encode():
            return False
        if not force and all(present != profile_text(root, n).encode() for n in profile_names(root)):
            raise ParamsError(
                f"params.yaml was edited and matches none of the profiles {', '.join(profile_names(root))}; "
                f"keep a copy, then run: hdsafebo profile {name} --force"
            )
    with replacing(target) as temporary:
        temporary.write_bytes(text.encode())
    return True


def _with_comments(yaml: YAML, path: Path) -> Any:
    """A profile with its comments and formats, after a check that the file holds plain data only."""
    read_mapping(path, ParamsError)
    return yaml.load(read_bytes(path))


def _merge(base: Any, changes: Any) -> None:
    """Overwrite `base` in place, block by block, keeping its comments."""
    for key, value in changes.items():
        if isinstance(value, dict) and isinstance(base.get(key), dict) and key not in ("seeds_of",):
            _merge(base[key], value)
        else:
            base[key] = value
