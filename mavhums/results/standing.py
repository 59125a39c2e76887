"""State of an actuator or axis over its flights: condition, growth, steps, and trends of its indicators.

``mavhums trend`` writes the trends as JSON and as a table.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Literal

from pydantic import Field

from mavhums.core.about import NOTICE
from mavhums.core.conditions import SEVERITY, URGENCY, Condition
from mavhums.core.errors import ExitCode
from mavhums.core.models import Contract, Drawn
from mavhums.results.verdict import Interval, Verdict

if TYPE_CHECKING:
    import pandas as pd


class FlightsLeft(Contract):
    """Flights after the last one until a line reaches a limit, with a 95 % interval, and the dates of it.

    ``high`` and ``latest_utc`` are None where the line need not reach it; dates are None where the
    flights do not show how often the aircraft flies, and beyond a hundred years. ``is_far`` means that the
    limit is more than three times as far ahead as the flights reach back, where a straight line is a guess.
    """

    estimate: float
    low: float
    high: float | None
    expected_utc: str | None = None
    earliest_utc: str | None = None
    latest_utc: str | None = None
    is_far: bool = False


class Growth(Contract):
    """A certain growth of an indicator.

    Attributes
    ----------
    fault, quantity, unit
        What grows.
    since_flight, since_utc
        The flight after which it most likely grows.
    per_flight
        Slope of the line since then.
    to_degraded, to_emergency
        None where there is no such limit; 0 flights where the line has reached it.
    """

    fault: str
    quantity: str
    unit: str
    since_flight: int
    since_utc: str
    per_flight: Interval
    to_degraded: FlightsLeft | None
    to_emergency: FlightsLeft | None

    @property
    def ahead(self) -> list[FlightsLeft]:
        """The flights left to each limit that there is."""
        return [left for left in (self.to_degraded, self.to_emergency) if left]

    @property
    def soonest(self) -> float:
        """The fewest flights left to a limit; infinite where there is none."""
        return min((left.estimate for left in self.ahead), default=float("inf"))


class Step(Contract):
    """A change of an indicator between two flights: a repair, a swap, or damage.

    ``flight`` and ``at_utc`` are the first flight after it, ``size`` is how much the indicator changed;
    ``better`` is true if the fault decreased.
    """

    fault: str
    quantity: str
    unit: str
    flight: int
    at_utc: str
    size: float
    better: bool


class Standing(Contract):
    """State of an actuator or axis after its last flight.

    Attributes
    ----------
    condition
        Over the flights: a limit that was crossed stays crossed until a repair, or until five judged flights
        in a row did not cross it.
    last
        The gravest of the last flight alone.
    since_flight, since_utc
        The first flight of the present fault; None where there is none.
    clear_flights
        Judged flights since the last one that showed the fault.
    fault, quantity, unit, value, limit
        The basis of the finding: its quantity in the last flight that shows it, and the limit.
    highest
        The highest estimate of that flight that decided a condition; None where there is none.
    growth
        The one with the fewest flights left; None where nothing certainly grows.
    step
        The last one, if it is one of the last 20 flights.
    reason
        Of the last flight, where nothing was decided or found.
    flights, last_utc, log
        Number of its flights, and date and log of the last one.
    """

    subject: Literal["actuator", "axis", "motor"] = "actuator"
    vehicle: int
    actuator: str
    airframe: str | None
    condition: Condition
    last: Condition
    since_flight: int | None = None
    since_utc: str | None = None
    clear_flights: int = Field(default=0, ge=0)
    fault: str | None = None
    quantity: str | None = None
    unit: str | None = None
    value: Interval | None = None
    highest: float | None = None
    limit: float | None = None
    growth: Growth | None = None
    step: Step | None = None
    reason: str | None = None
    flights: int = Field(ge=1)
    last_utc: str
    log: str | None

    @property
    def is_finding(self) -> bool:
        """Whether somebody must look at it: a fault, or growth."""
        return SEVERITY[self.condition] > SEVERITY["normal"] or self.growth is not None

    @property
    def rank(self) -> tuple[float, float, int, str]:
        """Sort by urgency, growth before what is well, then by the fewest flights left."""
        growth = self.growth
        urgency = max(URGENCY[self.condition], URGENCY["changed"] - 0.5 if growth else 0.0)
        return -urgency, growth.soonest if growth else float("inf"), self.vehicle, self.actuator


class FlightPoints(Contract):
    """An indicator in the flights that show it, by columns: the nth value of each is of the nth such flight.

    Attributes
    ----------
    flight
        Counts the actuator's flights from 1, judged or not.
    estimate, low, high
        Over the whole flight, with the 95 % interval.
    highest, end
        The highest estimate that decided a condition, and the last one; None where the flight has none.
    """

    flight: tuple[int, ...]
    start_utc: tuple[str, ...]
    log: tuple[str | None, ...]
    estimate: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    highest: tuple[float | None, ...]
    end: tuple[float | None, ...]
    condition: tuple[Condition, ...]

    @property
    def last(self) -> Interval:
        """The value in the last of the flights."""
        return Interval(estimate=self.estimate[-1], low=self.low[-1], high=self.high[-1])


class ActuatorTrend(Contract):
    """One indicator of one actuator or axis over its flights.

    Attributes
    ----------
    condition
        The gravest of its last flight.
    flights
        Number of its flights; ``points`` has those that show the indicator.
    limit, emergency
        As the last flight has them; of a control gain, which falls as a fault grows, the profile's shares
        of the baseline.
    baseline
        95 % prediction interval for one flight, from the reference flights before the last one.
    change
        Of the last flight against the mean of the reference flights.
    level, per_flight, between
        The line at the last flight, its slope, and the standard deviation between flights.
    left_out
        Start of the flights too far off the line.
    growth
        Since which flight it certainly grows, and the flights left to each limit; None where it does not.
    step
        The last change between two flights; the trend rests on the flights since.
    flights_left
        Until the line reaches the emergency limit; None where it cannot be estimated, see ``reason``.
    """

    subject: Literal["actuator", "axis", "motor"] = "actuator"
    vehicle: int
    actuator: str
    airframe: str | None
    fault: str
    quantity: str
    unit: str
    condition: Condition
    flights: int
    limit: float | None
    emergency: float | None
    baseline: Interval | None
    change: Interval | None
    level: Interval | None
    per_flight: Interval | None
    between: float | None
    left_out: tuple[str, ...]
    growth: Growth | None = None
    step: Step | None = None
    flights_left: Interval | None
    reason: str | None
    points: FlightPoints


class RepairDate(Contract):
    """A repair that a fleet's store keeps; ``actuator`` is None for all, ``at_utc`` its date."""

    actuator: str | None
    at_utc: str


