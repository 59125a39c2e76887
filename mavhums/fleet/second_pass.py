"""Compares each aircraft's flights with its past, and commits the verdicts.

Where all new flights come after those that have verdicts, and nothing else has changed, only they are judged.
Otherwise all flights of the aircraft are.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import partial
from typing import TYPE_CHECKING, Any, Final

from mavhums.fleet.replayed import Part, Replayed, replayed
from mavhums.fleet.workers import count
from mavhums.flights.checkpoint import Copies
from mavhums.flights.repairs import since_of
from mavhums.flights.stamp import Listed, kept_state, listed, store_state, told_by
from mavhums.flights.stores.delta import Store

if TYPE_CHECKING:
    from distributed import Client

__all__ = ["Settling", "hold_against_past", "settle"]

_PART_FLIGHTS: Final = 200
_PART_BYTES: Final = 4 << 20
_AT_ONCE: Final = 2
_FLIGHTS_AT_ONCE: Final = 50_000  # about 26 kB each
_LARGEST: Final = 4 << 20


def settle(store: Store, aircraft: Iterable[str], client: Client | None = None) -> None:
    """Judge the flights of some aircraft by their past, in this process or by workers, and commit.

    A flight that several logs record has the verdicts of the best one; the others are stored as its copies.
    """
    if client is None:
        for name in aircraft:
            store.settle(partial(hold_against_past, store, name))
    else:
        _by_workers(store, iter(aircraft), client)


def hold_against_past(store: Store, aircraft: str) -> None:
    """Judge the flights of an aircraft by its past in this process, and commit the verdicts."""
    committed = False
    while not committed:
        settling = Settling(store, aircraft)
        while settling.parts():
            settling.take(replayed(settling.following()))
        committed = settling.commit()


def _by_workers(store: Store, aircraft: Iterator[str], client: Client) -> None:
    from deltalake.exceptions import CommitFailedError
    from distributed import as_completed

    running: Any = as_completed()
    active: dict[str, Settling] = {}

    def go_on(settling: Settling) -> None:
        if settling.parts():
            future = client.submit(replayed, settling.following(), pure=False)
            active[future.key] = settling
            running.add(future)
            return
        try:
            committed = settling.commit()
        except CommitFailedError:
            committed = False
        if not committed:
            settle(store, [settling.aircraft])

    def start() -> None:
        while len(active) < most and sum(each.size for each in active.values()) < _FLIGHTS_AT_ONCE:
            name = next(aircraft, None)
            if name is None:
                return
            go_on(Settling(store, name))

    most = _AT_ONCE * count(client)
    start()
    for future in running:
        settling = active.pop(future.key)
        if future.status == "finished":
            settling.take(future.result())
            go_on(settling)
        else:  # the worker died, or the flights cannot be read: this process tells
            settle(store, [settling.aircraft])
        future.release()
        start()


class Settling:
    """The second pass of one aircraft, in parts that are judged one after the other.

    Parameters
    ----------
    store
        The store.
    aircraft
        Name of the aircraft.
    """

    def __init__(self, store: Store, aircraft: str) -> None:
        self.aircraft = aircraft
        self._store = store
        self._known: bytes | None = None
        self._rows: list[dict[str, object]] = []
        self._copies: Copies = {}
        self._open_copies: Copies = {}
        self._size = 0
        self._since = since_of(store, aircraft)
        self._told = told_by(store, aircraft)
        self._listed = listed(store, aircraft)
        kept = kept_state(store, aircraft, self._listed, self._told)
        self._settled = kept is not None
        known, new = kept or (None, self._listed)
        self._begin(known, new, whole=False)

    @property
    def size(self) -> int:
        """Number of flights whose verdicts are made."""
        return self._size

    def parts(self) -> bool:
        """Return whether a part is left."""
        return bool(self._next)

    def following(self) -> Part:
        """Return the part to be judged next."""
        return Part(self.aircraft, self._next, self._since, self._known, self._settled, self._whole)

    def take(self, result: Replayed | None) -> None:
        """Take the result of the part; where it needed more than was kept, begin with the first flight."""
        if result is None:
            self._settled, whole = False, not self._settled
            self._begin(None, self._listed, whole=whole)
            return
        self._rows += result.rows
        self._copies |= result.copies
        self._open_copies = result.open_copies
        self._known = result.known
        self._next = next(self._waiting, [])

    def commit(self) -> bool:
        """Commit the verdicts; False if another scan has added flights meanwhile."""
        counted, copies = self._divided()
        if self._settled:
            self._store.add_verdicts(self.aircraft, counted, copies)
        else:
            self._store.replace_verdicts(self.aircraft, counted)
            self._store.replace_copies(self.aircraft, copies)
        if self._store.is_shared and listed(self._store, self.aircraft) != self._listed:
            return False
        small = self._known if self._known and len(self._known) <= _LARGEST else None
        store_state(self._store, self.aircraft, self._listed, self._told, small)
        return True

    def _begin(self, known: bytes | None, new: list[Listed], *, whole: bool) -> None:
        self._known = known
        self._whole = whole
        self._rows = []
        self._copies = {}
        self._open_copies = {}
        self._size = len(new)
        self._waiting = self._flights(new)
        self._next = next(self._waiting, [])

    def _flights(self, new: list[Listed]) -> Iterator[list[bytes]]:
        """Yield the flights, in time order, in parts."""
        part: list[bytes] = []
        size = 0
        for data in self._store.flights(
            self.aircraft, [each.sha256 for each in new] if self._settled else None
        ):
            part.append(data)
            size += len(data)
            if len(part) == _PART_FLIGHTS or size > _PART_BYTES:
                yield part
                part, size = [], 0
        if part:
            yield part

    def _divided(self) -> tuple[list[dict[str, object]], list[dict[str, object]]]:
        """Return the rows of the recordings that count, and one row for each log with one that does not."""
        left_out: dict[Any, str | None] = {**self._copies, **self._open_copies}
        counted: list[dict[str, object]] = []
        copies: dict[Any, dict[str, object]] = {}
        for row in self._rows:
            key = row["airframe"], row["sha256"], row["vehicle"]
            if key not in left_out:
                counted.append(row)
                continue
            taken = {"counted": left_out[key]}
            copies[key] = {name: row[name] for name in ("aircraft", "path", "sha256", "vehicle")} | taken
        return counted, [*copies.values()]
