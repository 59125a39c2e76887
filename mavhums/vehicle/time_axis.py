"""One vehicle's time axis: the clocks of its components, with the offset between their two counters.

A component's clock is the flight's time. Its first stamp is anchored to the time of reception; from there the
axis runs as the sender counts and is never bent towards reception, whose delay changes. MAVLink stamps are of
two counters, ``time_boot_ms`` and ``time_usec``; in some autopilots these lie seconds apart.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from mavhums.core.arrays import Integers, Integers1, Integers2, Integers3
from mavhums.core.kernels import kernel, subroutine

UNSTAMPED: Final = -1
BOOT: Final = 0
USEC: Final = 1
"""What a message's stamp counts, or that it has none."""

SOUND: Final = 0
LOOSE: Final = 1
BROKEN: Final = 2
"""What a time is worth: exact, wrong by more than a detector tolerates, or none."""

_BREAK_US: Final = 30_000_000  # more than any latency but an outage: a stamp as far off is no delay
_CONFIRM: Final = 3  # stamps in a row: one or two are damage
_LAP_US: Final = 2**32  # 32 bits of microseconds, as the servo outputs' stamp has, start anew after 71.6 min
_NEIGHBOURS_US: Final = 100_000  # stamps of both counters received within this time give their offset
_OPENING_US: Final = 6_000_000  # before, types with a great latency have not yet been heard
_PERIOD_US: Final = 500_000  # in which every type with a stamp is heard, however often others come
_LEAST_PERIODS: Final = 10  # 5 s; the median of fewer moves with single delays
_MOST_PERIODS: Final = 30  # 15 s: bounds the search for an offset and its memory
_OFFSET_US: Final = 300_000  # types of message differ by tens of ms on real links, two counters by 2.5 s
_SCATTER_US: Final = 600_000  # 10–90 %: an offset is constant, latencies are not
_SPREAD_US: Final = 500_000  # what a comparison of a demand with its answer tolerates
_FORGET_US: Final = 10_000_000.0  # time constant with which a greater spread is forgotten

_SENDERS: Final = 16  # components with clocks of their own; only a forger has more, and each costs memory
_NEVER_US: Final = 2**62
# What is kept of a sender, by column; the last six have two columns each, one per counter.
_SEGMENT, _NEWEST, _HEARD, _OFFSET, _PRIMARY, _LAST_STAMP, _LAST_HEARD, _PERIODS, _SPREAD, _SINCE = range(10)
_PERIOD: Final = 10
_DELTA, _ASTRAY, _KNOWN, _AGREED, _STAMP, _AT = range(11, 23, 2)
_COLUMNS: Final = _AT + 2


class MappedTimes(NamedTuple):
    """Times of messages on the vehicle's axis.

    Attributes
    ----------
    time_us
        Microseconds of UTC, shape (n,).
    worth
        ``SOUND``, ``LOOSE`` or ``BROKEN``, shape (n,).
    segment
        Of each message whose clock has just restarted, the number of its new segment, else 0, shape (n,).
    """

    time_us: Integers
    worth: Integers
    segment: Integers


