"""Faults found by taking evidence away: whoever has less telemetry must not have more faults.

    python benchmarks/thinned.py [LOG|FOLDER ...] [--airframe PROFILE] [--store STORE] [--only REGEX]

Each log is judged again and again, each time with less of one message type: without it, with half of its
messages, with a fifth, and in bursts of 4 s with 4 s between them. Printed is each subject that is worse than
in the whole log: a fault that the whole log does not show, or a graver one. A type without which nothing
changes, not even a figure, is taken away only as a whole. ``--store`` compares with the earlier flights that
it holds, ``--only`` takes only the message types that match. Without a log a simulated quad is judged.

The exit status is 1 if a subject is worse.
"""

from __future__ import annotations

import argparse
import re
import tempfile
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from benchmarks.holes import simulated
from mavhums import Engine, MavhumsError
from mavhums.app.analysis import among_own
from mavhums.app.settings import Settings
from mavhums.core.conditions import SEVERITY, Condition
from mavhums.engine.events import StandaloneAssessment
from mavhums.log import Decoder, read_blocks
from mavhums.log.base.decoder import Table
from mavhums.log.formats import SUFFIXES
from mavhums.results.assessment import Assessment

_BURSTS: Final = -1
PARTS: Final = {"none of": 0, "half of": 2, "a fifth of": 5, "bursts of": _BURSTS}
"""What is left of a message type: none, one in so many, or bursts."""

_BURST_US: Final = 4_000_000
_INSTANCES: Final = ("I", "Instance", "instance", "index", "id", "array_id")
"""Fields by which messages of one type are of several sensors, ESCs or servos."""


class Subject(NamedTuple):
    """An actuator, an axis or a motor of a vehicle, or a network's answer on an actuator."""

    vehicle: int | None
    kind: str
    name: str

    def includes(self, other: Subject) -> bool:
        """Return whether this is the same, or several motors in doubt of which the other names some."""
        if self[:2] != other[:2] or self.kind != "motor":
            return self == other
        own, others = (set(re.findall(r"\d+", one.name)) for one in (self, other))
        return others <= own if others else self == other


class Worse(NamedTuple):
    """A subject that is worse with less: what it was in the whole log, and what it is now."""

    subject: Subject
    whole: Condition | None
    thinned: Condition

    def __str__(self) -> str:
        vehicle, kind, name = self.subject
        return f"{kind} {name} of vehicle {vehicle}: {self.whole or 'not named'} → {self.thinned}"


