"""The engine: takes the bytes of a flight, returns events, and returns a verdict per actuator at any time.

It connects the rooms log → actuator → health, for a file and for a link alike, and contains no logic
of its own. The verdicts do not depend on how the input is cut into blocks.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from datetime import UTC, datetime

from mavhums.actuator.mapping import (
    AirframeNamed,
    MappedSamples,
    Mapper,
    Samples,
    VehicleMappers,
    messages_for,
)
from mavhums.actuator.profile import load_airframe
from mavhums.actuator.telemetry import Tier
from mavhums.core.output import as_utf8
from mavhums.engine.actuators import Actuators
from mavhums.engine.axes import MOST_VEHICLES, Axes, VehicleLimit, with_drops
from mavhums.engine.events import Event, Notice
from mavhums.engine.motors import beside_motors
from mavhums.engine.options import EngineOptions
from mavhums.engine.usage import at_full_output, vehicle_usage
from mavhums.engine.vehicle_setup import setup_notices
from mavhums.health.verdict import of_several_senders, with_advice, with_supply
from mavhums.health.verdict.actuator import crowded_out, unjudged_vehicle
from mavhums.health.verdict.axis import named_by_telemetry
from mavhums.log import Decoder, Table
from mavhums.results.assessment import Assessment, LogSummary
from mavhums.results.sections import FlightIdentity, VehicleUsage
from mavhums.results.verdict import ALL, Verdict
from mavhums.vehicle.airspeed import AIRSPEED_MESSAGES
from mavhums.vehicle.arrivals import Received
from mavhums.vehicle.clocks import Clocks
from mavhums.vehicle.events import FlightEvents
from mavhums.vehicle.identity import (
    IDENTITY_MESSAGES,
    Identities,
    Identity,
    date_of_file,
    date_shift_us,
)
from mavhums.vehicle.reported import FAULT_MESSAGES
from mavhums.vehicle.signals import SIGNAL_MESSAGES
from mavhums.vehicle.states import (
    MODE_MESSAGES,
    STATE_MESSAGES,
    TEXT_MESSAGES,
    FlightMode,
    VehicleStates,
    texts,
)
from mavhums.vehicle.vtol import refined_identity


class Engine:
    """Follows a telemetry log or link, block by block, in constant memory.

    Parameters
    ----------
    options
        Profile, models and the like; the defaults if None.

    Examples
    --------
    >>> engine = Engine()
    >>> events = engine.feed(b"") + engine.finish()
    >>> engine.assessment().verdicts[0].reason
    'no vehicle found in this log'
    """

    def __init__(self, options: EngineOptions | None = None) -> None:
        self.options = options = options or EngineOptions()
        airframe = None if options.airframe is None else load_airframe(options.airframe)
        telemetry = messages_for(airframe.actuators if airframe else ())
        self._vehicle_limit = VehicleLimit(telemetry - TEXT_MESSAGES)
        wanted = telemetry | TEXT_MESSAGES | IDENTITY_MESSAGES | AIRSPEED_MESSAGES | FAULT_MESSAGES
        wanted |= STATE_MESSAGES if options.vehicle_states else MODE_MESSAGES
        wanted |= SIGNAL_MESSAGES
        self._events = FlightEvents()
        self._axes = Axes(airframe, self._events, options)
        self._states = VehicleStates(modes_only=not options.vehicle_states)
        self._decoder = Decoder(wanted, dialect=options.dialect, key=options.key)
        self._identities = Identities()
        self._mappers = VehicleMappers(airframe)
        self._clocks = Clocks()
        self._actuators = Actuators(options, self._axes.setups)
        self._options = options
        self._opening: list[Event] = [] if airframe is None else [AirframeNamed(0.0, None, airframe)]

    def feed(self, block: bytes) -> list[Event]:
        """Take the next bytes and return the events that they cause."""
        events = self._opening
        self._opening = []
        return [*events, *self._follow(self._decoder.feed(block))]

    def finish(self) -> list[Event]:
        """End the input; judge the remaining data and return the events."""
        events = [*self.feed(b""), *self._follow(self._decoder.feed(b"", final=True), final=True)]
        events.extend(self._actuators.finish(self._end_s))
        self._events.finish()
        return events

    def assessment(
        self, path: str | None = None, sha256: str | None = None, *, indicators: bool = True
    ) -> Assessment:
        """Return the verdicts on all data so far.

        Without ``indicators``, which evaluate the whole flight again, the call costs next to nothing.
        """
        decoder = self._decoder
        first, last = decoder.first_time_us, decoder.last_time_us
        vehicles = decoder.vehicles or self._identities.vehicles
        messages: dict[int, dict[tuple[int, int, str], int]] = {vehicle: {} for vehicle in vehicles}
        for key, count in decoder.counts.items():
            messages.get(key[0], {})[key] = count
        names = self._mappers.airframes
        mixed = self._clocks.mixed
        alone = [] if vehicles else [*unjudged_vehicle(None, None)]
        for vehicle, sent in messages.items():
            alone += self._of_vehicle(vehicle, self._mappers.tier(vehicle, sent), indicators)
        verdicts = tuple(with_advice(of_several_senders(one, mixed.get(one.vehicle))) for one in alone)
        events, left_out = self._events.gathered(self._axes.by_rotors(), mixed)
        duration_s = 0.0 if first is None or last is None else (last - first) / 1e6
        begun, notices = self.start_utc(), [*self._notices(vehicles)]
        if begun is None and path is not None and (dated := date_of_file(path, duration_s)):
            begun = dated[0]
            notices.append(dated[1])
        voted = {verdict.network.model.hash: verdict.network.model for verdict in verdicts if verdict.network}
        return Assessment(
            log=LogSummary(
                path=None if path is None else as_utf8(path),
                sha256=sha256,
                start_utc=begun.isoformat() if begun else None,
                duration_s=duration_s,
                vehicles=vehicles,
                losses=with_drops(decoder.losses, self._clocks, self._axes),
                format=decoder.format,
                flight=tuple(map(self._identity, vehicles)),
                notices=tuple(notices),
            ),
            airframe=", ".join(names) or None,
            model=next((voted[one.hash] for one in self._options.models if one.hash in voted), None),
            verdicts=verdicts,
            usage=tuple(filter(None, map(self._usage, vehicles))),
            events=events,
            events_left_out=left_out,
        )

    def profiles(self) -> dict[tuple[int, str], str]:
        """Return the name of the profile by which each vehicle's actuators are judged."""
        return dict(self._actuators.profiles)

    def _notices(self, vehicles: tuple[int, ...]) -> Iterator[str]:
        for vehicle in vehicles:
            followed = self._axes.vehicle(vehicle)
            if followed is not None and self._vehicle_limit.admits(vehicle):
                whose = f"vehicle {vehicle}: " if len(vehicles) > 1 else ""
                yield from (
                    f"{whose}{said}" for said in setup_notices(followed.setups.last, followed.surfaces)
                )
                yield from (f"{whose}{said}" for said in at_full_output(followed))
                draft = self._mappers.drafts.get(vehicle)
                if draft is not None:
                    yield f"{whose}{draft.notice}"

    def _usage(self, vehicle: int) -> VehicleUsage | None:
        followed, mapper = self._axes.vehicle(vehicle), self._mappers.mapper(vehicle)
        if followed is None:
            return None
        parameters, airframe = self._axes.parameters(vehicle), mapper.airframe if mapper else None
        return vehicle_usage(self.identity(vehicle), followed, parameters, airframe)

    def _identity(self, vehicle: int) -> FlightIdentity:
        """Return the identity of a vehicle's flight."""
        decoder, shift_us = self._decoder, self._date_shift_us()
        known, (dated_us, logged_us) = self._identities.of(vehicle), self._identities.boot(vehicle)
        booted = (logged_us, shift_us) if dated_us is None else (dated_us, 0)
        times = booted, (decoder.first_time_us, shift_us), (decoder.last_time_us, shift_us)
        boot, start, end = (
            None if t is None or by is None or shift_us is None else _utc(t + by).isoformat()
            for t, by in times
        )
        dates = {"boot_utc": boot, "start_utc": start, "end_utc": end}
        return FlightIdentity(vehicle=vehicle, board=known.board, boots=known.boots, **dates)

    def identity(self, vehicle: int) -> Identity:
        """Return the identity of a vehicle, with the kind that its parameters show."""
        return refined_identity(self._identities.of(vehicle), self._axes.parameters(vehicle).values)

    def mapper(self, vehicle: int) -> Mapper | None:
        """Return the mapper by whose profile a vehicle's actuators are read; None without a profile."""
        return self._mappers.mapper(vehicle)

    def tier(self, vehicle: int) -> Tier | None:
        """Return the richest telemetry that a vehicle sent, of whichever actuator."""
        return self._mappers.tier(vehicle, self._decoder.counts)

    def axes(self, vehicle: int) -> list[Verdict]:
        """Return the verdicts on a vehicle's axes and motors, also where telemetry makes them needless."""
        followed = self._axes.vehicle(vehicle)
        if followed is None or not self._vehicle_limit.admits(vehicle):
            return []
        return [*followed.verdicts(self.identity(vehicle), _utc(self._start_us))]

    def received(self, vehicle: int) -> dict[str, Received]:
        """Return, by message, how many of a vehicle's samples were kept, came late, or came at one time."""
        return self._axes.received(vehicle)

    def _follow(self, tables: Mapping[str, Table], *, final: bool = False) -> Iterator[Event]:
        if not tables and not final:
            return
        admits = self._vehicle_limit.admits
        self._vehicle_limit.observe(tables)
        self._identities.feed(tables)
        tables = self._clocks.feed(tables, admits)
        yield from self._listen(tables)
        self._actuators.hear(tables)
        start_us = self._start_us
        for vehicle, time_s, words in self._events.feed(tables, start_us, admits):
            yield Notice(time_s, vehicle, words)
        for state in self._states.feed(tables, start_us=start_us):
            if isinstance(state, FlightMode) and admits(state.vehicle):
                self._events.of(state.vehicle).add("mode", state.time_s, said=state.mode)
            if self.options.vehicle_states:
                yield state
        yield from self._axes.feed(tables, start_us, admits=admits, final=final)
        for draft in self._axes.drafted():
            self._mappers.use(draft)
            yield AirframeNamed(self._flight_time(draft.time_us), draft.vehicle, draft.airframe)
        settled = list(self._mappers.feed(tables, final=final))
        for vehicle, time_us in self._clocks.jumps():
            if admits(vehicle):
                time_s = self._flight_time(time_us)
                self._events.of(vehicle).add("reboot", time_s)
                yield Notice(time_s, vehicle, "its clock jumped: it rebooted, or its time was set")
        for mapper, mapped in settled:
            if mapped.utc_us.size and admits(mapped.vehicle):
                yield from self._judge(mapper, mapped)

    def _listen(self, tables: Mapping[str, Table]) -> Iterator[Event]:
        """Process the texts of vehicles, and apply the profile of each vehicle that names one."""
        for said, airframe in self._mappers.listen(tables):
            time_s = self._flight_time(said.time_us)
            if airframe is not None:
                self._axes.announce(said.vehicle, said.frame, airframe)
                self._actuators.drop(said.vehicle)
                yield AirframeNamed(time_s, said.vehicle, airframe)
            else:
                yield Notice(time_s, said.vehicle, f"names the unknown airframe {said.name}")
        for spoken in texts(tables):
            if spoken.text and not spoken.text.startswith("mavhums airframe="):
                time_s = self._flight_time(spoken.time_us)
                yield Notice(time_s, spoken.vehicle, spoken.text)
                if self._vehicle_limit.admits(spoken.vehicle):
                    self._events.of(spoken.vehicle).hear_text(time_s, spoken.text)

    def _judge(self, mapper: Mapper, mapped: MappedSamples) -> Iterator[Event]:
        actuator = mapped.actuator.name
        time_s = (mapped.utc_us - self._start_us) / 1e6
        yield Samples(mapped.vehicle, actuator, time_s, mapped.values, mapped.measured)
        self._events.of(mapped.vehicle).hear_source(actuator, time_s)
        yield from self._actuators.feed(mapper.airframe, mapped.evidence(), time_s)

    def start_utc(self) -> datetime | None:
        """Return the start of the flight; None if no clock gives it."""
        first, shift_us = self._decoder.first_time_us, self._date_shift_us()
        return None if first is None or shift_us is None else _utc(first + shift_us)

    def _date_shift_us(self) -> int | None:
        """Return what must be added to the log's times for UTC; None if nothing dates it."""
        decoder = self._decoder
        ahead_us = None if decoder.undated else decoder.ahead_us
        return date_shift_us(self._start_us, ahead_us, self._identities.boots)

    def _of_vehicle(self, vehicle: int, tier: Tier | None, indicators: bool) -> list[Verdict]:
        """Return the verdicts on a vehicle: its actuators first, then its axes."""
        sags = self._events.of(vehicle).rail.sags
        return [with_supply(one, sags) for one in self._alone(vehicle, tier, indicators)]

    def _alone(self, vehicle: int, tier: Tier | None, indicators: bool) -> list[Verdict]:
        actuators = [*self._verdicts(vehicle, tier, indicators)]
        setup = self._axes.setups(vehicle).last
        own = any(
            v.condition != "unmonitored" and v.actuator != ALL and not setup.against(v.actuator)
            for v in actuators
        )
        axes = self.axes(vehicle)
        if own and all(verdict.worst == "undecided" for verdict in axes):
            return actuators  # their own telemetry gives the verdicts
        axes = [*named_by_telemetry(axes, actuators, setup.airframe)]
        return [*beside_motors(actuators, axes), *axes]

    def _verdicts(self, vehicle: int, tier: Tier | None, indicators: bool) -> Iterator[Verdict]:
        mapper = self._mappers.mapper(vehicle)
        if mapper is None:
            followed = self._axes.vehicle(vehicle)
            surfaces = followed.surfaces if followed else None
            yield from unjudged_vehicle(vehicle, tier, self.identity(vehicle), surfaces)
        elif not self._vehicle_limit.admits(vehicle):
            yield crowded_out(vehicle, tier, MOST_VEHICLES)
        else:
            span = _utc(self._start_us), self._end_s(vehicle)
            yield from self._actuators.verdicts(vehicle, mapper, tier, *span, indicators=indicators)

    def _end_s(self, vehicle: int) -> float:
        """Return the flight time of the log's end, by the vehicle's own clock, as all its samples are."""
        return self._flight_time(self._clocks.at_us(vehicle, self._decoder.last_time_us or 0))

    def _flight_time(self, time_us: int) -> float:
        return (time_us - self._start_us) / 1e6

    @property
    def _start_us(self) -> int:
        """The first time of the log, microseconds of UTC; 0 before it."""
        return self._decoder.first_time_us or 0


def _utc(time_us: int) -> datetime:
    return datetime.fromtimestamp(time_us / 1e6, tz=UTC)
