"""The results of ``mavhums trend`` for each actuator, as typed objects, as JSON and as a table."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING, Literal

from pydantic import Field

from mavhums.core.about import NOTICE
from mavhums.core.conditions import SEVERITY, Condition
from mavhums.core.errors import ExitCode
from mavhums.core.models import Contract
from mavhums.results.standing import Growth, Interval, Standing, Step

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["ActuatorTrend", "FlightPoint", "LastFlight", "RepairDate", "TrendReport", "to_frame"]

_COLUMNS = "vehicle actuator airframe fault quantity unit flight start_utc log estimate low high condition"


class FlightPoint(Contract):
    """An indicator in one flight; ``flight`` counts the actuator's flights from 1, judged or not.

    Attributes
    ----------
    value
        Over the whole flight.
    highest, end
        The highest estimate that decided a condition, and the last one; None where the flight does not tell.
    """

    flight: int
    start_utc: str
    log: str | None
    value: Interval
    highest: float | None = None
    end: float | None = None
    condition: Condition


class LastFlight(Contract):
    """The gravest condition of an actuator's or axis's last flight, of which no flight shows an indicator."""

    subject: Literal["actuator", "axis", "motor"] = "actuator"
    vehicle: int
    actuator: str
    condition: Condition
    reason: str | None


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
        What its reference flights, before the last one, let expect of one flight, with 95 %.
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
        Until the line reaches the emergency limit; None where the flights do not tell, for the ``reason``.
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
    points: tuple[FlightPoint, ...]


class RepairDate(Contract):
    """A repair that a fleet's store keeps; ``actuator`` is None for all, ``at_utc`` its date."""

    actuator: str | None
    at_utc: str


class TrendReport(Contract):
    """The trends of a folder, the worst first, and what could not be read of it.

    Attributes
    ----------
    flights
        Number of flights in the folder.
    unshown
        Actuators of which no flight shows an indicator.
    others
        Actuators and axes whose last flight was faulty, and of which no flight shows a wanted fault.
    repairs
        Of the aircraft, in time order, where a fleet's store keeps them.
    standings
        How each actuator and axis stands over its flights, whatever indicators were asked for, worst first.
    """

    schema_: Literal["mavhums.trend/1"] = Field(default="mavhums.trend/1", alias="schema")
    notice: str = NOTICE
    flights: int
    trends: tuple[ActuatorTrend, ...]
    unshown: tuple[str, ...]
    errors: tuple[str, ...]
    notices: tuple[str, ...]
    repairs: tuple[RepairDate, ...] = ()
    others: tuple[LastFlight, ...] = ()
    standings: tuple[Standing, ...] = ()

    def to_json(self, *, indent: int | None = 2) -> str:
        """Return the report as JSON."""
        return self.model_dump_json(by_alias=True, indent=indent)

    @property
    def exit_code(self) -> ExitCode:
        """The exit code, as in ``mavhums analyse``, of the states over the flights; growth is degraded."""
        conditions = {one.condition for one in self.trends} | {one.condition for one in self.others}
        conditions |= {one.condition for one in self.standings if SEVERITY[one.condition] > 0}
        if "emergency" in conditions:
            return ExitCode.EMERGENCY
        if conditions & {"changed", "degraded"} or self._grows:
            return ExitCode.DEGRADED
        if (
            self.unshown
            or not self.trends
            or any(shown.condition in ("undecided", "learning") for shown in self.trends)
        ):
            return ExitCode.UNDECIDED
        return ExitCode.READ_WITH_LOSSES if self.errors else ExitCode.OK

    @property
    def _grows(self) -> bool:
        return any(one.growth for one in self.trends) or any(one.growth for one in self.standings)


def to_frame(trends: Collection[ActuatorTrend]) -> pd.DataFrame:
    """Return trends as the table of ``mavhums trend``."""
    import pandas as pd

    rows = []
    for one in trends:
        whose = one.model_dump(include={"vehicle", "actuator", "airframe", "fault", "quantity", "unit"})
        for point in one.points:
            flown = point.model_dump(include={"flight", "log", "condition"})
            limits = {"limit": one.limit, "emergency": one.emergency}
            ends = {"highest": point.highest, "end": point.end}
            rows.append(
                {**whose, **flown, **point.value.model_dump(), **limits, **ends, "start_utc": point.start_utc}
            )
    frame = pd.DataFrame(rows, columns=[*_COLUMNS.split(), "limit", "emergency", "highest", "end"])
    frame["start_utc"] = pd.to_datetime(frame["start_utc"], utc=True, format="ISO8601")
    numbers = ("estimate", "low", "high", "limit", "emergency", "highest", "end")
    return frame.astype(dict.fromkeys(numbers, float))