class VehicleClock:
    """Maps the messages of one vehicle to its time axis, causally, in the order of the log.

    A stamp more than 30 s behind the newest of its sender, or as far ahead of it and of what has passed at
    reception, is broken; three in a row are a reboot or a clock that was set, and a new segment follows the
    old one by the time that passed at reception. A message without a stamp has the newest time of its sender
    plus what has passed at reception since. Messages of a component that never stamps, and
    of components beyond the first sixteen, are on the clock of the vehicle's first component that stamps.

    Examples
    --------
    >>> clock, one = VehicleClock(), np.ones(3, dtype=np.int64)
    >>> stamps, received = np.array([5, 15, 25]), np.array([1000, 1011, 9_000_000])
    >>> clock.map(one, 0 * one + BOOT, stamps, received).time_us.tolist()
    [1000, 1010, 1020]
    """

    def __init__(self) -> None:
        self._slots: dict[int, int] = {}
        self._senders = np.zeros((_SENDERS + 1, _COLUMNS), dtype=np.int64)
        self._pairs = np.zeros((_SENDERS + 1, _MOST_PERIODS, 2), dtype=np.int64)
        self._main = np.full(1, -1, dtype=np.int64)

    def map(
        self, component: Integers, counter: Integers, stamp_us: Integers, received_us: Integers
    ) -> MappedTimes:
        """Return the times of messages in the order of the log; all arrays have shape (n,)."""
        mapped = MappedTimes(*(np.zeros(component.size, dtype=np.int64) for _ in range(3)))
        slot = self._slots_of(component)
        counter = np.where(slot == _SENDERS, UNSTAMPED, counter)
        _follow(slot, counter, stamp_us, received_us, self._senders, self._pairs, self._main, *mapped)
        return mapped

    def _slots_of(self, component: Integers) -> Integers:
        """Return the row of each message's component, the last one for those beyond the first sixteen."""
        found, first, back = np.unique(component, return_index=True, return_inverse=True)
        for k in np.argsort(first).tolist():
            if len(self._slots) < _SENDERS:
                self._slots.setdefault(int(found[k]), len(self._slots))
        slots = np.array([self._slots.get(one, _SENDERS) for one in found.tolist()], dtype=np.int64)
        return slots[back]

    def at_us(self, received_us: int) -> int:
        """Return what the vehicle's clock shows at a time of reception, now or later, microseconds of UTC.

        Of several components with clocks, the one that shows least: what it sent last is then not yet old.
        """
        known = self._senders[self._senders[:, _SEGMENT] > 0]
        passed = np.maximum(received_us - known[:, _HEARD], 0)
        return int((known[:, _NEWEST] + known[:, _OFFSET] + passed).min(initial=_NEVER_US))


@kernel
def _follow(
    component: Integers1,
    counter: Integers1,
    stamp_us: Integers1,
    received_us: Integers1,
    senders: Integers2,
    pairs: Integers3,
    main: Integers1,
    time_us: Integers1,
    worth: Integers1,
    segment: Integers1,
) -> None:
    for row in range(component.size):
        which, kind, received = component[row], counter[row], received_us[row]
        sender = senders[which]
        if kind == UNSTAMPED:
            if sender[_SEGMENT] == 0 and main[0] >= 0:
                sender = senders[main[0]]
            time_us[row] = received
            if sender[_SEGMENT] > 0:
                passed = max(received - sender[_HEARD], 0)
                time_us[row] = sender[_NEWEST] + passed + sender[_OFFSET]
                worth[row] = LOOSE if sender[_SPREAD] > _SPREAD_US else SOUND
            continue
        if main[0] < 0:
            main[0] = which
        before = sender[_SEGMENT]
        known = _stamped(sender, pairs[which], kind, stamp_us[row], received)
        if known:
            time_us[row] = sender[_LAST_STAMP] + sender[_DELTA + kind] + sender[_OFFSET]
        else:
            worth[row] = BROKEN
        if before > 0 and sender[_SEGMENT] > before:
            segment[row] = sender[_SEGMENT]


