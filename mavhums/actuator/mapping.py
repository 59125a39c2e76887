"""Mapping of message fields to V1–V12 of each actuator, with the provenance of each quantity.

Sources are read, aligned on one clock and completed: :mod:`~mavhums.actuator.telemetry`,
:mod:`~mavhums.actuator.align`, :mod:`~mavhums.actuator.derive`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from mavhums.actuator.align import Aligned, Aligner
from mavhums.actuator.derive import REPORTED, Deriver
from mavhums.actuator.draft import Announcement, Draft, announcements
from mavhums.actuator.plausibility import NOT_USED, Freshness, Gate, OneServo, Travel
from mavhums.actuator.profile import Actuator, Airframe, load_airframe
from mavhums.actuator.telemetry import TIERS, Reading, Tier, best_tier, read, tiers_by_content
from mavhums.core.arrays import Array, Flags, Integers
from mavhums.core.quantities import KEYS, column
from mavhums.log import Table
from mavhums.log.base.decoder import LOOSE_TIME
from mavhums.results.reasons import Reason
from mavhums.vehicle.formats import SERVO_SOURCES

if TYPE_CHECKING:
    pass


MAGNITUDES = [column(key) for key in ("V4", "V5", "V7")]
"""Columns of the quantities that some sources give without their sign."""
_DERIVED = {"V4": ("V6",), "V5": ("V6", "V8", "V9"), "V7": ("V2", "V3", "V9", "V10", "V12")}
_FOLLOWS = [(column(source), [column(key) for key in derived]) for source, derived in _DERIVED.items()]
"""What the deriver computes from a quantity: when that is refused, so are these."""
_TRUST = tuple(tier.name for tier in TIERS)


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Quantities V1…V12 of one actuator: ``time_s`` of shape (n,), ``values`` of shape (n, 12).

    A quantity that the log does not carry is NaN; ``measured``, of its shape, is False where it is derived.
    """

    vehicle: int
    actuator: str
    time_s: Array
    values: Array
    measured: Flags


@dataclass(frozen=True, slots=True)
class AirframeNamed:
    """The profile in use from here on for a vehicle (for all vehicles if None)."""

    time_s: float
    vehicle: int | None
    airframe: Airframe


@dataclass(frozen=True, slots=True, eq=False)
class MappedSamples:
    """New samples of one actuator.

    Attributes
    ----------
    utc_us, values
        Shape (n,), and V1…V12 of shape (n, 12).
    measured
        Which of the values the log carries and which were derived, shape (n, 12).
    bus_v
        Voltage of the supply bus, V, shape (n,); None unless an ESC measures there.
    magnitudes
        Of V4, V5 and V7, shape (n, 3), from a source without signs; V4 and V5 are NaN if it measures at the
        supply bus. None if the source is signed.
    refused
        Which are no evidence, shape (n, 12): see :mod:`~mavhums.actuator.plausibility`; None if all are.
    """

    vehicle: int
    actuator: Actuator
    utc_us: Integers
    values: Array
    measured: Flags
    bus_v: Array | None = None
    magnitudes: Array | None = None
    refused: Flags | None = None

    def evidence(self) -> MappedSamples:
        """Return the samples without the values that are no evidence."""
        if self.refused is None:
            return self
        values, magnitudes = np.where(self.refused, np.nan, self.values), self.magnitudes
        if magnitudes is not None:
            magnitudes = np.where(self.refused[:, MAGNITUDES], np.nan, magnitudes)
        return replace(self, values=values, magnitudes=magnitudes)


