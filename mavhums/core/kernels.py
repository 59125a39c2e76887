"""Compilation of kernels: the inner loops that run once per byte or per sample.

The cache on disk is renewed when the kernel's own module changes, but not when a module changes whose
functions it inlines: after editing such a module, remove the ``__pycache__`` beside it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

import numba
from numba.core import event

from mavhums.core import startup

Function = TypeVar("Function", bound=Callable[..., object])


def kernel(function: Function) -> Function:
    """Compile at the first call, cache the result on disk, and release the GIL during execution."""
    return cast(Function, numba.njit(cache=True, nogil=True)(function))


def inlined(function: Function) -> Function:
    """Inline into every caller: for functions called once per frame, where a call would be expensive."""
    return cast(Function, numba.njit(cache=True, nogil=True, inline="always")(function))


class _CompileListener(event.Listener):
    """Reports compilations by numba; a cached kernel is not compiled."""

    def on_start(self, event: event.Event) -> None:
        startup.notify_of_compilation()

    def on_end(self, event: event.Event) -> None:
        """Do nothing: only the start is reported."""


event.register("numba:compile", _CompileListener())  # type: ignore[no-untyped-call]
