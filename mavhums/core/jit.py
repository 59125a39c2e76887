"""Compilation by numba: when the package is built, or at the first call where its sources changed since.

The cache on disk is renewed when the function's own module changes, but not when a module changes whose
functions it inlines: after editing such a module, remove the ``__pycache__`` beside it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba import config, types
from numba.extending import intrinsic


def subroutine(function: Callable[..., object]) -> Any:
    """Compile at the first call, keep the result on disk, and release the GIL during execution."""
    return numba.njit(cache=True, nogil=True)(function)


def inlined(function: Callable[..., object]) -> Any:
    """Inline into every caller."""
    return numba.njit(cache=True, nogil=True, inline="always")(function)


def _load_word(typing_context: Any, data: Any, index: Any) -> Any:
    """Load the eight bytes at ``index`` of a contiguous uint8 array, little endian."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        place = builder.gep(array.data, [arguments[1]])
        word = builder.load(builder.bitcast(place, ir.IntType(64).as_pointer()))
        word.align = 1
        return word

    return types.uint64(data, types.int64), generate


def _store_word(typing_context: Any, data: Any, index: Any, word: Any) -> Any:
    """Store eight bytes at ``index`` of a contiguous uint8 array, little endian."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        place = builder.gep(array.data, [arguments[1]])
        store = builder.store(arguments[2], builder.bitcast(place, ir.IntType(64).as_pointer()))
        store.align = 1
        return context.get_dummy_value()

    return types.void(data, types.int64, types.uint64), generate


def _load_bytes(data: Any, index: int) -> Any:
    if index < 0:
        raise IndexError
    word = np.uint64(0)
    for k in range(8):
        word |= np.uint64(data[index + k]) << np.uint64(8 * k)
    return word


def _store_bytes(data: Any, index: int, word: Any) -> None:
    if index < 0:
        raise IndexError
    for k in range(8):
        data[index + k] = (word >> np.uint64(8 * k)) & np.uint64(0xFF)


# With NUMBA_BOUNDSCHECK=1 every access of the kernels is checked, including these.
_CHECKED = bool(getattr(config, "BOUNDSCHECK", False))
load_word: Any = inlined(_load_bytes) if _CHECKED else intrinsic(_load_word)
store_word: Any = inlined(_store_bytes) if _CHECKED else intrinsic(_store_word)