class ActuatorMapper:
    """Converts the readings of one actuator of one vehicle to samples.

    Attributes
    ----------
    tier
        Tier of the source that gives the actuator its clock; None before any.
    """

    def __init__(self, vehicle: int, actuator: Actuator) -> None:
        self.vehicle, self.actuator = vehicle, actuator
        self.aligner = Aligner(_TRUST, actuator.response_lag_s)
        self.deriver = Deriver(actuator)
        self.gate = Gate(actuator)
        self.freshness = Freshness(actuator.min_rate_hz)
        self.one_servo = OneServo()
        self.travel = Travel() if actuator.travel_deg is None and "V1" not in actuator.fields else None
        self.tier: str | None = None
        self._used: list[Integers] = []  # values of each quantity from each source

    def feed(
        self, readings: Sequence[Reading], *, loose: Integers | None, final: bool
    ) -> Iterator[MappedSamples]:
        """Yield the samples that these readings complete."""
        admitted = [reading._replace(values=self.gate.admit(reading.values)) for reading in readings]
        self.one_servo.feed(admitted, loose)
        for aligned in self.aligner.feed(admitted, loose=loose, final=final):
            self._note(aligned)
            values = self.deriver.complete(aligned)
            measured = aligned.origin >= 0
            if self.travel is not None:
                by_pulse = np.array([source.tier == "pwm" for source in self.aligner.sources])
                if self.travel.scale(values, measured & by_pulse[aligned.origin]):
                    self.deriver.derived["V1"] = "{V1}, scaled to {V3}"
                elif not np.isfinite(values).any():
                    continue  # pulses alone, which have no angle
            if not aligned.signed:  # a magnitude's sign is derived
                measured[:, MAGNITUDES] = False
            magnitudes = None if aligned.signed else aligned.values[:, MAGNITUDES]
            at_bus = self.actuator.esc_side == "bus" and aligned.tier.startswith(REPORTED)
            if at_bus and magnitudes is not None:
                magnitudes[:, :2] = np.nan
            bus_v = aligned.values[:, column("V4")] if at_bus else None
            refused = None if at_bus else self._not_evidence(aligned, measured)
            yield MappedSamples(
                self.vehicle, self.actuator, aligned.utc_us, values, measured, bus_v, magnitudes, refused
            )

    def _note(self, aligned: Aligned) -> None:
        """Record the source of each quantity."""
        self.tier = aligned.tier
        for place in range(len(self.aligner.sources)):
            if place == len(self._used):
                self._used.append(np.zeros(len(KEYS), dtype=np.int64))
            self._used[place] += np.count_nonzero(aligned.origin == place, axis=0)

    def _not_evidence(self, aligned: Aligned, measured: Flags) -> Flags | None:
        """Return which values are no evidence, with those that follow from them; None if none is refused."""
        refused = self.freshness.feed(aligned.utc_us, aligned.values)
        if not refused.any():
            return None
        for source, derived in _FOLLOWS:
            refused[:, derived] |= refused[:, [source]] & ~measured[:, derived]
        # Without the current, the voltage equation gives a magnitude of the voltage no sign.
        if not aligned.signed:
            refused[:, column("V4")] |= refused[:, column("V5")]
        return refused

    @property
    def obstacle(self) -> Reason | None:
        """The reason where the telemetry is not that of one servo which answers; else None."""
        if self.one_servo.shared:
            return Reason("shared_id")
        return Reason("never_follows") if self.travel and self.travel.never_follows else None

    @property
    def implausible(self) -> dict[str, tuple[int, int]]:
        """By quantity, the number of implausible values and the number of all values.

        Implausible values, which no such actuator can have, count as not measured.
        """
        counts = zip(KEYS, self.gate.refused.tolist(), self.gate.given.tolist(), strict=True)
        return {key: (refused, given) for key, refused, given in counts if refused}

    @property
    def refused(self) -> dict[str, str]:
        """Why a quantity that the log carries is no evidence, by key."""
        return self.freshness.reasons() if self.actuator.esc_side == "motor" else {}

    @property
    def provenance(self) -> dict[str, str]:
        """The message field that gave each quantity most often, or its derivation."""
        fields: dict[str, str] = {}
        for key in KEYS:
            used = [int(counts[column(key)]) for counts in self._used]
            if any(used):
                origin = self.aligner.sources[used.index(max(used))]
                fields[key] = f"{origin.name}.{origin.fields[key]}"
        merged = {key: source for key, source in fields.items() if key not in self.deriver.dropped}
        for key, how in self.deriver.derived.items():
            if "{" in how or key not in fields:  # the braces name a quantity whose field is meant
                source = re.sub(r"\{(V\d+)\}", lambda match: fields.get(match[1], match[1]), how)
                merged[key] = f"derived: {source}"
        for key, why in self.refused.items():
            if key in merged:
                merged[key] += NOT_USED.format(why)
        return {key: merged[key] for key in KEYS if key in merged}


