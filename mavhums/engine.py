"""The engine: bytes of a flight in, events out, and a verdict per actuator at any time.

It composes the rooms log → actuator → health, for a file and for a link alike, and has no logic
of its own. However its input is cut into blocks, the verdicts are the same.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from datetime import UTC, datetime

from mavhums.actuator.airframe_name import announcements
from mavhums.actuator.mapping import MESSAGES, Mapped, Mapper, is_instrumented
from mavhums.actuator.profile import Airframe, load_airframe, packaged_airframes
from mavhums.actuator.tiers import Tier, best_tier
from mavhums.assessment import Assessment, LogSummary, ModelSummary, Verdict
from mavhums.events import AirframeNamed, Event, Notice, Samples
from mavhums.health.monitor import Monitor
from mavhums.health.verdict import judged, unjudged_actuator, unjudged_vehicle
from mavhums.learn import Model
from mavhums.log import Decoder, Table
from mavhums.log.vehicles import vehicles_of

__all__ = ["Engine"]


class Engine:
    """Follows a telemetry log or link, block by block, in memory that does not grow with it.

    Parameters
    ----------
    airframe
        The profile for every vehicle; if None, each vehicle is judged by the one that it names.
    model
        Whose network's votes are shown beside the friction, where its card names the airframe.

    Examples
    --------
    >>> engine = Engine()
    >>> events = engine.feed(b"") + engine.finish()
    >>> engine.assessment().verdicts[0].reason
    'no vehicle speaks in this log'
    """

    def __init__(self, airframe: Airframe | None = None, *, model: Model | None = None) -> None:
        self._decoder = Decoder(MESSAGES | {"STATUSTEXT"})
        self._given = airframe
        self._model = model
        self._mappers = [] if airframe is None else [Mapper(airframe)]
        self._opening: list[Event] = [] if airframe is None else [AirframeNamed(0.0, None, airframe)]
        self._monitors: dict[tuple[int, str], Monitor] = {}
        self._instrumented: set[int] = set()
        self._segments: dict[int, int] = {}

    def feed(self, block: bytes) -> list[Event]:
        """Take the next bytes and return what they bring about."""
        events = self._opening
        self._opening = []
        return [*events, *self._follow(self._decoder.feed(block))]

    def finish(self) -> list[Event]:
        """Say that nothing follows; judge what is left."""
        events = [*self.feed(b""), *self._follow(self._decoder.feed(b"", final=True))]
        for monitor in self._monitors.values():
            events.extend(monitor.finish())
        return events

    def assessment(self, path: str | None = None, sha256: str | None = None) -> Assessment:
        """Return the verdicts on all that was fed so far."""
        decoder = self._decoder
        first, last = decoder.first_time_us, decoder.last_time_us
        vehicles = vehicles_of(decoder.counts)
        names = list(dict.fromkeys(mapper.airframe.name for mapper in self._mappers))
        model = self._model if self._model and names == [self._model.card.airframe] else None
        return Assessment(
            log=LogSummary(
                path=path,
                sha256=sha256,
                start_utc=None if first is None else _utc(first).isoformat(),
                duration_s=0.0 if first is None or last is None else (last - first) / 1e6,
                vehicles=vehicles,
                losses=decoder.losses,
            ),
            airframe=", ".join(names) or None,
            model=ModelSummary(name=model.card.name, hash=model.hash) if model else None,
            verdicts=tuple(verdict for vehicle in vehicles or (None,) for verdict in self._verdicts(vehicle)),
        )

    def _follow(self, tables: Mapping[str, Table]) -> Iterator[Event]:
        yield from self._listen(tables)
        if (table := tables.get("DEBUG_FLOAT_ARRAY")) is not None:
            self._instrumented.update(table.system[is_instrumented(table)].tolist())
        for mapper in self._mappers:
            for mapped in mapper.feed(tables):
                yield from self._notice_clock(mapper, mapped)
                yield from self._judge(mapper, mapped)

    def _listen(self, tables: Mapping[str, Table]) -> Iterator[Event]:
        """Heed what vehicles say, and take the profile of each that names one."""
        for said in announcements(tables):
            if self._given is not None or any(mapper.serves(said.vehicle) for mapper in self._mappers):
                continue
            time_s = self._flight_time(said.time_us)
            if said.known:
                airframe = load_airframe(said.name)
                self._mappers.append(Mapper(airframe, vehicle=said.vehicle, from_frame=said.frame))
                yield AirframeNamed(time_s, said.vehicle, airframe)
            else:
                yield Notice(time_s, said.vehicle, f"names the airframe {said.name}, which is not known here")
        texts = tables.get("STATUSTEXT")
        if texts is not None:
            for k, text in enumerate(texts.texts("text")):
                if text and not text.startswith("mavhums airframe="):
                    yield Notice(self._flight_time(int(texts.time_us[k])), int(texts.system[k]), text)

    def _notice_clock(self, mapper: Mapper, mapped: Mapped) -> Iterator[Event]:
        """Say that a vehicle's clock jumped, so that nobody wonders at the gap."""
        segments = mapper.clock_segments(mapped.vehicle)
        if segments > self._segments.get(mapped.vehicle, 1):
            self._segments[mapped.vehicle] = segments
            time_s = self._flight_time(int(mapped.utc_us[-1]))
            yield Notice(time_s, mapped.vehicle, "its clock jumped: it rebooted, or its time was set")

    def _judge(self, mapper: Mapper, mapped: Mapped) -> Iterator[Event]:
        actuator = mapped.actuator
        key = (mapped.vehicle, actuator.name)
        if key not in self._monitors:
            serves = self._model is not None and self._model.card.airframe == mapper.airframe.name
            network = self._model.network if self._model and serves else None
            self._monitors[key] = Monitor(mapped.vehicle, actuator, network)
        time_s = (mapped.utc_us - (self._decoder.first_time_us or 0)) / 1e6
        yield Samples(mapped.vehicle, actuator.name, time_s, mapped.values)
        yield from self._monitors[key].feed(time_s, mapped.values)

    def _verdicts(self, vehicle: int | None) -> Iterator[Verdict]:
        tier = self._tier(vehicle)
        mapper = next((mapper for mapper in self._mappers if mapper.serves(vehicle)), None)
        if vehicle is None or mapper is None:
            yield unjudged_vehicle(vehicle, tier, packaged_airframes())
            return
        for actuator in mapper.airframe.actuators:
            monitor = self._monitors.get((vehicle, actuator.name))
            if monitor is None or tier is None:
                yield unjudged_actuator(vehicle, actuator, tier)
            else:
                yield judged(
                    vehicle,
                    actuator,
                    monitor.findings(),
                    start_utc=_utc(self._decoder.first_time_us or 0),
                    end_s=self._flight_time(self._decoder.last_time_us or 0),
                    provenance=mapper.provenance(vehicle, actuator),
                    tier=tier,
                )

    def _tier(self, vehicle: int | None) -> Tier | None:
        messages = {name for system, _, name in self._decoder.counts if system == vehicle}
        return best_tier(messages, instrumented=vehicle in self._instrumented)

    def _flight_time(self, time_us: int) -> float:
        return (time_us - (self._decoder.first_time_us or 0)) / 1e6


def _utc(time_us: int) -> datetime:
    return datetime.fromtimestamp(time_us / 1e6, tz=UTC)
