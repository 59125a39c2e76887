"""The compilation of the simulator's inner loops, at their first call."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NoReturn, TypeVar, cast

Function = TypeVar("Function", bound=Callable[..., Any])

try:
    import numba
except ModuleNotFoundError:
    compiled: Any = None
else:
    compiled = numba.njit(cache=True, nogil=True)


def kernel(function: Function) -> Function:
    """Compile at the first call, keep the result on disk, and release the GIL during execution.

    Raises
    ------
    ModuleNotFoundError
        At the call, where numba is not installed.
    """
    return cast(Function, _without_numba if compiled is None else compiled(function))


def _without_numba(*_arguments: object) -> NoReturn:
    raise ModuleNotFoundError("the simulator needs numba: pip install 'mavhums[sim]'")