class ThinnedDecoder(Decoder):
    """A decoder that loses messages of one type.

    Parameters
    ----------
    messages
        As for :class:`Decoder`.
    name
        The type.
    part
        One of :data:`PARTS`; None keeps all.

    Attributes
    ----------
    names
        The types that are left.
    """

    def __init__(self, messages: Iterable[str] | None, name: str = "", part: str | None = None) -> None:
        super().__init__(messages)
        self._name, self._every = name, None if part is None else PARTS[part]
        self._lost: Counter[tuple[int, int, str]] = Counter()
        self._seen: Counter[tuple[int, int, float]] = Counter()
        self.names: set[str] = set()

    def feed(self, block: bytes, *, final: bool = False) -> dict[str, Table]:
        """Return the messages that are left of those that ``block`` completes."""
        tables = super().feed(block, final=final)
        if self._every is not None and self._name in tables:
            whole = tables.pop(self._name)
            kept = self._kept(whole, self._every)
            lost = whole.select(~kept)
            for system, component in zip(lost.system.tolist(), lost.component.tolist(), strict=True):
                self._lost[system, component, self._name] += 1
            if kept.any():
                tables[self._name] = whole.select(kept)
        self.names |= tables.keys()
        return tables

    def _kept(self, table: Table, every: int) -> NDArray[np.bool_]:
        """Return which messages are left: those in bursts, or one in so many of each sender and instance."""
        kept = np.zeros(len(table), dtype=np.bool_)
        if every == _BURSTS:
            return np.asarray(table.time_us // _BURST_US % 2 == 0)
        instance = next((table.numbers(field) for field in _INSTANCES if table.holds({field: 1})), kept)
        columns = (table.system, table.component, instance)
        for row, source in enumerate(zip(*(column.tolist() for column in columns), strict=True)):
            kept[row] = every > 0 and self._seen[source] % every == 0
            self._seen[source] += 1
        return kept

    def _left(self) -> dict[tuple[int, int, str], int]:
        return {key: left for key, n in self.chosen.counts.items() if (left := n - self._lost[key])}

    counts: dict[tuple[int, int, str], int] = cast("Any", property(_left))


def judged(
    path: Path, settings: Settings, name: str = "", part: str | None = None
) -> tuple[Assessment, set[str]]:
    """Judge a log with this part of one message type; return also the types that are left."""
    engine = Engine(settings.engine)
    decoder = engine._decoder = ThinnedDecoder(engine._decoder._wanted, name, part)
    for block in read_blocks(path):
        engine.feed(block)
    engine.finish()
    assessment, promised = engine.assessment(str(path)), settings.engine.false_alarms
    alone = StandaloneAssessment(assessment, engine.profiles(), promised)
    return among_own(path, alone, settings).assessment, decoder.names


def conditions(assessment: Assessment) -> dict[Subject, Condition]:
    """Return the worst condition of each subject."""
    found: dict[Subject, Condition] = {}
    for one in assessment.verdicts:
        worst = max(one.worst, one.condition, key=SEVERITY.__getitem__)
        found[Subject(one.vehicle, one.subject, one.actuator)] = worst
        if one.network is not None:
            found[Subject(one.vehicle, "network", one.actuator)] = one.network.condition
    return found


def compare(whole: Mapping[Subject, Condition], thinned: Mapping[Subject, Condition]) -> Iterator[Worse]:
    """Yield the subjects that are worse with less."""
    for subject, condition in thinned.items():
        before = [found for one, found in whole.items() if one.includes(subject)]
        if SEVERITY[condition] > max([0, *(SEVERITY[found] for found in before)]):
            yield Worse(subject, before[0] if before else None, condition)


def run(path: Path, settings: Settings, only: str) -> tuple[int, list[str]]:
    """Return how often a log was judged with less, and what became worse."""
    whole, names = judged(path, settings)
    count, worse = 0, list[str]()
    for name in sorted(name for name in names if re.search(only, name)):
        for part in PARTS:
            thinned, _ = judged(path, settings, name, part)
            count += 1
            worse += [f"{part} {name}: {one}" for one in compare(conditions(whole), conditions(thinned))]
            if thinned.model_dump(exclude={"log"}) == whole.model_dump(exclude={"log"}):
                break
    return count, worse


def logs_of(places: Sequence[Path]) -> Iterator[Path]:
    """Yield the logs, and those in the folders."""
    for place in places:
        inside = sorted(place.rglob("*")) if place.is_dir() else [place]
        yield from (one for one in inside if one.name.lower().removesuffix(".gz").endswith(SUFFIXES))


def report(logs: Sequence[Path], judge: Callable[[Path], tuple[int, list[str]]], change: str) -> int:
    """Print what is worse in each log, as ``judge`` returns it with the number of its variants.

    Return 1 if a subject is worse.
    """
    count, variants, bad = 0, 0, 0
    for path in logs:
        try:
            judged_again, worse = judge(path)
        except MavhumsError as error:
            print(error, flush=True)
            continue
        count, variants, bad = count + 1, variants + judged_again, bad + len(worse)
        heading = f"{path.name}: judged {judged_again} times where {change}, {len(worse)} worse"
        print(heading, *worse, sep="\n    ", flush=True)
    print(f"{count} logs, judged {variants} times where {change}: {bad} subjects worse")
    return int(bad > 0)


def main() -> int:
    """Judge all logs with less; return 1 if a subject is worse."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("places", nargs="*", type=Path)
    parser.add_argument("--airframe", default=None)
    parser.add_argument("--store", default=None)
    parser.add_argument("--only", default="")
    given = parser.parse_args()
    settings = Settings.read(None, airframe=given.airframe, store=given.store)
    with tempfile.TemporaryDirectory() as folder:
        logs = [*logs_of(given.places)] or [simulated(Path(folder))]
        return report(logs, lambda path: run(path, settings, given.only), "there was less")


if __name__ == "__main__":
    raise SystemExit(main())
