"""YAML files that a user edits: plain data, of bounded size, with every key once.

They are read as YAML 1.2 by the library that DVC uses too, so that a value which `dvc exp run -S` writes is
read as DVC meant it: 1e-05 is a number, `no` is text. Its safe loader constructs plain data only, but a few
lines of aliases may stand for more data than a machine can hold, and values such as `!!bool maybe` end in
whatever error they happen to cause.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast

from ruamel.yaml import YAML
from ruamel.yaml.constructor import ConstructorError, SafeConstructor
from ruamel.yaml.error import YAMLError
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from hdsafebo.errors import HdSafeBOError
from hdsafebo.files.atomic import replacing
from hdsafebo.files.bounded import read_bounded

MAX_BYTES = 2**18
MAX_NODES = 100_000  # keys and values, with aliases written out
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
    content = read_bounded(path, MAX_BYTES, error)
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as fault:
        raise error(f"{path}: cannot be read as YAML: no UTF-8 text at byte {fault.start}") from None
    return parse_mapping(text, str(path), error)


def parse_mapping(text: str, source: str, error: type[HdSafeBOError]) -> dict[str, Any]:
    """The mapping that YAML text holds; see `read_mapping`.

    Args:
        text: the YAML.
        source: the file, for messages.
        error: what is raised.

    Raises:
        HdSafeBOError: as `error`.
    """
    try:
        data = _plain_data(text)
    except _Fault as fault:
        raise error(f"{source}, {fault}") from None
    except YAMLError as fault:
        raise error(f"{source}: cannot be read as YAML: {' '.join(str(fault).split())[:300]}") from None
    except RecursionError:
        raise error(f"{source}: nested more than {MAX_DEPTH} levels deep") from None
    if not isinstance(data, dict):
        raise error(f"{source}: expected a mapping of keys to values, got {type(data).__name__}")
    return data


def write_mapping(path: Path, data: dict[str, Any], error: type[HdSafeBOError]) -> None:
    """Write plain data as YAML, its keys in their order.

    Raises:
        HdSafeBOError: as `error`: the file cannot be written.
    """
    yaml = YAML(typ="safe", pure=True)
    yaml.default_flow_style = False
    yaml.sort_base_mapping_type_on_output = cast(Any, False)  # its only type in ruamel is None
    with replacing(path, error) as temporary, temporary.open("w", encoding="utf-8") as file:
        yaml.dump(data, file)


class _Fault(Exception):
    """What is wrong with a node of well-formed YAML; `key` is that of the mapping that holds the node."""

    def __init__(self, node: Node, what: str, key: str | None) -> None:
        place = f"line {node.start_mark.line + 1}"
        super().__init__(f"{place}: {what}" if key is None else f"{place}, key {key[:80]!r}: {what}")


def _plain_data(text: str) -> Any:
    constructor, parser = YAML(typ="safe", pure=True).get_constructor_parser(text)
    try:
        try:
            node = constructor.composer.get_single_node()
        except (AttributeError, LookupError, TypeError, ValueError) as fault:
            # ruamel's scanner ends so on some malformed texts, such as a directive within a document.
            raise YAMLError(f"malformed ({type(fault).__name__} while reading)") from None
        if node is None:
            return None
        _check(node, None, constructor, {}, set())
        return constructor.construct_document(node)
    finally:
        parser.dispose()


def _check(
    node: Node,
    key: str | None,
    constructor: SafeConstructor,
    sizes: dict[Node, int],
    within: set[Node],
) -> int:
    """Number of keys and values that a node stands for, aliases written out.

    Args:
        node: the node.
        key: under which the node stands; None at the top.
        constructor: of scalars.
        sizes: of the nodes that were checked before; an alias is the very node that was anchored.
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
    for name, part in _parts(node, key, constructor):
        size += _check(part, name, constructor, sizes, within)
        if size > MAX_NODES:
            raise _Fault(node, f"more than {MAX_NODES} keys and values, expected fewer", key)
    within.remove(node)
    sizes[node] = size
    return size


def _parts(node: Node, key: str | None, constructor: SafeConstructor) -> list[tuple[str | None, Node]]:
    """Keys and values of a mapping, items of a sequence, nothing of a scalar, each with its own key."""
    if isinstance(node, SequenceNode):
        return [(key, item) for item in node.value]
    if not isinstance(node, MappingNode):
        _check_scalar(node, key, constructor)
        return []
    seen: set[str] = set()
    for name, _ in node.value:
        if not isinstance(name, ScalarNode):
            raise _Fault(name, "a list or mapping in the place of a key", key)
        if name.value in seen:
            raise _Fault(name, f"the key {name.value[:80]!r} appears twice", key)
        seen.add(name.value)
    return [(name.value, part) for name, value in node.value for part in (name, value)]


def _check_scalar(node: Node, key: str | None, constructor: SafeConstructor) -> None:
    if node.tag == _MERGE:
        return
    kind = str(node.tag).rpartition(":")[2]
    try:
        value = constructor.construct_object(node)
        if isinstance(value, str):
            value.encode("utf-8")
    except UnicodeEncodeError:
        raise _Fault(node, f"{node.value[:80]!r} is no valid text", key) from None
    except (ValueError, KeyError, AttributeError, ConstructorError) as fault:
        if node.tag not in constructor.yaml_constructors:  # no constructor for the tag, which `fault` says
            raise
        # A constructor for the tag fails with whatever error it happens to cause.
        raise _Fault(node, f"{node.value[:80]!r} is no {kind}", key) from fault
    if isinstance(value, int) and abs(value) > MAX_INTEGER:
        raise _Fault(node, f"the integer {node.value[:80]} is beyond {MAX_INTEGER} in size", key)
