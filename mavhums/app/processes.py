"""Runs a function on many items in several processes; the results come in the order of the items."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections import deque
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from itertools import islice
from multiprocessing import resource_tracker
from threading import Thread, current_thread, main_thread
from types import FrameType
from typing import Any, Final, Generic, NamedTuple, TypeVar

__all__ = ["Crashed", "in_processes"]

_AHEAD: Final = 3  # items in work for each process, so that a slow item idles no other process
_PRELOADED: Final = ["mavhums.app.many"]

Item = TypeVar("Item")
Result = TypeVar("Result")


class Crashed(NamedTuple):
    """Stands for the result of an item on which its process died."""


def in_processes(
    function: Callable[[Item], Result],
    items: Iterable[Item],
    jobs: int,
    prepare: Callable[[], None] | None = None,
) -> Generator[Result | Crashed]:
    """Yield the function's result for each item, in order; only a few items are worked on ahead.

    The first item runs alone, because its process may compile the kernels for all others. If a process dies,
    the items then in work are tried again, one at a time; an item on which the process dies again is the
    cause. The processes end when the iteration ends, even early, and when this process dies.

    Parameters
    ----------
    function
        Sent once to each process.
    items
        Arguments of the function.
    jobs
        Number of processes.
    prepare
        Called in each process before its first item.
    """
    waiting, most = iter(items), 1
    pool = _Pool(function, jobs, prepare)
    ahead: deque[tuple[Item, Future[Result]]] = deque()
    try:
        while True:
            ahead.extend((item, pool.submit(item)) for item in islice(waiting, most - len(ahead)))
            if not ahead:
                return
            item, future = ahead.popleft()
            try:
                result: Result | Crashed = future.result()
            except BrokenProcessPool:
                pool.end()
                pool = _Pool(function, jobs, prepare)
                suspects = [item, *(each for each, _ in ahead)]
                ahead.clear()
                for suspect in suspects:
                    yield _tried_alone(function, suspect, prepare)
            else:
                yield result
            most = jobs * _AHEAD
    finally:
        pool.end()


def _tried_alone(
    function: Callable[[Item], Result], item: Item, prepare: Callable[[], None] | None
) -> Result | Crashed:
    pool = _Pool(function, 1, prepare)
    try:
        return pool.submit(item).result()
    except BrokenProcessPool:
        return Crashed()
    finally:
        pool.end()


class _Pool(Generic[Item, Result]):
    """Processes that run one function."""

    def __init__(
        self, function: Callable[[Item], Result], jobs: int, prepare: Callable[[], None] | None
    ) -> None:
        forks = "forkserver" in multiprocessing.get_all_start_methods()
        context: Any = multiprocessing.get_context("forkserver" if forks else "spawn")
        if forks:
            context.set_forkserver_preload(_PRELOADED)
        self._others = set(multiprocessing.active_children())
        self._executor = ProcessPoolExecutor(jobs, context, _begin, (function, prepare))

    def submit(self, item: Item) -> Future[Result]:
        with _interrupts_wait():
            return self._executor.submit(_run, item)

    def end(self) -> None:
        """End the processes, whatever they are doing."""
        with _interrupts_wait():
            self._executor.shutdown(wait=False, cancel_futures=True)
            for process in set(multiprocessing.active_children()) - self._others:
                process.terminate()
            self._executor.shutdown(wait=True)
            del self._executor  # its last act is a callback, in which an interrupt would be lost


@contextmanager
def _interrupts_wait() -> Generator[None]:
    """Let Ctrl-C wait while processes start or end: one that is half started prints a traceback."""
    if current_thread() is not main_thread():  # interrupts are handled by the main thread only
        yield
        return
    told = False

    def tell(number: int, frame: FrameType | None) -> None:
        nonlocal told
        told = True

    before = signal.signal(signal.SIGINT, tell)
    try:
        with _blocked_in_children():
            yield
    finally:
        signal.signal(signal.SIGINT, before)
        if told:
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


def _begin(function: Callable[[Any], Any], prepare: Callable[[], None] | None) -> None:
    """Prepare a new process: Ctrl-C is the caller's to handle, and the process ends with the caller."""
    global _function  # noqa: PLW0603 — the only way that an executor offers to send data once to a process
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    Thread(target=_end_with_caller, daemon=True).start()
    _function = function
    if prepare is not None:
        prepare()


def _end_with_caller() -> None:
    caller = multiprocessing.parent_process()
    if caller is not None:
        caller.join()
        os._exit(1)


def _run(item: Any) -> Any:
    return _function(item)
