"""Lazy exports of a package: names are imported on first use, which keeps ``--help`` fast."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

from mavhums.core.errors import MissingExtraError

__all__ = ["lazy_exports"]


def lazy_exports(
    package: str, homes: Mapping[str, str], *, missing: Mapping[str, tuple[str, str]] | None = None
) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Return ``__getattr__`` and ``__dir__`` of a package that exports names of its submodules.

    Parameters
    ----------
    package
        Name of the package.
    homes
        Module of each name, relative to the package.
    missing
        Feature and extra for the error message if an optional distribution is not installed, by the
        distribution's import name.

    Examples
    --------
    >>> load, names = lazy_exports("mavhums", {"analyse": "app.analysis"})
    >>> load("analyse").__name__
    'analyse'
    """

    def load(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        try:
            module = import_module(f"{package}.{homes[name]}")
        except ModuleNotFoundError as error:
            needed = (missing or {}).get((error.name or "").partition(".")[0])
            if needed is None:
                raise
            raise MissingExtraError(*needed) from error
        value = getattr(module, name)
        setattr(sys.modules[package], name, value)
        return value

    def names() -> list[str]:
        return sorted(homes)

    return load, names
