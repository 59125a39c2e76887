"""Faults found by taking evidence away: whoever has less telemetry must not have more faults.

    python benchmarks/thinned.py [LOG|FOLDER ...] [--airframe PROFILE] [--store STORE] [--only REGEX]
                                 [--beginnings]

Each log is judged again and again, each time with less of one message type: without it, with half of its
messages, with a fifth, and in bursts of 4 s with 4 s between them. Printed is each subject that is worse than
in the whole log: a fault that the whole log does not show, or a graver one. A type without which nothing
changes, not even a figure, is taken away only as a whole. ``--store`` compares with the earlier flights that
it holds, ``--only`` takes only the message types that match. ``--beginnings`` takes away the beginning of the
log instead, up to 15 places, but for its set-up: parameters, texts and heartbeats stay. Without a log a
simulated quad is judged.

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
_BEGINNINGS: Final = 15
_SETUP: Final = re.compile("PARM|PARAM|MSG$|STATUSTEXT|VER|HEARTBEAT|FMT|UNIT|MULT|logging", re.IGNORECASE)
"""Messages that a log begins with, whenever it begins."""
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
    """A decoder that loses messages of one type, or all of a log's beginning but its set-up.

    Parameters
    ----------
    messages
        As for :class:`Decoder`.
    name
        The type.
    part
        One of :data:`PARTS`; None keeps all.
    begin_us
        Time before which only the set-up is left, µs of UTC.

    Attributes
    ----------
    names
        The types that are left.
    """

    def __init__(
        self, messages: Iterable[str] | None, name: str = "", part: str | None = None, begin_us: int = 0
    ) -> None:
        super().__init__(messages)
        self._begin_us = begin_us
        self._name, self._every = name, None if part is None else PARTS[part]
        self._lost: Counter[tuple[int, int, str]] = Counter()
        self._seen: Counter[tuple[int, int, float]] = Counter()
        self.names: set[str] = set()

    def feed(self, block: bytes, *, final: bool = False) -> dict[str, Table]:
        """Return the messages that are left of those that ``block`` completes."""
        tables = super().feed(block, final=final)
        for name, whole in [*tables.items()]:
            kept = self._kept(name, whole)
            if kept.all():
                continue
            lost = whole.select(~kept)
            for system, component in zip(lost.system.tolist(), lost.component.tolist(), strict=True):
                self._lost[system, component, name] += 1
            tables[name] = whole.select(kept)
            if not kept.any():
                del tables[name]
        self.names |= tables.keys()
        return tables

    def _kept(self, name: str, table: Table) -> NDArray[np.bool_]:
        """Return which messages are left: those in bursts, or one in so many of each sender and instance."""
        every = self._every if name == self._name else None
        if every is None:
            return np.asarray((table.time_us >= self._begin_us) | bool(_SETUP.search(name)))
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
    path: Path, settings: Settings, name: str = "", part: str | None = None, begin_us: int = 0
) -> tuple[Assessment, set[str]]:
    """Judge a log with this part of one message type; return also the types that are left."""
    engine = Engine(settings.engine)
    decoder = engine._decoder = ThinnedDecoder(engine._decoder._wanted, name, part, begin_us)
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


def run_later(path: Path, settings: Settings) -> tuple[int, list[str]]:
    """Return at how many places a log was made to begin later, and what became worse."""
    whole = conditions(judged(path, settings)[0])
    first_us, last_us = time_span_us(path)
    worse: list[str] = []
    for place in range(1, _BEGINNINGS + 1):
        begin_us = first_us + (last_us - first_us) * place // (_BEGINNINGS + 1)
        later, _ = judged(path, settings, begin_us=begin_us)
        begins = f"begins {(begin_us - first_us) / 1e6:.1f} s later"
        worse += [f"{begins}: {one}" for one in compare(whole, conditions(later))]
    return _BEGINNINGS, worse


def time_span_us(path: Path) -> tuple[int, int]:
    """Return the times of the first and the last message of a log, µs of UTC."""
    decoder = Decoder(())
    for block in read_blocks(path):
        decoder.feed(block)
    return decoder.first_time_us or 0, decoder.last_time_us or 0


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
    parser.add_argument("--beginnings", action="store_true")
    given = parser.parse_args()
    settings = Settings.read(None, airframe=given.airframe, store=given.store)
    with tempfile.TemporaryDirectory() as folder:
        logs = [*logs_of(given.places)] or [simulated(Path(folder))]
        if given.beginnings:
            return report(logs, lambda path: run_later(path, settings), "it began later")
        return report(logs, lambda path: run(path, settings, given.only), "there was less")


if __name__ == "__main__":
    raise SystemExit(main())