class Mapper:
    """Maps tables of messages to samples of the profile's actuators, block after block.

    Parameters
    ----------
    airframe
        The profile.
    vehicle
        System id of the vehicle that the profile is for; None if it is for every vehicle.
    from_frame
        Messages before this one are ignored: the profile was not known then.
    """

    def __init__(self, airframe: Airframe, *, vehicle: int | None = None, from_frame: int = 0) -> None:
        self.airframe = airframe
        self._vehicle = vehicle
        self._from_frame = from_frame
        self._tracks: dict[tuple[int, str], ActuatorMapper] = {}

    def feed(self, tables: Mapping[str, Table], *, final: bool = False) -> list[MappedSamples]:
        """Return the samples that these messages complete, in time order for each actuator.

        Their times are those of their senders' clocks, see :class:`mavhums.vehicle.clocks.Clocks`. ``final``
        marks the end of the log.
        """
        tables = {name: self._ours(table) for name, table in tables.items()}
        frames = [table.frame[(table.flags & LOOSE_TIME) > 0] for table in tables.values()]
        loose = np.concatenate(frames) if frames else None
        by_track: dict[tuple[int, str], list[Reading]] = {key: [] for key in self._tracks}
        for reading in read(tables, self.airframe.actuators):
            by_track.setdefault((reading.vehicle, reading.actuator.name), []).append(reading)
        out: list[MappedSamples] = []
        for key, readings in by_track.items():
            if not readings and not final:
                continue  # its messages cannot complete further samples
            if key not in self._tracks:
                self._tracks[key] = ActuatorMapper(key[0], readings[0].actuator)
            out += self._tracks[key].feed(readings, loose=loose, final=final)
        return out

    def serves(self, vehicle: int | None) -> bool:
        """Return whether the profile is for this vehicle."""
        return self._vehicle is None or self._vehicle == vehicle

    def of(self, vehicle: int, actuator: Actuator) -> ActuatorMapper:
        """Return what is known of the telemetry of an actuator; nothing before its first readings."""
        return self._tracks.get((vehicle, actuator.name)) or ActuatorMapper(vehicle, actuator)

    def _ours(self, table: Table) -> Table:
        if self._vehicle is None and self._from_frame == 0:
            return table
        ours = table.frame >= self._from_frame
        if self._vehicle is not None:
            ours &= table.system == self._vehicle
        return table.select(ours)


def messages_for(actuators: Sequence[Actuator] = ()) -> frozenset[str]:
    """Return the message types that sources read; those that profiles map are added.

    Examples
    --------
    >>> "DEBUG_FLOAT_ARRAY" in messages_for()
    True
    """
    configured = {mapping.message for actuator in actuators for mapping in actuator.fields.values()}
    return frozenset(configured).union(source.message for source in SERVO_SOURCES)


class VehicleMappers:
    """Follows the vehicles of a log, block after block.

    Parameters
    ----------
    airframe
        The profile for every vehicle; if None, each vehicle is mapped by the profile that it names, from
        there on, or else by one that is drafted from its parameters.

    Attributes
    ----------
    drafts
        The drafted profiles in use, by vehicle.
    """

    def __init__(self, airframe: Airframe | None = None) -> None:
        self._given = airframe
        self._mappers = [] if airframe is None else [Mapper(airframe)]
        self._tiers: set[tuple[int, str]] = set()
        self.drafts: dict[int, Draft] = {}

    @property
    def airframes(self) -> list[str]:
        """Names of the profiles in use."""
        return list(dict.fromkeys(mapper.airframe.name for mapper in self._mappers))

    def listen(self, tables: Mapping[str, Table]) -> Iterator[tuple[Announcement, Airframe | None]]:
        """Yield the vehicles' profile messages, and the profile used; None if it is not known."""
        self._tiers |= tiers_by_content(tables)
        for said in announcements(tables):
            if self._given is None and (said.vehicle in self.drafts or self.mapper(said.vehicle) is None):
                if said.known:
                    if drafted := self.drafts.pop(said.vehicle, None):
                        self._mappers = [one for one in self._mappers if one.airframe is not drafted.airframe]
                    self._mappers.append(
                        Mapper(load_airframe(said.name), vehicle=said.vehicle, from_frame=said.frame)
                    )
                mapper = self.mapper(said.vehicle)
                yield said, mapper.airframe if mapper else None

    def use(self, draft: Draft) -> None:
        """Map a vehicle by a drafted profile."""
        self.drafts[draft.vehicle] = draft
        self._mappers.append(Mapper(draft.airframe, vehicle=draft.vehicle, from_frame=draft.frame))

    def feed(
        self, tables: Mapping[str, Table], *, final: bool = False
    ) -> Iterator[tuple[Mapper, MappedSamples]]:
        """Yield the samples that these messages complete; ``final`` marks the end of the log."""
        mappers = self._mappers
        if len(mappers) > 1 and not final:
            speak = {system for table in tables.values() for system in np.unique(table.system).tolist()}
            mappers = [mapper for mapper in mappers if any(map(mapper.serves, speak))]
        for mapper in mappers:
            for mapped in mapper.feed(tables, final=final):
                yield mapper, mapped

    def mapper(self, vehicle: int | None) -> Mapper | None:
        """Return the mapper that serves a vehicle, if any."""
        return next((mapper for mapper in self._mappers if mapper.serves(vehicle)), None)

    def tier(self, vehicle: int | None, counts: Mapping[tuple[int, int, str], int]) -> Tier | None:
        """Return the richest tier of a vehicle, given the number of messages by (system, component, name)."""
        messages = {name for system, _, name in counts if system == vehicle}
        return best_tier(messages, {tier for system, tier in self._tiers if system == vehicle})
