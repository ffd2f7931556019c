"""Build the package and install it into clean environments: the core alone, and with each extra.

    python tools/check_package.py                 everything (`make package`)
    python tools/check_package.py core study      some of it
    python tools/check_package.py --python python3.13 core

Each environment gets the wheel, or the source archive in its turn, and nothing of this checkout. The core is
installed by pip, as README.md says; the extras by uv, which takes minutes for what takes pip an hour. In each
the modules of the extra are imported, the command line answers, and README.md's example runs in an empty
folder; it needs the core alone. Environments are removed afterwards.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
import tomllib
import venv
from pathlib import Path

ROOT = Path(__file__).parents[1]
IMPORTS = {
    "core": ["hdsafebo", "hdsafebo.system.study", "hdsafebo.session.session", "hdsafebo.cli"],
    "policies": ["hdsafebo.policies"],
    "hand": ["hdsafebo.hand.environment", "hdsafebo.bodies.environment"],
    "spinal": ["hdsafebo.spinal.lead_field"],
    "session": ["hdsafebo.session.web.app", "hdsafebo.session.measuring.edf_recording"],
    "lsl": ["hdsafebo.session.measuring.live"],
    "pipeline": ["hdsafebo.report.build", "hdsafebo.pipeline.tracking"],
    "cluster": ["hdsafebo.campaign.cluster", "distributed"],
    "study": ["hdsafebo.plots"],
    "optuna": ["hdsafebo.integrations.optuna_sampler"],
    "mlflow": ["hdsafebo.integrations.mlflow_callback"],
    "docs": ["zensical", "mkdocstrings"],
    "dev": ["pytest", "hypothesis"],
}
"""What must be importable with each extra, besides the core."""


def main() -> None:
    """Build, and try every wanted environment; stops at the first fault."""
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    if IMPORTS.keys() != {"core", *extras}:
        raise SystemExit(f"IMPORTS names {sorted(IMPORTS)}; pyproject.toml has core and {sorted(extras)}")
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("extras", nargs="*", help=f"of {', '.join(IMPORTS)} (default: all)")
    parser.add_argument("--python", default=sys.executable, help="interpreter of the environments")
    given = parser.parse_args()
    unknown = set(given.extras) - IMPORTS.keys()
    if unknown:
        parser.error(f"no extra {', '.join(sorted(unknown))}")
    with tempfile.TemporaryDirectory() as folder:
        archives = build(Path(folder))
        for number, extra in enumerate(given.extras or IMPORTS):
            try_extra(extra, archives[number % 2], given.python)


def build(folder: Path) -> list[Path]:
    """Wheel and source archive, from an environment of their own."""
    venv.create(folder / "builder", with_pip=True)
    python = folder / "builder/bin/python"
    run([python, "-m", "pip", "install", "--quiet", "build"])
    run([python, "-m", "build", "--outdir", folder / "dist", ROOT])
    (wheel,) = (folder / "dist").glob("*.whl")
    (archive,) = (folder / "dist").glob("*.tar.gz")
    return [wheel, archive]


def try_extra(extra: str, archive: Path, interpreter: str) -> None:
    """Install an archive with an extra, import what it is for, and run the example."""
    wanted = str(archive) if extra == "core" else f"{archive}[{extra}]"
    with tempfile.TemporaryDirectory() as folder:
        run([interpreter, "-m", "venv", f"{folder}/v"])
        python = Path(folder) / "v/bin/python"
        if extra == "core":
            run([python, "-m", "pip", "install", "--quiet", wanted])
        else:
            run([sys.executable, "-m", "uv", "pip", "install", "--quiet", "--python", python, wanted])
        modules = [*IMPORTS["core"], *(IMPORTS[extra] if extra != "core" else [])]
        run([python, "-W", "error::SyntaxWarning", "-c", f"import {', '.join(modules)}"], folder)
        said = run([python.with_name("hdsafebo"), "--version"], folder)
        if extra in ("core", "study"):
            run([python, "-c", example()], folder)
    print(f"{archive.name} with {extra}: {said.strip()}", flush=True)


def example() -> str:
    """The first example of README.md."""
    found = re.search(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.DOTALL)
    assert found is not None
    return found[1]


def run(command: list[object], folder: str | None = None) -> str:
    """Run a command outside this checkout; its output, or the end with what it said."""
    words = [str(word) for word in command]
    result = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)
    if result.returncode:
        raise SystemExit(f"{' '.join(words)[:200]}\n{result.stdout}\n{result.stderr}")
    return result.stdout


if __name__ == "__main__":
    main()
