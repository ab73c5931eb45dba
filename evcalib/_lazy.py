"""Names that are imported when they are first used, so that importing a package is quick."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from importlib import import_module
from typing import Any


def lazy(
    package: str, homes: Mapping[str, str], modules: Iterable[str]
) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Return ``__getattr__`` and ``__dir__`` of a package: names by their modules, and modules."""
    shown = sorted({*homes, *modules})

    def get(name: str) -> Any:
        if name not in shown:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        home = import_module(f"{package}.{homes.get(name, name)}")
        return getattr(home, name) if name in homes else home

    return get, lambda: shown
