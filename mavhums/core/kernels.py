"""Kernels: the inner loops that run once per byte or per sample, compiled when the package is built.

:mod:`mavhums.core.build` compiles every function with the decorator :func:`kernel`, for the types of its
annotations, into an extension module of its room. Where the sources changed since, numba compiles the same
functions at their first call: who works on kernels has it installed, who uses them needs no compiler.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterable
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, Final, NamedTuple, TypeVar, cast, get_args, get_origin, get_type_hints

import numpy as np

from mavhums.core.arrays import Block
from mavhums.core.errors import MavhumsError

Function = TypeVar("Function", bound=Callable[..., object])

PACKAGE: Final = Path(__file__).parents[1]
SOURCES: Final = "_kernels.txt"
"""File of the package with the digest of the sources that were compiled, then their paths."""

KERNELS: Final[dict[str, Callable[..., object]]] = {}
"""The functions of the kernels that were imported, by symbol."""


class Group(NamedTuple):
    """A tuple as a kernel takes it, with names or without."""

    of: type
    parts: tuple[Kind, ...]


Kind = Block | Group | type
"""What a kernel takes: an array, a tuple, or a number."""


def kernel(function: Function) -> Function:
    """Return the compiled function; it releases the GIL while it runs.

    Every annotation names a number, an array with its number of axes (:mod:`mavhums.core.arrays`), a
    structured array (``Annotated[Records, Block(ROW)]``), or a tuple of them.
    """
    symbol = f"{function.__module__}.{function.__qualname__}".replace(".", "__")
    KERNELS[symbol] = function
    if not _BUILT:
        return cast(Function, jit.subroutine(function))
    extension = import_module(f"mavhums._kernels_{function.__module__.split('.')[1]}")
    return cast(Function, _Compiled(function, getattr(extension, symbol)))


def subroutine(function: Function) -> Function:
    """Return a function that kernels alone call."""
    return function if _BUILT else cast(Function, jit.subroutine(function))


def inlined(function: Function) -> Function:
    """Inline into every kernel: for functions called once per frame, where a call would be expensive."""
    return function if _BUILT else cast(Function, jit.inlined(function))


class _Compiled:
    """A kernel of an extension module, which does not check the types of arrays itself."""

    def __init__(self, function: Callable[..., object], built: Callable[..., object]) -> None:
        self.__wrapped__ = function
        self.__doc__ = function.__doc__
        self._built = built
        self._kinds: Group | None = None

    def __call__(self, *arguments: object) -> object:
        if self._kinds is None:
            self._kinds = kinds_of(self.__wrapped__)
        if not _fits(arguments, self._kinds):
            name, got = self.__wrapped__.__qualname__, ", ".join(map(_shown, arguments))
            raise TypeError(f"{name} takes {self._kinds.parts}, not {got}")
        return self._built(*arguments)


def _fits(value: Any, kind: Kind) -> bool:
    """Return whether a kernel takes a value; numbers are converted."""
    if isinstance(kind, Block):
        is_array = type(value) is np.ndarray and value.ndim == kind.ndim
        return is_array and value.dtype == kind.dtype and value.flags.c_contiguous
    if isinstance(kind, Group):
        is_tuple = isinstance(value, tuple) and isinstance(value, kind.of) and len(value) == len(kind.parts)
        return is_tuple and all(map(_fits, value, kind.parts))
    return not isinstance(value, np.ndarray | tuple)


def _shown(value: object) -> str:
    return f"{value.dtype} {value.strides}" if isinstance(value, np.ndarray) else type(value).__name__


def kinds_of(function: Callable[..., object]) -> Group:
    """Return what the parameters of a kernel take, by its annotations.

    Examples
    --------
    >>> def total(values: Annotated[object, Block("f8")], share: float) -> float: ...
    >>> kinds_of(total).parts
    (Block(dtype='f8', ndim=1), <class 'float'>)
    """
    hints = get_type_hints(function, include_extras=True)
    return Group(tuple, tuple(_kind(hint) for name, hint in hints.items() if name != "return"))


def _kind(hint: Any) -> Kind:
    if get_origin(hint) is Annotated:
        return next(data for data in hint.__metadata__ if isinstance(data, Block))
    if get_origin(hint) is tuple:
        return Group(tuple, tuple(map(_kind, get_args(hint))))
    if hint in (int, float, bool):
        return cast(type, hint)
    return Group(hint, tuple(map(_kind, get_type_hints(hint, include_extras=True).values())))


def digest(paths: Iterable[Path]) -> str:
    """Return the digest of sources, in hexadecimal."""
    known = hashlib.blake2b(digest_size=16)
    for path in paths:
        known.update(path.read_bytes())
    return known.hexdigest()


def is_built() -> bool:
    """Return whether the extension modules were built from these sources, which an installation's are.

    With ``NUMBA_BOUNDSCHECK`` in the environment numba compiles again, and checks every access.
    """
    if "NUMBA_BOUNDSCHECK" in os.environ:
        return False
    in_source_tree = (PACKAGE.parent / "pyproject.toml").exists()
    try:
        built, *names = (PACKAGE / SOURCES).read_text(encoding="utf-8").split()
        return not in_source_tree or built == digest(PACKAGE / name for name in names)
    except OSError:  # nothing was built, or a source is gone since
        return False


_BUILT: Final = is_built()
if not _BUILT:
    try:
        from mavhums.core import jit
    except ImportError as error:
        raise MavhumsError(
            "the compiled loops of this installation are missing, or older than its sources",
            "pip install --force-reinstall mavhums (from a clone: pip install -e .), or pip install numba",
        ) from error

load_word: Any = None if _BUILT else jit.load_word
"""``load_word(data, place)`` in a kernel: eight bytes of an array of bytes, little endian."""

store_word: Any = None if _BUILT else jit.store_word
"""``store_word(data, place, word)`` in a kernel: stores them."""
