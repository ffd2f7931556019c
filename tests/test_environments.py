"""`gymnasium.make` knows this package's environments after `import hdsafebo`, whichever import came first."""

from __future__ import annotations

import subprocess
import sys

import pytest

from hdsafebo.environments import ENVIRONMENTS


def output_of(code: str) -> str:
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return result.stdout.strip()


@pytest.mark.parametrize(
    "imports",
    [
        "import hdsafebo, gymnasium",
        "import gymnasium, hdsafebo",
        "import hdsafebo; from gymnasium import spec",
    ],
)
def test_registered_whichever_import_comes_first(imports: str) -> None:
    check = (
        "import gymnasium; from hdsafebo.environments import ENVIRONMENTS; "
        "print([gymnasium.spec(name).id for name in ENVIRONMENTS] == list(ENVIRONMENTS))"
    )
    assert output_of(f"{imports}; {check}") == "True"


IN_THE_MIDDLE = """
import sys


class Plugin:
    def find_spec(self, name, path, target=None):
        if name == {module!r} and "hdsafebo" not in sys.modules:
            import hdsafebo


sys.meta_path.insert(0, Plugin())
import gymnasium
"""


@pytest.mark.parametrize(
    "code",
    [
        IN_THE_MIDDLE.format(module="gymnasium.spaces"),
        IN_THE_MIDDLE.format(module="gymnasium.envs"),
        """
import gymnasium
from gymnasium.envs.registration import namespace
with namespace("plugin"):
    import hdsafebo
""",
        """
import hdsafebo, gymnasium, importlib
importlib.reload(gymnasium)
""",
    ],
    ids=["early", "before the table", "below a plugin's name", "imported again"],
)
def test_registered_wherever_in_gymnasiums_own_import_it_comes(code: str) -> None:
    """A plugin of Gymnasium's may import this package while Gymnasium is half imported."""
    check = "print('hdsafebo/BottleHand-v0' in gymnasium.registry)"
    assert output_of(f"{code}\n{check}") == "True"


def test_a_gymnasium_that_somebody_has_barred_is_no_matter() -> None:
    code = "import sys; sys.modules['gymnasium'] = None; import hdsafebo; print(hdsafebo.__version__ != '')"
    assert output_of(code) == "True"


def test_an_environment_can_be_made_by_its_name() -> None:
    code = (
        "import hdsafebo, gymnasium; "
        "print(gymnasium.make('hdsafebo/BottleHand-v0', variant='forearm').action_space.shape)"
    )
    assert output_of(code) == "(43,)"


def test_gymnasium_is_left_as_python_would_have_loaded_it() -> None:
    code = (
        "import hdsafebo, sys; assert 'gymnasium' not in sys.modules; import gymnasium; "
        "print(type(gymnasium.__loader__).__name__, type(gymnasium.__spec__.loader).__name__)"
    )
    assert output_of(code) == "SourceFileLoader SourceFileLoader"


def test_a_missing_gymnasium_is_missing_as_ever() -> None:
    code = (
        "import hdsafebo, sys; sys.path = []; sys.path_importer_cache.clear()\n"
        "try:\n    import gymnasium\nexcept ModuleNotFoundError as error:\n    print(error)"
    )
    assert output_of(code) == "No module named 'gymnasium'"


def test_every_entry_point_exists() -> None:
    from importlib import import_module

    for entry_point, _ in ENVIRONMENTS.values():
        module, name = entry_point.split(":")
        assert hasattr(import_module(module), name)
