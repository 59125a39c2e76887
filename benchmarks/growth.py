"""Growth over flights, asked after every flight: ``python benchmarks/growth.py [--histories N]``.

Histories of one friction, N·m, as `mavhums trend` sees them: a level of 0.225, a scatter from flight to
flight of 3, 5 or 10 %, errors of measurement, a limit at 0.375. With growth: how many are reported 10, 5
and 1 flights before the limit; how many intervals of the flights left hold the truth. Then unrecorded
repairs. Without growth: how many of the histories of 200 flights ever get one. Seeds below 1000 were used
for development.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable

import numpy as np

from benchmarks.trend import following, normal
from mavhums.core.arrays import Array
from mavhums.health.decision.growth import Course, course_of, last_step
from mavhums.health.decision.thresholds import TREND_FLIGHTS

LEVEL, LIMIT, FLIGHTS = 0.225, 0.375, 200
SCATTERS = (0.03, 0.05, 0.10)
BEGINS = (0, 30, 100)


def heavy(rng: np.random.Generator, n: int) -> Array:
    return np.asarray(rng.standard_t(3, n) / np.sqrt(3))


DRAWS: dict[str, Callable[[np.random.Generator, int], Array]] = {
    "normal": normal,
    "Student's t, 3": heavy,
    "following each other": following,
}


def look(truth: Array, scatter: Array, errors: Array, n: int) -> Course | None:
    """Return the course after ``n`` flights, since the last step."""
    values = (truth + scatter)[:n]
    place = last_step(values, errors[:n])
    return course_of(np.arange(1.0, n + 1), values, errors[:n], begin=place or 0)


def history(rng: np.random.Generator, truth: Array, share: float, draw: str) -> tuple[Array, Array]:
    n = len(truth)
    errors = 0.002 * rng.uniform(0.7, 1.8, n)
    return LEVEL * share * DRAWS[draw](rng, n) + errors * rng.standard_normal(n), errors


def without(histories: int, first: int, every: int) -> None:
    print(f"without growth, {histories} histories of {FLIGHTS} flights, asked after every {every}:")
    for draw in DRAWS:
        for share in SCATTERS:
            grown = stepped = 0
            for seed in range(histories):
                rng = np.random.default_rng([first + seed, 1])
                truth = np.full(FLIGHTS, LEVEL)
                scatter, errors = history(rng, truth, share, draw)
                looks = range(TREND_FLIGHTS, FLIGHTS + 1, every)
                grown += any((one := look(truth, scatter, errors, n)) and one.grows for n in looks)
                stepped += any(last_step((truth + scatter)[:n], errors[:n]) is not None for n in looks)
            print(f"  {draw}, {share:.0%}: growth {grown}, a step {stepped}", flush=True)


def growing(histories: int, first: int) -> None:
    print(
        f"Growth reported 10 / 5 / 1 flights before the limit; truth inside, 5 before; {histories} a row:\n"
    )
    scatters = " | ".join(f"scatter {share:.0%}" for share in SCATTERS)
    print(f"| growth after | flights to the limit | {scatters} | truth inside |")
    print("|---" * (len(SCATTERS) + 3) + "|")
    for begin in BEGINS:
        for flights in (20, 30, 50, 100):
            cells, hits = [], []
            for share in SCATTERS:
                found, inside = _reported(histories, first, share, begin, flights)
                cells.append(f"{' / '.join(f'{100 * part:.0f}' for part in found)} %")
                hits.append(f"{100 * np.mean(inside):.0f}" if inside else "–")
            row = " | ".join([str(begin), str(flights), *cells, f"{' / '.join(hits)} %"])
            print(f"| {row} |", flush=True)
    print()


def _reported(
    histories: int, first: int, share: float, begin: int, flights: int
) -> tuple[list[float], list[bool]]:
    """Return the shares that report growth 10, 5 and 1 flights before, and which intervals hold the truth."""
    reported = np.zeros((histories, 3))
    inside: list[bool] = []
    n = begin + flights
    for seed in range(histories):
        rng = np.random.default_rng([first + seed, 2, flights, begin])
        truth = LEVEL + (LIMIT - LEVEL) / flights * np.maximum(np.arange(1.0, n + 1) - begin, 0)
        scatter, errors = history(rng, truth, share, "normal")
        for k, left in enumerate((10, 5, 1)):
            one = look(truth, scatter, errors, n - left)
            reported[seed, k] = one is not None and one.grows
            if one is not None and one.grows and left == 5:
                low, _, high = one.flights_left(LIMIT)
                inside.append(low <= left <= high)
    return reported.mean(axis=0).tolist(), inside


def repaired(histories: int, first: int) -> None:
    print(f"0.24 N·m less after an unrecorded repair, the same wear of 0.006 a flight, {histories} a row:")
    for share in SCATTERS:
        steps, again = [], []
        for seed in range(histories):
            rng = np.random.default_rng([first + seed, 3])
            truth = LEVEL + 0.006 * np.concatenate([np.arange(40.0), np.arange(40.0)])
            scatter, errors = history(rng, truth, share, "normal")
            places = [last_step((truth + scatter)[:n], errors[:n]) for n in range(41, 81)]
            steps.append(next((k + 1 for k, place in enumerate(places) if place == 40), 99))
            again.append(
                next(
                    (n for n in range(1, 41) if (one := look(truth, scatter, errors, 40 + n)) and one.grows),
                    99,
                )
            )
        print(
            f"  {share:.0%}: step reported after {np.median(steps):.0f} flights (median), most {max(steps)};"
            f" growth again after {np.median(again):.0f}, most {max(again)}",
            flush=True,
        )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--histories", type=int, default=100)
    parser.add_argument("--first", type=int, default=5000, help="first seed")
    parser.add_argument("--every", type=int, default=1, help="look after every so many flights")
    given = parser.parse_args()
    growing(given.histories, given.first)
    repaired(given.histories, given.first)
    without(given.histories, given.first, given.every)


if __name__ == "__main__":
    main()
