"""How kernels are compiled: the inner loops that run once a byte or once a sample.

What is kept on disk is renewed when the kernel's own module changes, not when one does that it
inlines: after editing such a module remove the ``__pycache__`` beside it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

import numba
from numba.core import event

from mavhums.core import compiling

__all__ = ["inlined", "kernel"]

Function = TypeVar("Function", bound=Callable[..., object])


def kernel(function: Function) -> Function:
    """Compile at the first call, keep the result on disk, and release the GIL while it runs."""
    return cast(Function, numba.njit(cache=True, nogil=True)(function))


def inlined(function: Function) -> Function:
    """Compile into every caller: for what runs once a frame, where a call would cost as much."""
    return cast(Function, numba.njit(cache=True, nogil=True, inline="always")(function))


class _Teller(event.Listener):
    """Passes on that numba compiles, which it does not where the result is on disk."""

    def on_start(self, event: event.Event) -> None:
        compiling.tell()

    def on_end(self, event: event.Event) -> None:
        """Do nothing: what matters is that it takes a while."""


event.register("numba:compile", _Teller())  # type: ignore[no-untyped-call]
