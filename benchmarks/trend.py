"""Accuracy of the predicted remaining useful life in flights: ``python benchmarks/trend.py [--quick]``.

Synthetic histories of one indicator: a line, a standard deviation of 0.008 N·m between flights, of normal
or heavy tails, and measurement errors of 0.0014 to 0.0036 N·m. Counts how often growth is reported, and how
many of the intervals of the flights left contain the true value. benchmarks/growth.py has growth that is
none, growth that begins late, and unrecorded repairs.
"""

from __future__ import annotations

import argparse
import os
import platform
from collections.abc import Callable

import numpy as np
from rich.console import Console
from rich.table import Table

from mavhums.core.arrays import Array
from mavhums.health.decision.growth import course_of

START, EMERGENCY, BETWEEN = 0.225, 0.875, 0.008


def normal(rng: np.random.Generator, n: int) -> Array:
    return rng.standard_normal(n)


def heavy(rng: np.random.Generator, n: int) -> Array:
    return np.asarray(rng.standard_t(5, n) / np.sqrt(5 / 3))


def heavier(rng: np.random.Generator, n: int) -> Array:
    return np.asarray(rng.standard_t(3, n) / np.sqrt(3))


def one_odd(rng: np.random.Generator, n: int) -> Array:
    scatter = rng.standard_normal(n)
    scatter[rng.integers(n)] += rng.choice([-10.0, 10.0])
    return scatter


def following(rng: np.random.Generator, n: int) -> Array:
    """Persistent weather: the effect of a flight has an autocorrelation of one half."""
    scatter = rng.standard_normal(n)
    for k in range(1, n):
        scatter[k] = 0.5 * scatter[k - 1] + np.sqrt(0.75) * scatter[k]
    return scatter


TAILS: dict[str, Callable[[np.random.Generator, int], Array]] = {
    "normal": normal,
    "Student's t, 5": heavy,
    "Student's t, 3": heavier,
    "one flight 10 sd off": one_odd,
    "following each other": following,
}


def left(rng: np.random.Generator, n: int, wear: Array, tails: str) -> tuple[float, float, float] | None:
    errors = 0.002 * rng.uniform(0.7, 1.8, n)
    values = START + wear + BETWEEN * TAILS[tails](rng, n) + errors * rng.standard_normal(n)
    course = course_of(np.arange(1.0, n + 1), values, errors)
    return course.flights_left(EMERGENCY) if course is not None and course.grows else None


def coverage(histories: int) -> Table:
    """Wear has used a part of the margin to the limit; the truth is where the line reaches it."""
    table = titled("Flights left", "scatter of flights", "flights", "wear, N·m", "reported", "truth inside")
    for tails in TAILS:
        for n in (8, 20, 60):
            for worn in (0.25, 0.4):
                rng = np.random.default_rng([n, round(100 * worn), list(TAILS).index(tails)])
                slope = worn / n
                truth = (EMERGENCY - START) / slope - n
                wear = slope * np.arange(1.0, n + 1)
                reported = [one for _ in range(histories) if (one := left(rng, n, wear, tails))]
                inside = [low <= truth <= high for low, _, high in reported]
                hit = f"{100 * np.mean(inside):.1f} %" if len(inside) > histories / 20 else "—"
                table.add_row(tails, str(n), f"{worn:.2f}", share(len(inside), histories), hit)
    return table


def share(count: int, of: int) -> str:
    return f"{100 * count / of:.1f} %"


def titled(title: str, *columns: str) -> Table:
    table = Table(title=title, title_justify="left", box=None, header_style="bold", pad_edge=False)
    for column in columns:
        table.add_column(column, justify="right" if table.columns else "left")
    return table


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="a hundredth of the histories")
    histories = 20 if parser.parse_args().quick else 2000
    console = Console(width=110)
    console.print(
        f"{histories} histories a row; {platform.machine()}, {os.cpu_count()} cores,"
        f" load {os.getloadavg()[0]:.1f}, Python {platform.python_version()}\n"
    )
    with console.status("coverage"):
        table = coverage(histories)
    console.print(table, "")


if __name__ == "__main__":
    main()