@subroutine
def _stamped(sender: Integers, pairs: Integers, kind: int, stamp: int, received: int) -> bool:
    """Take a stamp; return whether it is sound. It is then the sender's last one."""
    if sender[_SEGMENT] == 0:
        _begin(sender, kind, stamp, received, received - stamp)
        return True
    expected = sender[_NEWEST] + max(received - sender[_HEARD], 0)
    if kind == USEC:  # read modulo 2³²: nearest to the newest, or after a long silence to what has passed
        lag = sender[_NEWEST] - sender[_DELTA + kind] - stamp
        near = stamp + int(np.rint(lag / _LAP_US)) * _LAP_US
        if abs(near + sender[_DELTA + kind] - sender[_NEWEST]) > _BREAK_US:
            lag = expected - sender[_DELTA + kind] - stamp
            near = stamp + int(np.rint(lag / _LAP_US)) * _LAP_US
        stamp = near
    if sender[_KNOWN + kind] == 0:
        sender[_KNOWN + kind] = 1
        if abs(stamp - expected) > _BREAK_US:  # a counter that began elsewhere, as UTC does
            sender[_DELTA + kind] = expected - stamp
    time = stamp + sender[_DELTA + kind]
    if sender[_NEWEST] - time > _BREAK_US or time - expected > _BREAK_US:
        sender[_ASTRAY + kind] += 1
        if sender[_ASTRAY + kind] == 1:
            sender[_AGREED + 1 - kind] = 0
        if sender[_ASTRAY + kind] < _CONFIRM:
            return False
        if sender[_AGREED + 1 - kind] > 0:  # the other counter runs on: this one was set, nothing rebooted
            sender[_DELTA + kind] = expected - stamp
            time = expected
        else:
            _begin(sender, kind, stamp, received, sender[_OFFSET] + expected - stamp)
            return True
    sender[_ASTRAY + kind] = 0
    sender[_AGREED + kind] = 1
    _compare(sender, pairs, kind, stamp, received)
    time = stamp + sender[_DELTA + kind]
    passed = max(received - sender[_LAST_HEARD], 0)
    spread = sender[_SPREAD] * np.exp(-passed / _FORGET_US)
    sender[_SPREAD] = int(max(spread, sender[_NEWEST] - time))
    sender[_LAST_STAMP], sender[_LAST_HEARD] = stamp, received
    if time > sender[_NEWEST]:
        sender[_NEWEST], sender[_HEARD] = time, received
    return True


@subroutine
def _begin(sender: Integers, kind: int, stamp: int, received: int, offset: int) -> None:
    """Begin a segment at this stamp; what was known of the counters' offset was of the segment before."""
    number = sender[_SEGMENT] + 1
    sender[:] = 0
    sender[_SEGMENT], sender[_OFFSET], sender[_PRIMARY] = number, offset, kind
    sender[_NEWEST] = sender[_LAST_STAMP] = stamp
    sender[_HEARD] = sender[_LAST_HEARD] = sender[_SINCE] = received
    sender[_KNOWN + kind], sender[_STAMP + kind], sender[_AT + kind] = 1, stamp, received


@subroutine
def _compare(sender: Integers, pairs: Integers, kind: int, stamp: int, received: int) -> None:
    """Learn the offset between the counters from neighbours in the order of arrival, once.

    Every message is compared with the last one of the other counter, and the least and the greatest
    difference of each period are kept, so that each type counts, however rare it is. Where only
    some types of a counter lag, these two lie apart: that is latency.
    """
    count = sender[_PERIODS]
    sender[_STAMP + kind], sender[_AT + kind] = stamp, received
    apart = received - sender[_AT + 1 - kind]
    heard = sender[_KNOWN + 1 - kind] == 1 and received - sender[_SINCE] > _OPENING_US
    if count > _MOST_PERIODS or not heard or not 0 <= apart < _NEIGHBOURS_US:
        return
    other = sender[_STAMP + 1 - kind]
    now = stamp - apart
    first = sender[_PRIMARY]
    second = 1 - first
    pair = now - other if kind == first else other - now
    period = (received - sender[_SINCE]) // _PERIOD_US
    if count > 0 and period == sender[_PERIOD]:
        pairs[count - 1, 0] = min(pairs[count - 1, 0], pair)
        pairs[count - 1, 1] = max(pairs[count - 1, 1], pair)
        return
    if _LEAST_PERIODS <= count <= _MOST_PERIODS:
        ordered = np.sort(pairs[:count].ravel())
        scatter = ordered[(9 * 2 * count) // 10] - ordered[2 * count // 10]
        change = ordered[count] - (sender[_DELTA + second] - sender[_DELTA + first])
        if abs(change) > _OFFSET_US and scatter < _SCATTER_US:
            behind = second if change > 0 else first  # moved ahead: what goes back comes late
            sender[_DELTA + behind] += abs(change)
            count = _MOST_PERIODS
    if count < _MOST_PERIODS:
        pairs[count] = pair
    sender[_PERIOD] = period
    sender[_PERIODS] = min(count + 1, _MOST_PERIODS + 1)
