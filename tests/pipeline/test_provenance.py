"""Digests of code: what computes counts, words do not."""

from __future__ import annotations

from pathlib import Path

import pytest

from hdsafebo.pipeline.provenance import digest_code, digest_paths

CODE = '''"""A module."""

import math  # of the standard library

LIMIT = 3
"""The largest."""


def f(x):
    """Twice x."""
    values = [
        x,  # once
        # and again
        x,
    ]
    text = "# no comment"
    return f"{sum(values)} {math.pi:.3f} {text}"
'''


def digest(folder: Path, source: str) -> str:
    path = folder / "module.py"
    path.write_text(source, encoding="utf-8")
    return digest_code(path)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('"""A module."""', '"""Another text,\n\nlonger."""'),
        ('"""A module."""\n', ""),
        ("  # of the standard library", ""),
        ('"""The largest."""\n', ""),
        ("    values", "    # a list\n\n    values"),
        ("  # once", "  # the first \u2028 one"),
        ("# and again", "# and once more"),
        ('"""Twice x."""', '"""Two times x."""'),
    ],
)
def test_words_do_not_count(tmp_path: Path, old: str, new: str) -> None:
    assert old in CODE
    assert digest(tmp_path, CODE.replace(old, new)) == digest(tmp_path, CODE)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("LIMIT = 3", "LIMIT = 4"),
        ("# no comment", "# a comment"),
        ("{math.pi:.3f}", "{math.pi:.4f}"),
        ("        x,\n    ]", "    ]"),
        ("    return", "return"),
        ("import math", "import math as m"),
        ('text = "', 'text = r"'),
    ],
)
def test_code_counts(tmp_path: Path, old: str, new: str) -> None:
    assert old in CODE
    assert digest(tmp_path, CODE.replace(old, new)) != digest(tmp_path, CODE)


def test_what_is_no_python_is_named(tmp_path: Path) -> None:
    with pytest.raises(SyntaxError, match=r"module\.py"):
        digest(tmp_path, "x = (1,\n")


def test_every_module_has_a_digest_and_other_files_are_whole(project_root: Path, tmp_path: Path) -> None:
    modules = sorted((project_root / "src").rglob("*.py"))
    texts = {path: path.read_text(encoding="utf-8") for path in modules}
    longer = {path: digest(tmp_path, f"# first\n{text}# last\n") for path, text in texts.items()}
    assert {path: digest_code(path) for path in modules} == longer
    table = tmp_path / "table.csv"
    table.write_text("# a\n1\n")
    before = digest_paths([table], tmp_path)
    table.write_text("# b\n1\n")
    assert digest_paths([table], tmp_path) != before
