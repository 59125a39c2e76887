"""The fits of windows, of the flight so far and of the whole flight are those of the same samples."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from mavhums.health.estimation.equations import Fits
from mavhums.health.estimation.motion import motion
from mavhums.health.estimation.slots import SlotCutter, with_extra_columns
from tests.health.flown import actuator_of, flown, telemetry
from tests.present import present

Array = NDArray[np.float64]
NAMES = ("torque", "voltage", "gear")
SHOWN = ("count", "filled", "coefficients")
SECONDS = 100.0
MOST_PARTS = 32


class Fed(NamedTuple):
    """What was fitted after each block: the windows', the flight's so far, and the whole flight's."""

    windows: dict[str, list[SimpleNamespace]]
    sofar: dict[str, list[SimpleNamespace]]
    whole: dict[str, list[SimpleNamespace]]


def fed(places: Iterable[int]) -> Fed:
    """Feed a healthy flight of a hundred slots, cut at samples."""
    actuator, seen = actuator_of(), telemetry(flown(rate_hz=25.0, seconds=SECONDS, seed=300))
    cutter, fits = SlotCutter(), Fits(actuator, NAMES)
    out = Fed({}, {}, {})
    values = with_extra_columns(seen.values)
    for a, b in itertools.pairwise([0, *places, seen.time_s.size]):
        slots = cutter.feed(seen.time_s[a:b], values[a:b])
        if slots is None:
            continue
        windows, sofar = fits.feed(slots, motion(actuator, slots))
        for part, found in zip(out, (windows, sofar, fits.whole()), strict=True):
            for name in NAMES:
                shown = {key: np.array(getattr(found[name], key)) for key in SHOWN}
                part.setdefault(name, []).append(SimpleNamespace(**shown))
    return out


def joined(found: list[SimpleNamespace], attribute: str) -> Array:
    return np.concatenate([getattr(one, attribute) for one in found])


@pytest.fixture(scope="module")
def by_slots() -> Fed:
    """Fed so that a block brings one slot."""
    return fed(range(25, 2500, 25))


@pytest.mark.parametrize("name", NAMES)
def test_the_whole_flight_is_all_that_was_seen_however_long_it_is(by_slots: Fed, name: str) -> None:
    """It is kept in parts, which are put together again and again; that loses no sample."""
    assert len(by_slots.whole[name]) > 3 * MOST_PARTS
    for k, (sofar, whole) in enumerate(zip(by_slots.sofar[name], by_slots.whole[name], strict=True)):
        assert whole.count == pytest.approx(sofar.count[-1:]), k
        assert whole.coefficients[0] == pytest.approx(sofar.coefficients[-1], rel=1e-6, abs=1e-9), k


def test_the_whole_flight_has_equal_parts(by_slots: Fed) -> None:
    """Up to 32 parts of one slot, up to 64 slots parts of two, and so on: never fewer than half of 32."""
    found = [int(whole.filled[0]) for whole in by_slots.whole["torque"]]
    moved = joined(by_slots.sofar["torque"], "count")
    assert np.diff(moved, prepend=0.0).min() > 0, "a slot without motion would be no part"
    slots = np.arange(1, len(found) + 1)
    longest = np.array([next(n for n in (1, 2, 4, 8) if k <= MOST_PARTS * n) for k in slots])
    assert found == np.ceil(slots / longest).tolist()


@pytest.mark.parametrize("name", NAMES)
def test_a_window_is_its_ten_slots_and_the_flight_all_of_them(by_slots: Fed, name: str) -> None:
    windows, sofar = (joined(part[name], "count") for part in (by_slots.windows, by_slots.sofar))
    before = np.concatenate([np.zeros(10), sofar])[: sofar.size]
    assert windows == pytest.approx(sofar - before)
    first = joined(by_slots.windows[name], "coefficients")[9]
    assert first == pytest.approx(joined(by_slots.sofar[name], "coefficients")[9], rel=1e-6)


def test_a_fit_of_the_whole_flight_stays_what_it_was() -> None:
    actuator, seen = actuator_of(), telemetry(flown(rate_hz=25.0, seconds=40.0))
    cutter, fits = SlotCutter(), Fits(actuator, ("torque",))
    for part in (slice(0, 500), slice(500, None)):
        slots = present(cutter.feed(seen.time_s[part], with_extra_columns(seen.values[part])))
        fits.feed(slots, motion(actuator, slots))
        if part.start == 0:
            whole, before = fits.whole()["torque"], fits.whole()["torque"].count.copy()
    assert np.array_equal(whole.count, before)
    assert fits.whole()["torque"].count > before
