"""How the aircraft of a store stand, and what changed since a time.

The second pass keeps how each aircraft stands beside the verdicts, so that a list of the fleet reads a row of
each. The rows before stay: what changed since yesterday is the difference of what a reader saw then and what
there is now, whatever came late or was judged again.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime, timedelta
from typing import Final

from mavhums.core.conditions import SEVERITY
from mavhums.core.errors import MavhumsError
from mavhums.flights.aircraft import UNKNOWN
from mavhums.flights.queries import STANDINGS_OF, standings, trend_of
from mavhums.flights.stores.delta import Store
from mavhums.flights.stores.delta_tables import STANDINGS
from mavhums.results.standing import Growth, Standing
from mavhums.results.store import Change, FailedLog, FleetDigest, SilentAircraft

__all__ = ["SILENT_DAYS", "digest", "store_standings"]

SILENT_DAYS: Final = 14.0
"""Days without a flight after which an aircraft is said to be silent; by hand."""

_SOON_FLIGHTS: Final = 10.0
_ORDER: Final = ("new", "worse", "growing", "step", "eased", "gone")


def store_standings(store: Store, aircraft: str, *, stored_ns: int | None = None) -> None:
    """Commit how an aircraft stands after its last flight; of an unknown one nothing is kept."""
    if aircraft == UNKNOWN:
        return
    try:
        found = trend_of(store, aircraft).standings
    except MavhumsError:  # it has no dated flight any more
        found = ()
    row: dict[str, object] = {
        "aircraft": aircraft,
        "standings": STANDINGS_OF.dump_json(found).decode(),
        "stored": stored_ns or time.time_ns(),
    }
    store.append(STANDINGS, [row])


def digest(
    store: str | os.PathLike[str],
    since: datetime,
    until: datetime | None = None,
    *,
    silent_days: float = SILENT_DAYS,
) -> FleetDigest:
    """Return what changed in a fleet since a time.

    Parameters
    ----------
    store
        Folder or address of the store.
    since, until
        Times with a time zone, of logs that came into the store; until now if None.
    silent_days
        Days without a flight after which an aircraft is said to be silent.

    Raises
    ------
    MavhumsError
        If the store does not exist.
    """
    kept = Store(store).opened()
    until = until or datetime.now(UTC)
    begin, end = (round(at.timestamp() * 1e6) * 1000 for at in (since, until))
    before, now = standings(kept, until_ns=begin), standings(kept, until_ns=end)
    changes = [
        change for aircraft in now for change in _changes(aircraft, before.get(aircraft, ()), now[aircraft])
    ]
    changed = {(one.aircraft, one.now.vehicle, one.now.actuator) for one in changes}
    findings = {(name, one.vehicle, one.actuator) for name in now for one in now[name] if one.is_finding}
    silent = [*_silent(now, until, silent_days)]
    newly = [one for one in silent if one.days - (until - since) / timedelta(days=1) <= silent_days]
    failed = kept.query(
        "SELECT DISTINCT problem, remedy FROM logs WHERE problem IS NOT NULL AND scanned > ? AND scanned <= ?"
        " ORDER BY problem",
        begin,
        end,
    ).fetchall()
    (flights,) = kept.query(
        "SELECT count(*) FROM"
        " (SELECT min(scanned) AS came FROM logs WHERE flight IS NOT NULL GROUP BY sha256)"
        " WHERE came > ? AND came <= ?",
        begin,
        end,
    ).fetchone()
    return FleetDigest(
        since_utc=since.astimezone(UTC).isoformat(timespec="seconds"),
        until_utc=until.astimezone(UTC).isoformat(timespec="seconds"),
        aircraft=len(now),
        flights=flights,
        changes=tuple(sorted(changes, key=lambda one: (_ORDER.index(one.kind), one.now.rank, one.aircraft))),
        silent=tuple(newly),
        failed=tuple(FailedLog(problem=problem, remedy=remedy) for problem, remedy in failed),
        standing=len(findings - changed),
        silent_longer=len(silent) - len(newly),
    )


def _changes(aircraft: str, before: Sequence[Standing], now: Sequence[Standing]) -> Iterator[Change]:
    then = {(one.vehicle, one.actuator, one.airframe): one for one in before}
    for one in now:
        was = then.get((one.vehicle, one.actuator, one.airframe))
        for kind in _kinds(was, one):
            yield Change(kind=kind, aircraft=aircraft, before=was, now=one)  # type: ignore[arg-type]


def _kinds(was: Standing | None, now: Standing) -> Iterator[str]:
    worse = max(SEVERITY[now.condition], 0)
    old = max(SEVERITY[was.condition], 0) if was else 0
    if worse > old:
        yield "worse" if old else "new"
    elif now.growth and (was is None or was.growth is None or _is_soon(now.growth) > _is_soon(was.growth)):
        # Whose fault is told does not need to be told to grow, too: its sentence says so.
        yield "growing"
    elif worse < old:
        yield "eased" if worse or now.growth else "gone"
    elif was is not None and was.growth and not now.growth and not worse:
        yield "gone"
    if now.step and (was is None or was.step is None or was.step.at_utc < now.step.at_utc):
        # One before the step that was told is not new: a later one was taken back.
        yield "step"


def _is_soon(growth: Growth) -> int:
    """Return how many limits the growth reaches within ten flights."""
    return sum(
        left is not None and left.estimate <= _SOON_FLIGHTS
        for left in (growth.to_degraded, growth.to_emergency)
    )


def _silent(
    now: Mapping[str, Sequence[Standing]], until: datetime, silent_days: float
) -> Iterator[SilentAircraft]:
    for aircraft in sorted(now):
        last = max(datetime.fromisoformat(one.last_utc) for one in now[aircraft])
        days = (until - last) / timedelta(days=1)
        if days > silent_days:
            yield SilentAircraft(aircraft=aircraft, last_utc=last.isoformat(), days=round(days, 1))
