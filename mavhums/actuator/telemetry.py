"""Telemetry of the actuators of a profile: its tiers, and the readings of V1…V12 from each source.

:mod:`mavhums.vehicle.formats` says in which messages a log carries each tier. A profile says which servo, ESC
or record belongs to an actuator, and may map further fields of any message.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.profile import Actuator, FieldMapping, ProfileError
from mavhums.actuator.profile_checks import MULTI_ID, wire_mistake
from mavhums.core.arrays import Array, Integers
from mavhums.core.quantities import KEYS, column
from mavhums.log import Table
from mavhums.vehicle.facts import FIRST_UAVCAN_OUTPUT, ServoIds
from mavhums.vehicle.formats import SERVO_SOURCES, remedy, servo_readings
from mavhums.vehicle.formats.base import each

TO_BE_JUDGED = remedy("servo telemetry")
"""How to record a log from which health can be judged."""


@dataclass(frozen=True, slots=True)
class Tier:
    """One way in which a log carries actuator telemetry.

    Attributes
    ----------
    gives
        Which quantities it gives.
    judged
        Whether health can be judged from it.
    from_esc
        Whether the messages are those of any ESC, which on most aircraft drives a propeller.
    names_servo
        Whether the messages name their servo, so that no profile need name it.
    """

    name: str
    gives: str
    judged: bool = True
    from_esc: bool = False
    names_servo: bool = False


# In the order of trust: what a servo reports of itself comes before what its ESC does, signed values before
# magnitudes, which need the voltage equation for their signs, and a command says least.
TIERS: tuple[Tier, ...] = (
    Tier("instrumented", "V1–V12", names_servo=True),
    Tier("csrv", "V1, V3, V4, V5 and V10, as far as the servo reports them", names_servo=True),
    Tier(
        "esc-signed",
        "V4, V5 and V7 with their signs, where an ESC drives a servo and no propeller",
        from_esc=True,
    ),
    Tier("named", "the quantities that are named", names_servo=True),
    Tier(
        "esc-unsigned",
        "magnitudes of V4, V5 and V7, where an ESC drives a servo and no propeller",
        from_esc=True,
    ),
    Tier("pwm", "V1, the command, alone", judged=False),
)
"""The tiers, the richest first."""


def tier_named(name: str) -> Tier:
    """Return a tier by its name.

    Examples
    --------
    >>> tier_named("pwm").judged
    False
    """
    return next(tier for tier in TIERS if tier.name == name)


def best_tier(messages: Collection[str], marked: Collection[str] = ()) -> Tier | None:
    """Return the richest tier that a vehicle's messages allow, None if they carry nothing.

    ``marked`` names tiers that were recognised by what messages contain: a debug array or a named value
    counts only if it is named as telemetry of an actuator.

    Examples
    --------
    >>> best_tier({"HEARTBEAT", "SERVO_OUTPUT_RAW"}).name
    'pwm'
    """
    carried = {s.tier for s in SERVO_SOURCES if s.marked is None and s.message in messages}
    return next((tier for tier in TIERS if tier.name in carried or tier.name in marked), None)


def tiers_by_content(tables: Mapping[str, Table]) -> set[tuple[int, str]]:
    """Return (vehicle, tier) for the tiers that only the contents of messages identify."""
    found: set[tuple[int, str]] = set()
    for source in SERVO_SOURCES:
        if source.marked is not None and source.message in tables:
            table = tables[source.message]
            vehicles = set(table.system[source.marked(table)].tolist())
            found.update((int(vehicle), source.tier) for vehicle in vehicles)
    return found


_PULSES_US: Final = (500.0, 2500.0)
"""Pulses that are a command. Wider than those of an output in use: a servo may be calibrated to more."""
NOMINAL_TRAVEL_DEG: Final = (-45.0, 45.0)
"""What replaces the travel that a profile lacks, until :mod:`~mavhums.actuator.plausibility` knows it."""
_UAVCAN: Final = (0.0, 1000.0)  # PX4 sends the same command there as 0 to 1000


class Reading(NamedTuple):
    """New values from one source: an instance of a message.

    Attributes
    ----------
    source
        Name of the source in verdicts, for example ``DEBUG_FLOAT_ARRAY[EMA,3]``.
    tier
        Name of the telemetry tier.
    fields
        Message field of each quantity that the source can give, by key.
    frame
        Positions of the messages in the log, shape (n,), increasing.
    utc_us
        Times, microseconds of UTC, shape (n,).
    values
        V1…V12, shape (n, 12); NaN for quantities that are not given.
    signed
        Whether the values are signed; otherwise they are magnitudes.
    """

    vehicle: int
    actuator: Actuator
    source: str
    tier: str
    fields: Mapping[str, str]
    frame: Integers
    utc_us: Integers
    values: Array
    signed: bool = True


def in_columns(keys: Sequence[str], values: Array) -> Array:
    """Return V1…V12, shape (n, 12), with the values (n, k) of these quantities and NaN elsewhere."""
    out = np.full((len(values), len(KEYS)), np.nan)
    out[:, [column(key) for key in keys]] = values
    return out


def read(tables: Mapping[str, Table], actuators: Sequence[Actuator]) -> Iterator[Reading]:
    """Yield the readings of the actuators in these messages, those that the profile maps first."""
    yield from _mapped(tables, actuators)
    by_servo = {actuator.servo: actuator for actuator in actuators}
    ids = [ServoIds(actuator.servo, actuator.esc, actuator.csrv) for actuator in actuators]
    # A pulse says an angle where the profile gives the travel, or where the log shows it beside the shaft's.
    moved = [one for one in ids if by_servo[one.servo].travel_deg or by_servo[one.servo].ema is None]
    for source in SERVO_SOURCES:
        for found in servo_readings(source, tables, moved if source.tier == "pwm" else ids):
            actuator = by_servo[found.servo]
            if source.tier == "pwm":
                reading = _commanded(actuator, found.values[:, 0])
                if reading is None:
                    continue
                rows, values = reading
                [field] = found.fields.values()
                fields: Mapping[str, str] = {"V1": field}
            else:
                rows, values, fields = slice(None), in_columns([*found.fields], found.values), found.fields
            yield Reading(
                found.vehicle,
                actuator,
                found.source,
                source.tier,
                fields,
                found.frame[rows],
                found.time_us[rows],
                values,
                found.signed,
            )


def _commanded(actuator: Actuator, pulse_us: Array) -> tuple[Any, Array] | None:
    """Return the rows of pulses that are commands, and V1 by the profile's calibration; None without any.

    A pulse beyond its calibration shows no angle. The pulse already contains a reversal.
    """
    low_deg, high_deg = actuator.travel_deg or NOMINAL_TRAVEL_DEG
    least, most = _PULSES_US if actuator.servo < FIRST_UAVCAN_OUTPUT else _UAVCAN
    least, most = max(least, actuator.range_us[0]), min(most, actuator.range_us[1])
    rows = np.flatnonzero((pulse_us >= least) & (pulse_us <= most))
    if not rows.size:
        return None
    angle = np.interp(pulse_us[rows], actuator.pwm_us, (low_deg, 0.0, high_deg))
    return rows, in_columns(["V1"], angle[:, None])


def _mapped(tables: Mapping[str, Table], actuators: Sequence[Actuator]) -> Iterator[Reading]:
    """Yield a reading for each vehicle, actuator and message of which the profile maps fields."""
    for actuator in actuators:
        groups: dict[tuple[str, str], dict[str, FieldMapping]] = {}
        for key, mapping in actuator.fields.items():
            groups.setdefault((mapping.message, repr(mapping.where)), {})[key] = mapping
        for (message, _), mappings in groups.items():
            if message in tables:
                yield from _mapped_in(tables[message], actuator, mappings)


def _mapped_in(table: Table, actuator: Actuator, mappings: Mapping[str, FieldMapping]) -> Iterator[Reading]:
    for key, mapping in mappings.items():  # an on-board log's own definition of the message decides
        mistake = wire_mistake(mapping.message, mapping.field, mapping.where, table.fields.dtype)
        if mistake is not None:
            problem = f"actuator {actuator.name}: fields.{key}.{mistake.key}: {mistake.problem} in this log"
            raise ProfileError(problem, mistake.remedy)
    where = next(iter(mappings.values())).where
    chosen = np.ones(len(table), dtype=bool)
    for field, wanted in where.items():
        values = _column(table, field)
        chosen &= values == (wanted.encode() if isinstance(wanted, str) else wanted)
    which = ",".join(str(value) for value in where.values())
    with np.errstate(all="ignore"):  # of damaged numbers
        parts = [_column(table, m.field).astype(np.float64) * m.scale + m.offset for m in mappings.values()]
    for vehicle, rows in each(table.system, chosen):
        yield Reading(
            vehicle,
            actuator,
            f"{table.name}[{which}]" if which else table.name,
            "named",
            {key: mapping.field for key, mapping in mappings.items()},
            table.frame[rows],
            table.time_us[rows],
            in_columns([*mappings], np.stack([part[rows] for part in parts], axis=1)),
        )


def _column(table: Table, field: str) -> NDArray[Any]:
    """Return a field, or one element of an array field: ``rpm[2]``."""
    if field in (table.fields.dtype.names or ()):
        return table[field]
    if field == MULTI_ID:
        return table.component
    name, _, element = field.rpartition("[")
    values: NDArray[Any] = table[name]
    return values[:, int(element.rstrip("]"))]
