"""Registers this package's environments with Gymnasium, whenever that is imported.

Gymnasium finds environments in a table that packages fill when they are imported. `import hdsafebo` takes
0.02 s and Gymnasium 0.3 s, so the table is filled when it comes into being: at once where it is there
already, else right after the module that holds it was imported, by a finder that stands aside for every other
module.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from types import ModuleType

ENVIRONMENTS = {
    "hdsafebo/BottleHand-v0": ("hdsafebo.hand.environment:BottleHandEnv", {}),
    "hdsafebo/PushedBody-v0": ("hdsafebo.bodies.environment:PushedBodyEnv", {"body": "myofullbody"}),
    "hdsafebo/PushedLegs-v0": ("hdsafebo.bodies.environment:PushedBodyEnv", {"body": "myolegs"}),
}
"""Where each environment is defined, and the arguments that its name stands for."""
_REGISTRATION = "gymnasium.envs.registration"


def register() -> None:
    """Add the environments to Gymnasium's table, each once.

    Gymnasium's own `register` would put them below the name of a plugin, where one of those imports hdsafebo.
    """
    from gymnasium.envs.registration import EnvSpec, registry

    for name, (entry_point, arguments) in ENVIRONMENTS.items():
        if name not in registry:
            registry[name] = EnvSpec(id=name, entry_point=entry_point, kwargs=dict(arguments))


def register_with_gymnasium() -> None:
    """Register now if Gymnasium has its table, else as soon as it has; Gymnasium may be half imported."""
    if hasattr(sys.modules.get(_REGISTRATION), "registry"):
        register()
    elif not any(isinstance(finder, _AfterGymnasium) for finder in sys.meta_path):
        sys.meta_path.insert(0, _AfterGymnasium())


class _AfterGymnasium(MetaPathFinder):
    """Finds the module of the table as Python would, and has `register` follow its import."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """The module's own spec with a loader that registers; None for every other module."""
        if fullname != _REGISTRATION:
            return None
        spec = PathFinder.find_spec(fullname, path, target)
        if spec is not None and spec.loader is not None:
            spec.loader = _Registering(spec.loader)
        return spec


class _Registering(Loader):
    """Another loader, followed by `register`."""

    def __init__(self, loader: Loader) -> None:
        self._loader = loader

    def __getattr__(self, name: str) -> object:
        """Everything else that the module system asks of a loader."""
        if name == "_loader":  # of a copy that has none yet
            raise AttributeError(name)
        return getattr(self._loader, name)

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        """As the other loader does."""
        return self._loader.create_module(spec)

    def exec_module(self, module: ModuleType) -> None:
        """As the other loader does, then register; `module.__loader__` is the other one again."""
        self._loader.exec_module(module)
        module.__loader__ = self._loader
        if module.__spec__ is not None:
            module.__spec__.loader = self._loader
        register()
