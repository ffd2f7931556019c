"""YAML that a user hands in: bounded, plain, every key once, and a message for everything else."""

from __future__ import annotations

from pathlib import Path

import pytest

from hdsafebo.errors import ParamsError
from hdsafebo.files.yaml import MAX_BYTES, parse_mapping, read_mapping, write_mapping

LAUGHS = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{after}: &{after} [{', '.join([f'*{before}'] * 9)}]\n"
    for before, after in zip("abcdefgh", "bcdefghi", strict=True)
)
MERGED = "a: &a {x: 1}\n" + "".join(
    f"k{n}: &{after} {{<<: [*{before}, *{before}]}}\n"
    for n, (before, after) in enumerate(zip("abcdefghijklmnopqrs", "bcdefghijklmnopqrst", strict=True))
)
HOSTILE = {
    "a billion laughs": (LAUGHS, "line 6, key 'f': more than 100000 keys and values"),
    "merged laughs": (MERGED, "more than 100000 keys and values"),
    "itself": ("a: &x [*x]\n", "line 1, key 'a': a value that contains itself"),
    "twice the same key": ("a: 1\nb: 2\na: 3\n", "line 3: the key 'a' appears twice"),
    "twice the same inner key": ("b:\n  c: 1\n  c: 1\n", "line 3, key 'b': the key 'c' appears twice"),
    "a list as a key": ("? [a, b]\n: 1\n", "in the place of a key"),
    "a hexadecimal integer": ("a: 0x" + "f" * 6000, "is beyond 9223372036854775807"),
    "a long integer": ("a: 1" + "0" * 6000, "is no int"),
    "an integer of 65 bits": (f"a: -{2**64}", "is beyond 9223372036854775807"),
    "half a character": ('a: "\\ud800"', "is no valid text"),
    "half a character as a key": ('"\\ud800": 1', "is no valid text"),
    "no truth value": ("a: 1\nb: !!bool maybe\n", "line 2, key 'b': 'maybe' is no bool"),
    "no time": ("a: !!timestamp soon", "'soon' is no timestamp"),
    "no day": ("a: 2020-13-45", "'2020-13-45' is no timestamp"),
    "no number": ("a: !!float five", "'five' is no float"),
    "deep nesting": ("a: " + "[" * 1000 + "]" * 1000, "nested more than 50 levels deep"),
    "deep blocks": (
        "\n".join(" " * n + "a:" for n in range(60)),
        "line 51, key 'a': nested more than 50 levels deep",
    ),
    "a Python object": ("a: !!python/object/apply:os.system ['touch executed']", "constructor for the tag"),
    "a Python module": ("a: !!python/module:antigravity", "constructor for the tag"),
    "two documents": ("a: 1\n---\na: 2\n", "expected a single document"),
    "a control character": ("a: \x07", "special characters are not allowed"),
    "an open bracket": ("a: [1, 2\n", "cannot be read as YAML"),
    "a list": ("- a\n", "expected a mapping of keys to values, got list"),
    "nothing": ("# no more than a comment\n", "expected a mapping of keys to values, got NoneType"),
}


@pytest.mark.parametrize("case", HOSTILE)
def test_hostile_files_are_refused_by_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, case: str
) -> None:
    monkeypatch.chdir(tmp_path)
    text, message = HOSTILE[case]
    path = tmp_path / "edited.yaml"
    path.write_text(text)
    with pytest.raises(ParamsError, match=message) as caught:
        read_mapping(path, ParamsError)
    assert str(path) in str(caught.value)
    assert len(str(caught.value)) < 600
    assert not (tmp_path / "executed").exists()


def test_files_that_cannot_be_read_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ParamsError, match=r"none\.yaml: No such file or directory"):
        read_mapping(tmp_path / "none.yaml", ParamsError)
    with pytest.raises(ParamsError, match="is no regular file"):
        read_mapping(tmp_path, ParamsError)
    (tmp_path / "latin.yaml").write_bytes(b"a: \xe9")
    with pytest.raises(ParamsError, match="no UTF-8 text at byte 3"):
        read_mapping(tmp_path / "latin.yaml", ParamsError)
    with (tmp_path / "large.yaml").open("wb") as file:
        file.truncate(2**40)  # sparse: it takes no room, reading it would
    with pytest.raises(ParamsError, match=f"{2**40} bytes, expected at most {MAX_BYTES}"):
        read_mapping(tmp_path / "large.yaml", ParamsError)


def test_anchors_and_merged_keys_are_plain_data(tmp_path: Path) -> None:
    path = tmp_path / "edited.yaml"
    path.write_text("\ufeffbase: &base {a: 1, b: [2.5, x]}\nother:\n  <<: *base\n  a: 3\n", encoding="utf-8")
    assert read_mapping(path, ParamsError) == {
        "base": {"a": 1, "b": [2.5, "x"]},
        "other": {"a": 3, "b": [2.5, "x"]},
    }


def test_values_are_read_as_dvc_reads_them(tmp_path: Path) -> None:
    """`dvc exp run -S a=0.00001` writes 1e-05 into the file, which YAML 1.1 takes for text.

    DVC's parser in C differs in one thing, which it says: within brackets, 12:30 needs quotes.
    """
    from dvc.utils.serialize import load_yaml, modify_yaml

    path = tmp_path / "params.yaml"
    path.write_text("a: 1\nb: [no, on, 010, 0o14, .5, 1e3]\nc: 12:30\n")
    with modify_yaml(path) as data:
        data["a"] = 0.00001
    assert "1e-05" in path.read_text()
    assert read_mapping(path, ParamsError) == load_yaml(path)
    expected = {"a": 1e-05, "b": ["no", "on", 10, 12, 0.5, 1000.0], "c": "12:30"}
    assert read_mapping(path, ParamsError) == expected


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    data = {"b": {"x": 1e-05, "w": [1, 2.5, "no", None, True]}, "a": "1e3"}
    write_mapping(tmp_path / "a.yaml", data, ParamsError)
    again = read_mapping(tmp_path / "a.yaml", ParamsError)
    assert again == data
    assert list(again) == ["b", "a"], "keys keep their order"


@pytest.mark.parametrize(
    "text", ["a: 1\n%YAML 1.2\n", "a: 1\n%YAML 1.2\nb: 2\n", "%TAG\na: 1\n", "a: 1\n%FOO bar\n"]
)
def test_directives_in_the_midst_of_a_document_are_refused_or_read(text: str) -> None:
    """The parser ends with errors of other kinds on some of them; none may leave the reader."""
    message = ""
    try:
        data = parse_mapping(text, "file.yaml", ParamsError)
    except ParamsError as error:
        message = str(error)
    assert "file.yaml" in message or data["a"] == 1
