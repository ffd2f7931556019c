"""YAML files that a user edits: plain data, of bounded size, with every key once.

PyYAML's safe loader constructs plain data only, but it takes the last of several equal keys in silence,
lets a few lines of aliases stand for more data than a machine can hold, and fails as it happens to on
values such as `!!bool maybe`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from hdsafebo.errors import HdSafeBOError

MAX_BYTES = 2**18
MAX_NODES = 100_000  # keys and values, each alias counted with all that it stands for
MAX_DEPTH = 50
MAX_INTEGER = 2**63 - 1
_MERGE = "tag:yaml.org,2002:merge"


def read_mapping(path: Path, error: type[HdSafeBOError]) -> dict[str, Any]:
    """The mapping that a YAML file holds.

    Args:
        path: the file.
        error: what is raised.

    Raises:
        HdSafeBOError: as `error`: the file is missing, too large, no YAML or no mapping, repeats a key, or
            holds a value that contains itself, is no Unicode text or is an integer of more than 64 bits.
            The message names the file, and the line where it is known.
    """
    try:
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise error(f"{path}: {size} bytes, expected at most {MAX_BYTES}")
        text = path.read_text(encoding="utf-8-sig")
    except OSError as fault:
        raise error(f"{path}: {fault.strerror or fault}") from None
    except UnicodeDecodeError as fault:
        raise error(f"{path}: cannot be read as YAML: no UTF-8 text at byte {fault.start}") from None
    try:
        data = _plain_data(text)
    except _Fault as fault:
        raise error(f"{path}, {fault}") from None
    except yaml.YAMLError as fault:
        raise error(f"{path}: cannot be read as YAML: {' '.join(str(fault).split())[:300]}") from None
    except RecursionError:
        raise error(f"{path}: nested more than {MAX_DEPTH} levels deep") from None
    if not isinstance(data, dict):
        raise error(f"{path}: expected a mapping of keys to values, got {type(data).__name__}")
    return data


class _Fault(Exception):
    """What is wrong with a node of well-formed YAML; `key` is that of the mapping that holds the node."""

    def __init__(self, node: yaml.Node, what: str, key: str | None) -> None:
        place = f"line {node.start_mark.line + 1}"
        super().__init__(f"{place}: {what}" if key is None else f"{place}, key {key[:80]!r}: {what}")


def _plain_data(text: str) -> Any:
    loader = yaml.SafeLoader(text)
    try:
        node = loader.get_single_node()
        if node is None:
            return None
        _check(node, None, loader, {}, set())
        return loader.construct_document(node)
    finally:
        loader.dispose()


def _check(
    node: yaml.Node,
    key: str | None,
    loader: yaml.SafeLoader,
    sizes: dict[yaml.Node, int],
    within: set[yaml.Node],
) -> int:
    """Number of keys and values that a node stands for, aliases written out.

    Args:
        node: it.
        key: under which it stands; None at the top.
        loader: constructs scalars.
        sizes: of the nodes that were checked before; an alias is the node that it stands for.
        within: the nodes that contain this one.
    """
    if node in within:
        raise _Fault(node, "a value that contains itself", key)
    if len(within) > MAX_DEPTH:
        raise _Fault(node, f"nested more than {MAX_DEPTH} levels deep", key)
    if node in sizes:
        return sizes[node]
    within.add(node)
    size = 1
    for name, part in _parts(node, key, loader):
        size += _check(part, name, loader, sizes, within)
        if size > MAX_NODES:
            raise _Fault(node, f"more than {MAX_NODES} keys and values, expected fewer", key)
    within.remove(node)
    sizes[node] = size
    return size


def _parts(node: yaml.Node, key: str | None, loader: yaml.SafeLoader) -> list[tuple[str | None, yaml.Node]]:
    """Keys and values of a mapping, items of a sequence, nothing of a scalar, each with its own key."""
    if isinstance(node, yaml.SequenceNode):
        return [(key, item) for item in node.value]
    if not isinstance(node, yaml.MappingNode):
        _check_scalar(node, key, loader)
        return []
    seen: set[str] = set()
    for name, _ in node.value:
        if not isinstance(name, yaml.ScalarNode):
            raise _Fault(name, "a list or mapping in the place of a key", key)
        if name.value in seen:
            raise _Fault(name, f"the key {name.value[:80]!r} appears twice", key)
        seen.add(name.value)
    return [(name.value, part) for name, value in node.value for part in (name, value)]


def _check_scalar(node: yaml.Node, key: str | None, loader: yaml.SafeLoader) -> None:
    if node.tag == _MERGE:
        return
    kind = node.tag.rpartition(":")[2]
    try:
        value = loader.construct_object(node)
        if isinstance(value, str):
            value.encode("utf-8")
    except UnicodeEncodeError:
        raise _Fault(node, f"{node.value[:80]!r} is no valid text", key) from None
    except (ValueError, KeyError, AttributeError):  # constructors of tagged values fail as they happen to
        raise _Fault(node, f"{node.value[:80]!r} is no {kind}", key) from None
    if isinstance(value, int) and abs(value) > MAX_INTEGER:
        raise _Fault(node, f"the integer {node.value[:80]} is beyond {MAX_INTEGER} in size", key)
