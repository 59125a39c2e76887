"""The minutes of a flight beside earlier flights, with sums of products of known gains."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime

import numpy as np
import pytest

from mavhums.core.statistics import NORMAL_95
from mavhums.health.axis.past import compare_response
from mavhums.health.axis.response import RESPONSE, Stretch, stretches
from mavhums.health.estimation.least_squares import packed
from mavhums.health.estimation.thresholds import WINDOW_S
from mavhums.results.verdict import Coverage, OwnRecord, Verdict
from tests.health.builders import verdict
from tests.present import present

PAST_FLIGHTS = 5
WINDOW_DEVIATION = 0.1
SPEED = 20.0
PARTS = 60 // WINDOW_S


def record(gains: Sequence[float], drive2: float = 1.0, seconds: float = WINDOW_S) -> OwnRecord:
    """Return the record of a flight with these gains in its parts, apart from which nothing responds."""
    groups = []
    for k, gain in enumerate(gains, start=1):
        gram = np.eye(4)  # drive, two others, response
        gram[0, 0], gram[0, 3], gram[3, 3] = drive2, gain * drive2, gain**2 * drive2
        gram[3, 0] = gram[0, 3]
        groups.append((float(seconds), k * seconds, SPEED, *packed(gram)))
    return OwnRecord(
        equation=RESPONSE, setup="sensor", rate_hz=10.0, duration_s=len(gains) * seconds, groups=tuple(groups)
    )


def mixed(other: float, together: float) -> OwnRecord:
    """Return the record of a flight with gain 2 whose response has a share of another column.

    ``together`` is the sum of products of that column with the drive.
    """
    gram = np.eye(4)
    gram[0, 1] = gram[1, 0] = together
    gram[:3, 3] = gram[3, :3] = gram[:3, :3] @ [2.0, other, 0.0]
    rows = [(float(WINDOW_S), float(k * WINDOW_S), SPEED, *packed(gram)) for k in range(1, PARTS + 1)]
    return record([1.0]).model_copy(update={"groups": tuple(rows)})


def past(*gains: float, drive2: float = 1.0) -> list[tuple[OwnRecord]]:
    return [(record([gain] * PARTS, drive2),) for gain in gains]


PAST = past(*[2.0] * PAST_FLIGHTS)


def found(own: OwnRecord, before: list[tuple[OwnRecord]] = PAST) -> list[Stretch]:
    return [*stretches([own], before)]


def test_the_error_is_the_scatter_of_the_parts_beside_that_of_windows() -> None:
    spread = 0.2
    [minute] = found(record([2.0 * (1.0 + spread), 2.0 * (1.0 - spread)] * (PARTS // 2)))
    value = minute.compared.indicator.value
    assert value.estimate == pytest.approx(1.0)
    error = (spread**2 / (PARTS - 1) + WINDOW_DEVIATION**2 / PARTS) ** 0.5
    assert (value.high - value.low) / 2 == pytest.approx(NORMAL_95 * error, rel=1e-4)
    for parts, windows in ((PARTS, PARTS * WINDOW_S), (1, 2 * WINDOW_S)):
        [minute] = found(record([2.0] * parts, seconds=60 / parts))
        shown = minute.compared.indicator
        error = WINDOW_DEVIATION / parts**0.5
        assert shown.windows == windows
        assert shown.scatter == pytest.approx(error * windows**0.5, rel=1e-3)


def test_what_others_do_to_the_response_is_no_gain() -> None:
    """How much they do is known from the earlier flights, in which they were apart from the drive."""
    [minute] = found(mixed(0.7, 0.5), [(mixed(0.7, 0.0),)] * PAST_FLIGHTS)
    assert minute.compared.indicator.value.estimate == pytest.approx(1.0)
    [minute] = found(mixed(0.9, 0.5), [(mixed(0.7, 0.0),)] * PAST_FLIGHTS)
    assert minute.compared.indicator.value.estimate == pytest.approx((2.0 + 0.5 * (0.9 - 0.7)) / 2.0)


def test_a_minute_ends_with_its_last_part() -> None:
    own = record([2.0] * 6)
    lengths = [20.0, 10.0, 30.0, 15.0, 5.0, 30.0]
    ends = np.cumsum(lengths) + 100.0
    ends[3:] += 7.0  # a pause between the minutes
    parts = [(n, float(end), *row[2:]) for n, end, row in zip(lengths, ends, own.groups, strict=True)]
    minutes = found(own.model_copy(update={"groups": tuple(parts)}))
    assert [(one.start_s, one.end_s, one.seconds) for one in minutes] == [(100, 160, 60), (160, 217, 50)]


@pytest.mark.parametrize(("share", "shown"), [(0.99, 1), (1.01, 0)])
def test_a_minute_with_a_large_error_shows_nothing(share: float, shown: int) -> None:
    own = (share * 0.2) ** 2 - WINDOW_DEVIATION**2 / PARTS
    spread = (own * (PARTS - 1)) ** 0.5
    assert len(found(record([2.0 * (1.0 + spread), 2.0 * (1.0 - spread)] * (PARTS // 2)))) == shown


def test_a_minute_is_as_certain_as_the_earlier_flights_at_best() -> None:
    spread = 0.2
    scattered = [(record([2.0 * (1.0 + spread), 2.0 * (1.0 - spread)] * (PARTS // 2)),)] * PAST_FLIGHTS
    [minute] = found(record([2.0] * PARTS), scattered)
    value = minute.compared.indicator.value
    error = (spread**2 / (PARTS - 1) + WINDOW_DEVIATION**2 / PARTS) ** 0.5
    assert (value.high - value.low) / 2 == pytest.approx(NORMAL_95 * error, rel=1e-4)


@pytest.mark.parametrize(("share", "driven"), [(1.0, True), (0.999, False)])
def test_a_minute_is_driven_from_a_share_of_the_usual_drive_on(share: float, driven: bool) -> None:
    [minute] = found(record([2.0] * PARTS, 0.5 * share))
    assert minute.is_driven is driven


@pytest.mark.parametrize(("seconds", "driven"), [(45, True), (44, False)])
def test_a_short_minute_is_not_driven(seconds: int, driven: bool) -> None:
    [minute] = found(record([2.0] * 5, drive2=10.0, seconds=seconds / 5))
    assert (minute.seconds, minute.is_driven) == (seconds, driven)


def test_only_earlier_flights_with_more_than_one_driven_part_count() -> None:
    assert found(record([2.0] * PARTS), [*PAST[1:], (record([2.0, 2.0]),)])
    one, still = record([2.0]), record([0.0], drive2=0.0)
    for groups in (one.groups, (*one.groups, *still.groups)):
        assert not found(record([2.0] * PARTS), [*PAST[1:], (one.model_copy(update={"groups": groups}),)])


def test_only_so_many_earlier_flights_count() -> None:
    usual, other = past(*[2.0] * 20), past(3.0, 3.0, 3.0)
    [minute] = found(record([2.0] * PARTS), [*usual, *other])
    assert minute.compared.baseline.flights == 20
    assert minute.compared.indicator.value.estimate == pytest.approx(1.0)


def test_earlier_flights_whose_gains_contradict_each_other_are_no_baseline() -> None:
    """The strongest drive tells the usual gain, and most flights another sign."""
    strong = past(2.0, drive2=100.0)
    assert found(record([2.0] * PARTS), [*strong, *past(*[2.0] * (PAST_FLIGHTS - 1))])
    assert not found(record([2.0] * PARTS), [*strong, *past(*[-2.0] * (PAST_FLIGHTS - 1))])
    assert not found(record([2.0] * PARTS), past(*[0.0] * PAST_FLIGHTS))


def beside(before: Verdict) -> Verdict:
    start = datetime(2026, 3, 1, 9, tzinfo=UTC)
    return compare_response(before, PAST, others=(), start_utc=start, false_alarms=1.0)


@pytest.mark.parametrize(
    ("left", "since_s", "over"), [(1.0, 120.0, True), (0.78, 120.0, True), (0.72, 0.0, False)]
)
def test_a_loss_is_over_when_a_later_minute_excludes_one(left: float, since_s: float, over: bool) -> None:
    """Of 78 % in that minute a loss of 40 % is excluded, of 72 % not: the one before stands."""
    own = record([0.3 * 2.0] * (2 * PARTS) + [left * 2.0] * PARTS)
    found = beside(verdict(subject="axis", own=(own,)))
    assert (found.condition, found.worst) == ("normal" if over else "emergency", "emergency")
    assert present(found.effectiveness).estimate == pytest.approx(left if over else 0.3)
    assert present(found.since).flight_time_s == since_s


def test_a_loss_is_told_at_its_worst_and_as_it_was_last() -> None:
    """From the first minute that shows one to the last; the one after it neither shows nor excludes one."""
    shares = (1.0, 0.4, 0.2, 0.3, 0.7)
    own = record([2.0 * share for share in shares for _ in range(PARTS)])
    coverage = Coverage(windows=420, decidable=100, moving_fraction=0.0)
    before = verdict(subject="axis", own=(own,), coverage=coverage)
    found = beside(before)
    [evidence] = found.evidence
    assert (found.condition, evidence.value) == ("emergency", 0.2)
    assert (evidence.start_s, evidence.end_s) == (60.0, 240.0)
    assert evidence.rule.startswith(f"emergency: 20 % of the control effectiveness of {PAST_FLIGHTS} earlier")
    assert evidence.rule.endswith("from 60 s to 240 s")
    assert present(found.effectiveness).estimate == pytest.approx(0.3)
    seen = found.coverage
    assert (seen.windows, seen.decidable, seen.moving_fraction) == (420, 300, 0.7143)
    assert (seen.excluded, seen.excluded_until_s) == (60, 60.0)
    over = before.model_copy(update={"worst": "degraded"})
    assert beside(over) == over
