"""Which modules each stage, task and method uses, as text files that DVC compares.

DVC sees no imports. The stage `code` writes, for every stage script, every family of tasks and every method,
one file with the names and digests of the modules that it uses; the other stages depend on those few files.
A change of one module then reruns its users only, and the diff of a file names the module that changed. A
change of comments and docstrings alone reruns nothing.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from hdsafebo.embeddings.registry import embedding_modules
from hdsafebo.files.atomic import replacing
from hdsafebo.optimizers.registry import method_module
from hdsafebo.pipeline.imports import ImportGraph
from hdsafebo.pipeline.provenance import digest_code
from hdsafebo.problems.registry import family_names, task_module

CODE = "data/code"


def code_files(root: Path, algorithms: Mapping[str, str]) -> dict[str, set[Path]]:
    """Modules and scripts by the name of the code file that lists them, as in `methods/scbo`.

    Args:
        root: the project's directory, with `src` and `stages`.
        algorithms: what runs, by the name of the method's block in the parameters.

    Raises:
        SyntaxError: a file is no Python.
        UnknownNameError: an algorithm is unknown.
    """
    graph = ImportGraph(root / "src")
    roots = {
        f"stages/{script.stem}": script
        for script in sorted((root / "stages").glob("*.py"))
        if script.stem != "code"
    }
    roots |= {f"tasks/{name}": graph.file_of(task_module(name)) for name in family_names()}
    roots |= {
        f"methods/{name}": graph.file_of(method_module(algorithm)) for name, algorithm in algorithms.items()
    }
    return {name: modules_behind([path], graph) for name, path in roots.items()}


def modules_behind(roots: Iterable[Path], graph: ImportGraph) -> set[Path]:
    """The given files, all that they import, and what they may load by name.

    Whoever uses the registry of embeddings may load any embedding: which one, a file or a parameter decides.

    Args:
        roots: Python files.
        graph: of the package's imports.
    """
    found = set(roots) | graph.used_by(roots)
    if graph.file_of("hdsafebo.embeddings.registry") in found:
        classes = [graph.file_of(name) for name in embedding_modules()]
        found |= set(classes) | graph.used_by(classes)
    return found


def write_code_files(root: Path, algorithms: Mapping[str, str]) -> None:
    """Write `data/code/**.txt`, one line per module: digest and path, sorted by path; see `code_files`.

    Raises:
        WriteError: a file cannot be written.
    """
    digests: dict[Path, str] = {}
    for name, modules in code_files(root, algorithms).items():
        for path in modules - digests.keys():
            digests[path] = digest_code(path)
        lines = sorted((path.relative_to(root).as_posix(), digests[path]) for path in modules)
        with replacing(root / CODE / f"{name}.txt") as temporary:
            temporary.write_text("".join(f"{digest}  {path}\n" for path, digest in lines), encoding="utf-8")
