"""Runs a function on many items in several processes; the results come in the order of the items.

A process that dies, hangs or outgrows its memory loses the item that it works on, and nothing else.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections import deque
from collections.abc import Callable, Generator, Iterable, Sequence
from concurrent.futures import Future, wait
from contextlib import contextmanager
from copy import copy
from itertools import islice
from multiprocessing import resource_tracker
from threading import Thread, current_thread, main_thread
from types import FrameType
from typing import Any, Final, NamedTuple, TypeVar

_AHEAD: Final = 3  # items in work for each process, so that a slow item idles no other process
# A wait without end misses a Ctrl-C that comes just before it begins: Python looks at signals between waits.
_WAIT_S: Final = 0.2

Item = TypeVar("Item")
Result = TypeVar("Result")


class LostItem(NamedTuple):
    """Result of an item whose process died, or, if ``hung``, took too long."""

    hung: bool = False


def in_processes(
    function: Callable[[Item], Result],
    items: Iterable[Item],
    jobs: int,
    *,
    preload: Sequence[str] = (),
    item_s: float | None = None,
) -> Generator[Result | LostItem]:
    """Yield the function's result for each item, in order; only a few items are worked on ahead.

    An item on which a process dies is tried once more: the cause may have been another program that took all
    memory. The processes end when the iteration ends, even early, and when this process dies.

    Parameters
    ----------
    function
        Sent once to each process.
    items
        Arguments of the function.
    jobs
        Number of processes.
    preload
        Modules that the processes share, so that each need not import them again.
    item_s
        Longest time for an item, s; None for no limit.
    """
    from pebble import ProcessExpired

    waiting = iter(items)
    ahead: deque[tuple[Item, Future[Result]]] = deque()
    with process_pool(function, jobs, preload=preload, item_s=item_s) as submit:
        while True:
            ahead.extend((item, submit(item)) for item in islice(waiting, jobs * _AHEAD - len(ahead)))
            if not ahead:
                return
            item, future = ahead.popleft()
            try:
                try:
                    yield _result(future)
                except ProcessExpired:
                    yield _result(submit(item))
            except ProcessExpired:
                yield LostItem()
            except TimeoutError:
                yield LostItem(hung=True)


def _result(future: Future[Result]) -> Result:
    while not future.done():
        wait([future], _WAIT_S)
    return future.result()


@contextmanager
def process_pool(
    function: Callable[[Item], Result],
    jobs: int,
    *,
    preload: Sequence[str] = (),
    item_s: float | None = None,
    items: int = 0,
    begin: Callable[[], None] | None = None,
) -> Generator[Callable[[Item], Future[Result]]]:
    """Yield what passes an item to processes that run one function; at the end they end, whatever they do.

    A future raises ``TimeoutError`` where its item took too long, and pebble's ``ProcessExpired`` where the
    process died; one that is cancelled ends the process that works on it.

    Parameters
    ----------
    function, jobs, preload, item_s
        As for :func:`in_processes`.
    items
        Items after which a process is replaced; 0 for never.
    begin
        Called first in each process.
    """
    from pebble import ProcessPool

    forks = "forkserver" in multiprocessing.get_all_start_methods()
    context: Any = copy(multiprocessing.get_context("forkserver" if forks else "spawn"))
    if forks:
        context.set_forkserver_preload(list(preload))
    # A pool that ends drops its locks before its processes; one that is half started needs them still.
    locks: list[Any] = []
    make_lock = context.RLock

    def kept_lock() -> Any:
        locks.append(make_lock())
        return locks[-1]

    context.RLock = kept_lock
    for limit in ("MALLOC_TRIM_THRESHOLD_", "MALLOC_MMAP_THRESHOLD_"):
        # Without these, the memory of each item is returned to the system and fetched again, page by page.
        os.environ.setdefault(limit, str(32 << 20))
    pool = ProcessPool(jobs, items, initializer=_begin, initargs=(function, begin), context=context)

    def submit(item: Item) -> Future[Result]:
        with _interrupts_wait():
            future: Future[Result] = pool.schedule(_run, (item,), timeout=item_s)
            return future

    try:
        yield submit
    finally:
        with _interrupts_wait():
            pool.stop()  # type: ignore[no-untyped-call]
            pool.join()


@contextmanager
def _interrupts_wait() -> Generator[None]:
    """Let Ctrl-C wait while processes start or end: one that is half started prints a traceback."""
    if current_thread() is not main_thread():  # interrupts are handled by the main thread only
        yield
        return
    interrupted = False

    def note(number: int, frame: FrameType | None) -> None:
        nonlocal interrupted
        interrupted = True

    before = signal.signal(signal.SIGINT, note)
    try:
        with _blocked_in_children():
            yield
    finally:
        signal.signal(signal.SIGINT, before)
        if interrupted:
            signal.raise_signal(signal.SIGINT)


@contextmanager
def _blocked_in_children() -> Generator[None]:
    """Start processes with Ctrl-C blocked: each inherits it, and ignores Ctrl-C once it has begun."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # its start would unblock Ctrl-C
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


_function: Callable[[Any], Any]


def _begin(function: Callable[[Any], Any], begin: Callable[[], None] | None) -> None:
    """Prepare a new process: Ctrl-C is the caller's to handle, and the process ends with the caller."""
    global _function  # noqa: PLW0603 — the only way that a pool offers to send data once to a process
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)  # a handler would wait for the end of a compiled loop
    Thread(target=_end_with_caller, daemon=True).start()
    _function = function
    if begin is not None:
        begin()


def _end_with_caller() -> None:
    caller = multiprocessing.parent_process()
    if caller is not None:
        caller.join()
        os._exit(1)


def _run(item: Any) -> Any:
    return _function(item)