def exit_code_of(found: Iterable[Condition]) -> ExitCode:
    """Return the exit code for the worst of these conditions; unmonitored actuators do not count.

    Examples
    --------
    >>> exit_code_of(["normal", "changed", "unmonitored"]).name, exit_code_of(["unmonitored"]).name
    ('DEGRADED', 'UNDECIDED')
    """
    return _EXIT_CODES[max(found, key=URGENCY.__getitem__, default="normal")]


_EXIT_CODES: dict[Condition, ExitCode] = {
    "normal": ExitCode.OK,
    "unchanged": ExitCode.OK,
    "unmonitored": ExitCode.UNDECIDED,
    "learning": ExitCode.UNDECIDED,
    "undecided": ExitCode.UNDECIDED,
    "changed": ExitCode.DEGRADED,
    "degraded": ExitCode.DEGRADED,
    "emergency": ExitCode.EMERGENCY,
}


class TrendReport(Drawn):
    """The trends of an aircraft, the worst first.

    Attributes
    ----------
    flights
        Number of its flights.
    unshown
        Actuators of which no flight shows an indicator.
    repairs
        Of the aircraft, in time order.
    standings
        State of each actuator and axis over its flights, whatever indicators were requested, worst first.
    """

    schema_: Literal["mavhums.trend/1"] = Field(default="mavhums.trend/1", alias="schema")
    notice: str = NOTICE
    flights: int
    trends: tuple[ActuatorTrend, ...]
    unshown: tuple[str, ...]
    repairs: tuple[RepairDate, ...] = ()
    standings: tuple[Standing, ...] = ()

    @property
    def others(self) -> list[Standing]:
        """Actuators and axes whose last flight was faulty, and of which no flight shows a wanted fault."""
        shown = {(one.vehicle, one.actuator, one.airframe) for one in self.trends}
        left = [one for one in self.standings if (one.vehicle, one.actuator, one.airframe) not in shown]
        faulty = [one for one in left if SEVERITY[one.last] > SEVERITY["normal"]]
        return sorted(faulty, key=lambda one: (-URGENCY[one.last], one.vehicle, one.actuator))

    @property
    def exit_code(self) -> ExitCode:
        """The exit code, as in ``mavhums analyse``, of the states over the flights; growth is degraded."""
        found: list[Condition] = [one.condition for one in self.trends if one.condition != "unmonitored"]
        found += [one.last for one in self.others]
        found += [one.condition for one in self.standings if SEVERITY[one.condition] > 0]
        if any(one.growth for one in self.trends) or any(one.growth for one in self.standings):
            found.append("degraded")
        if self.unshown or not self.trends:
            found.append("undecided")
        return exit_code_of(found)

    def to_frame(self) -> pd.DataFrame:
        """Return a row per flight and indicator, the worst actuator first.

        The columns: ``vehicle``, ``actuator``, ``airframe``, ``fault``, ``quantity``, ``unit``, ``flight``
        (from 1), ``start_utc``, ``log``, ``estimate`` with its 95 % interval ``low`` and ``high``,
        ``condition``, the limits ``limit`` (degraded) and ``emergency``, and the flight's ``highest``
        estimate and the one at its ``end``; NaN where there is none.
        """
        import pandas as pd

        fields = {"vehicle", "actuator", "airframe", "fault", "quantity", "unit", "limit", "emergency"}
        parts = [pd.DataFrame(one.model_dump(include=fields) | dict(one.points)) for one in self.trends]
        columns = [*_COLUMNS.split(), "limit", "emergency", "highest", "end"]
        frame = pd.concat(parts or [pd.DataFrame(columns=columns)], ignore_index=True)[columns]
        frame["start_utc"] = pd.to_datetime(frame["start_utc"], utc=True, format="ISO8601")
        numbers = ("estimate", "low", "high", "limit", "emergency", "highest", "end")
        return frame.astype(dict.fromkeys(numbers, float))


