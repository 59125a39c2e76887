"""What makes the program start fast: lazy exports and few garbage collections.

This module imports nothing heavy, so that the command line can register before it loads anything.
"""

from __future__ import annotations

import atexit
import gc
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from typing import Any

from mavhums.core.errors import MissingExtraError

_AT_START = 200_000


def collect_seldom() -> None:
    """Let the process start and end without a collection; for programs, not for libraries.

    The modules behind a verdict make 140,000 objects, all of which last until the process ends. Later a
    collection follows every 200,000 new objects, so that a long session still frees its cycles.
    """
    gc.set_threshold(_AT_START)
    atexit.register(_end)


def _end() -> None:
    """Leave all objects to the end of the process."""
    gc.freeze()


@contextmanager
def no_collection() -> Iterator[None]:
    """Pause the cyclic garbage collector, which otherwise visits all living objects again and again.

    Afterwards the new objects count as old ones, which only the rare full collections visit. Where the
    program has frozen objects of its own, they stay frozen, and the next collection visits the new ones.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            if not gc.get_freeze_count():
                gc.freeze()
                gc.unfreeze()
            gc.enable()


def lazy_exports(
    package: str, modules: Mapping[str, str], *, missing: Mapping[str, tuple[str, str]] | None = None
) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Return ``__getattr__``, ``__dir__`` and ``__all__`` of a package that exports names of its submodules.

    Parameters
    ----------
    package
        Name of the package.
    modules
        The names that each module exports, by module, relative to the package.
    missing
        Feature and extra for the error message if an optional distribution is not installed, by the
        distribution's import name.

    Examples
    --------
    >>> load, _, names = lazy_exports("mavhums", {"app.analysis": "record analyse"})
    >>> names, load("analyse").__name__
    (['analyse', 'record'], 'analyse')
    """
    homes = {name: module for module, names in modules.items() for name in names.split()}

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

    names = sorted(homes)
    return load, names.copy, names
