"""Public names of a package, which load their module when they are first asked for.

A package lists them once, for type checkers, in its `if TYPE_CHECKING:`; the same list is read here.
"""

import sys
from collections.abc import Callable, Mapping
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any


def public_names(package: str) -> Callable[[str], Any]:
    """Return the `__getattr__` of a package whose `if TYPE_CHECKING:` imports its public names."""

    def load(name: str) -> Any:
        if name == "__all__":
            return sorted(_modules(package))
        module = _modules(package).get(name) if not name.startswith("__") else None
        if module is None:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(import_module(module), name)

    return load


@cache
def _modules(package: str) -> Mapping[str, str]:
    """Return the module of each public name of a package."""
    import ast  # most programs ask for no public name

    source = Path(str(sys.modules[package].__file__)).read_text("utf-8")
    block = next(part for part in ast.parse(source).body if isinstance(part, ast.If))
    imports = [part for part in block.body if isinstance(part, ast.ImportFrom)]
    return {name.name: str(part.module) for part in imports for name in part.names}