_COLUMNS = "vehicle actuator airframe fault quantity unit flight start_utc log estimate low high condition"


class LastFlightOf(Contract):
    """An actuator or axis in its aircraft's last flight; ``aircraft`` is None where it is unknown.

    ``standing`` is its state over the flights, where it is known.
    """

    aircraft: str | None
    log: str
    start_utc: str | None
    verdict: Verdict
    standing: Standing | None

    def to_json(self, *, indent: int | None = None) -> str:
        """Return it as JSON, without what only later comparisons need."""
        return self.model_dump_json(indent=indent, exclude={"verdict": {"own"}})


class FailedLog(Contract):
    """A log that could not be judged."""

    problem: str
    remedy: str


class StoreCopy(Contract):
    """A log whose flight another log records better; that one counts."""

    log: str
    counted: str


class ForeignBoard(Contract):
    """A board in flights of an aircraft that usually has another one.

    ``usual`` is the board that the aircraft has in most flights, in so many; ``elsewhere`` the aircraft
    of which the board is the usual one, None if there is none.
    """

    aircraft: str
    board: str
    logs: tuple[str, ...]
    usual: str
    flights: int
    elsewhere: str | None

    def __str__(self) -> str:
        count = len(self.logs)
        which = f"{count} logs, {self.logs[0]} and others, have" if count > 1 else f"{self.logs[0]} has"
        whose = f" of {self.elsewhere}" if self.elsewhere else ""
        others = f"{self.flights} other flight{'s have' if self.flights > 1 else ' has'}"
        return f"{self.aircraft}: {which} the board {self.board}{whose}, and {others} {self.usual}"


class StoreGrowth(Contract):
    """An actuator with growing wear, and its state over the flights."""

    aircraft: str
    standing: Standing


class StoreStatus(Contract):
    """The contents of a store: judged logs, known aircraft, logs of an unknown one, failures and copies.

    ``removed`` is the number of logs that were removed.
    """

    judged: int
    aircraft: int
    unknown: int
    failures: tuple[FailedLog, ...]
    copies: tuple[StoreCopy, ...]
    foreign_boards: tuple[ForeignBoard, ...] = ()
    growing: tuple[StoreGrowth, ...] = ()
    removed: int = 0


class Change(Contract):
    """A change in the state of an actuator or axis.

    Attributes
    ----------
    kind
        ``new`` finding, ``worse``, ``growing`` (certain growth, or one that comes within ten flights of a
        limit), ``step``, ``eased``, or ``gone``.
    before, now
        The state then, None for one that is new, and the state now.
    """

    kind: Literal["new", "worse", "growing", "step", "eased", "gone"]
    aircraft: str
    before: Standing | None
    now: Standing


class SilentAircraft(Contract):
    """An aircraft without flights for longer than usual; ``days`` have passed since the last one."""

    aircraft: str
    last_utc: str
    days: float


class FleetDigest(Contract):
    """The changes in a fleet, for a reader who looks once a day.

    Attributes
    ----------
    since_utc, until_utc
        The period that it covers; the time at which a log came into the store counts.
    aircraft, flights
        Number of aircraft with a name, and of logs that came meanwhile.
    changes
        The most urgent first.
    silent
        Aircraft that fell silent meanwhile.
    failed
        Logs that could not be judged, meanwhile.
    standing
        Number of unchanged findings.
    silent_longer
        Number of aircraft that were silent before.
    """

    schema_: Literal["mavhums.digest/1"] = Field(default="mavhums.digest/1", alias="schema")
    notice: str = NOTICE
    since_utc: str
    until_utc: str
    aircraft: int
    flights: int
    changes: tuple[Change, ...] = ()
    silent: tuple[SilentAircraft, ...] = ()
    failed: tuple[FailedLog, ...] = ()
    standing: int = 0
    silent_longer: int = 0

    @property
    def is_empty(self) -> bool:
        """Whether there is nothing to say."""
        return not (self.changes or self.silent or self.failed)

    @property
    def exit_code(self) -> ExitCode:
        """The exit code for what is new: of ``--fail-on-news``."""
        worsened = [one.now for one in self.changes if one.kind in ("new", "worse")]
        if any(SEVERITY[one.condition] == SEVERITY["emergency"] for one in worsened):
            return ExitCode.EMERGENCY
        if worsened or any(one.kind in ("growing", "step") for one in self.changes):
            return ExitCode.DEGRADED
        return ExitCode.ERROR if self.failed else ExitCode.OK
