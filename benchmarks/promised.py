"""False alarms of the own-history comparison over those promised: ``python benchmarks/promised.py``.

Flights are drawn, not simulated: the friction of a flight's sixteen parts is its mean, a deviation that
recurs in each flight, and one that does not. A flight's jackknife counts both; only the second scatters.
For each set of earlier flights the probability that a healthy flight exceeds its threshold is exact, for its
friction is normal.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr

from mavhums.core.arrays import Array
from mavhums.health.decision.limits import tail_of
from mavhums.health.estimation.equations.own_scale import CURRENT
from mavhums.health.estimation.flight_sums import KEPT
from mavhums.health.estimation.least_squares import packed
from mavhums.health.estimation.thresholds import WINDOW_S
from mavhums.health.estimation.wear import wear
from mavhums.health.self_baseline.comparison import _ReferenceFlights
from mavhums.results.verdict import OwnRecord

PARTS, SAMPLES, SECONDS, JUDGED = 16, 400.0, 180.0, 4
_LOADED = KEPT.index("loaded")


class Flights(NamedTuple):
    """How healthy flights differ, as shares of their friction.

    ``between`` is the scatter of their true friction. ``own`` is the error of a flight that the deviations of
    its parts make which do not recur, ``recurs`` what those that recur add to its jackknife. ``uneven`` is
    the deviation of the logarithm of ``own`` between flights, ``rougher`` the factor on ``own`` in the
    judged flights alone.
    """

    between: float
    own: float
    recurs: float = 0.0
    uneven: float = 0.0
    rougher: float = 1.0


KINDS = (
    Flights(0.0, 0.06),
    Flights(0.0, 0.06, uneven=0.3),
    Flights(0.0, 0.15),
    Flights(0.0, 0.15, uneven=0.5),
    Flights(0.03, 0.06, uneven=0.3),
    Flights(0.05, 0.06, uneven=0.3),
    Flights(0.05, 0.1, uneven=0.3),
    Flights(0.1, 0.02),
    Flights(0.1, 0.06),
    Flights(0.03, 0.015, 0.06),
    Flights(0.05, 0.03, 0.1),
    Flights(0.03, 0.06, rougher=1.5),
    Flights(0.03, 0.06, rougher=2.0),
    Flights(0.03, 0.06, rougher=3.0),
)


def record(parts: Array) -> OwnRecord:
    """Return the record of a flight whose parts have these frictions; speed and load are orthogonal."""
    groups = []
    for friction in parts:
        gram = np.eye(len(KEPT)) * SAMPLES
        gram[_LOADED] = gram[:, _LOADED] = 0.0
        gram[0, -1] = gram[-1, 0] = SAMPLES * friction
        gram[-1, -1] = SAMPLES * (friction**2 + 1e-4)
        groups.append((SAMPLES, *packed(gram)))
    return OwnRecord(
        equation=CURRENT.name, setup="drawn", rate_hz=50.0, duration_s=SECONDS, groups=tuple(groups)
    )


def rate(kind: Flights, before: int, draws: int) -> tuple[float, float]:
    """Return false alarms over those promised, and the median least rise."""
    rng, found, least = np.random.default_rng([34, before]), [], []
    tail = tail_of(1.0) * SECONDS / WINDOW_S
    for _ in range(draws):
        count = before + JUDGED
        own = kind.own * np.exp(kind.uneven * rng.standard_normal(count))
        own[before:] *= kind.rougher
        true = 1.0 + kind.between * rng.standard_normal(count)
        recurring = kind.recurs * PARTS**0.5 * rng.standard_normal(PARTS)
        parts = true[:, None] + recurring - recurring.mean()
        parts = parts + own[:, None] * PARTS**0.5 * rng.standard_normal((count, PARTS))
        records = [record(row) for row in parts]
        healthy = _ReferenceFlights.of(CURRENT, tuple(records[:before]))
        assert healthy is not None
        for one, error in zip(records[before:], own[before:], strict=True):
            shown = wear(one, healthy.nuisances)
            assert shown is not None
            _, bound, rise = healthy.rise(shown, one, 1.0)
            above = (healthy.mean(one) + bound - 1.0) / float(np.hypot(kind.between, error))
            found.append(float(ndtr(-above)) / tail)
            least.append(rise / healthy.mean(one))
    return float(np.mean(found)), float(np.median(least))


def rows(draws: int) -> Iterator[str]:
    """Yield the table, row by row: with 10 / 20 flights before."""
    yield "| between flights | own error | recurs | uneven | rougher | alarms over promised | least rise |"
    yield "|---|---|---|---|---|---|---|"
    for kind in KINDS:
        alarms, rises = zip(*(rate(kind, before, draws) for before in (10, 20)), strict=True)
        cells = (
            f"{kind.between:.0%}", f"{kind.own:.1%}", f"{kind.recurs:.0%}", f"{kind.uneven:g}",
            f"{kind.rougher:g}", " / ".join(f"{each:.2f}" for each in alarms),
            f"{' / '.join(f'{100 * each:.0f}' for each in rises)} %",
        )  # fmt: skip
        yield f"| {' | '.join(cells)} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=1000, help="sets of earlier flights a row")
    for line in rows(parser.parse_args().draws):
        print(line, flush=True)


if __name__ == "__main__":
    main()
