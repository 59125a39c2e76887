"""The network's answer on each sample of one actuator, as the paper's figures 16 to 19 show it."""

from __future__ import annotations

from typing import Final

import numpy as np
import rerun as rr

from mavhums.core.arrays import Array
from mavhums.health.decision.events import Classified
from mavhums.show._stream import send
from mavhums.show._thin import Thinner
from mavhums.show.words import COLOURS, PALE_BLUE, SERIES, STALE_COLOUR

__all__ = ["Classes"]

_CAPACITY: Final = 32768
_GAP_S: Final = 3.0
_ABSTAINS: Final = "abstains"
_STYLE: Final = rr.SeriesLines(
    names="of each sample",
    colors=PALE_BLUE,
    widths=0.75,
    aggregation_policy=rr.components.AggregationPolicy.MinMax,  # the mean of a pixel would be no class
)


class Classes:
    """Writes the probability of an emergency and the class of each sample.

    All samples of a flight up to 32,768 are written; of a longer one groups of neighbours keep their smallest
    and largest value, so that no other class within a group is lost. A class is written where it changes.

    Parameters
    ----------
    stream, path
        Output stream, and the entity path of the network's windows; samples and classes lie under it.
    live
        Whether a viewer shows the flight live: every sample is then written at the next :meth:`flush`.

    Attributes
    ----------
    any
        Whether a sample was classified.
    """

    def __init__(self, stream: rr.RecordingStream, path: str, *, live: bool) -> None:
        self.any = False
        self._stream, self._path, self._live = stream, path, live
        self._names: list[str] = [_ABSTAINS]
        self._thinner = Thinner(2, 4 if live else _CAPACITY)
        self._recent: list[tuple[Array, Array]] = []
        self._last = np.nan
        self._drawn = False

    def add(self, event: Classified) -> None:
        """Add samples; outside the network's training range it abstains."""
        if not event.time_s.size or not (self.any or (event.said >= 0).any()):
            return
        self.any = True
        self._names += [name for name in event.classes if name not in self._names]
        codes = np.array([*map(self._names.index, event.classes), 0])[event.said]
        answered = event.inside & (event.said >= 0)
        rows = np.column_stack([np.where(answered, event.p_emergency, np.nan), np.where(answered, codes, 0)])
        if self._live:
            self._recent.append((event.time_s, rows))
        else:
            self._thinner.add(event.time_s, rows)

    def flush(self) -> None:
        """Write new samples for a live viewer."""
        recent, self._recent = self._recent, []
        if recent:
            self._write(*(np.concatenate(parts) for parts in zip(*recent, strict=True)))

    def finish(self) -> None:
        """Write the remaining samples."""
        self.flush()
        if self.any and not self._live:
            self._write(*self._thinner.rows())

    def _write(self, time: Array, rows: Array) -> None:
        if not self._drawn:
            self._drawn = True
            self._stream.log(f"{self._path}/samples", _STYLE, static=True)
            self._stream.log(f"{self._path}/class", _states(self._names), static=True)
        codes = rows[:, 1]
        turns = np.flatnonzero(np.diff(codes, prepend=self._last) != 0)
        self._last = float(codes[-1])
        if turns.size:
            names = [self._names[int(code)] for code in codes[turns].tolist()]
            send(self._stream, f"{self._path}/class", time[turns], rr.StateChange.columns(state=names))
        gaps = np.flatnonzero(np.diff(time) > _GAP_S).astype(np.int64)
        shown = np.insert(rows[:, 0], gaps + 1, np.nan)
        at_s = np.insert(time, gaps + 1, time[gaps] + 1e-3)
        send(self._stream, f"{self._path}/samples", at_s, rr.Scalars.columns(scalars=shown))


def _states(names: list[str]) -> rr.StateConfiguration:
    others = iter(SERIES * len(names))
    known = {str(name): rgb for name, rgb in COLOURS.items()} | {_ABSTAINS: STALE_COLOUR}
    colours = [known.get(name) or next(others) for name in names]
    return rr.StateConfiguration(values=names, labels=names, colors=[(*rgb, 255) for rgb in colours])
