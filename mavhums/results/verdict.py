"""The contract of one verdict: on an actuator, an axis of the aircraft, or a motor of a multirotor."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, Literal

from pydantic import Field

from mavhums.core.conditions import URGENCY, Condition
from mavhums.core.models import Contract
from mavhums.core.statistics import NORMAL_95
from mavhums.results.sections import AxisLimits, NetworkAnswer


class Interval(Contract):
    """An estimate with its 95 % interval."""

    estimate: float
    low: float
    high: float

    @classmethod
    def around(cls, estimate: float, half: float) -> Interval:
        """Return the interval that extends as far to either side."""
        return cls(estimate=estimate, low=estimate - half, high=estimate + half)

    def significant(self, digits: int) -> Interval:
        """Return the interval with so many significant digits."""
        return Interval(**{name: float(f"{number:.{digits}g}") for name, number in self})


ABSTAINED, OUTSIDE = "abstained", "outside"
"""What a network says of a window in place of a class: sure of none; outside its training range."""


MEASURED: Final[Mapping[str, str]] = {
    "rates": "body rates",
    "force": "acceleration",
    "speed": "airspeed",
}
"""Sources of an axis, beside the outputs' (V1), in the fields ``provenance``."""

ALL = "all"
"""Name in place of the actuator's where a verdict is on all of a vehicle."""

MOTORS = "motors"
"""Name in place of the motor's where a verdict is on all of a vehicle."""


class Suspect(Contract):
    """A fault that the evidence indicates."""

    fault: str
    confidence: float = Field(ge=0, le=1)


class Candidate(Contract):
    """A surface that explains the finding about an axis, with its servo output.

    ``probability`` is None where nothing distinguishes the candidates; ``because`` names the evidence that
    does.
    """

    surface: str
    servo: int
    probability: float | None = Field(default=None, ge=0, le=1)
    because: str | None = None


class Since(Contract):
    """When the actuator was first found in its present state."""

    flight_time_s: float
    utc: str


class Coverage(Contract):
    """How much of the flight could be judged: windows of 10 s, one each second.

    ``decidable`` counts those on which a condition can rest, because they show the friction or a fault; of an
    axis the seconds since its reference over which a loss of 40 % or more is excluded or measured.
    ``excluded`` counts, for an axis, the seconds over which a loss of 40 % or more is excluded with 95 %, and
    ``excluded_until_s`` is the flight second of the last one after the reference. ``judged_from_s`` is the
    flight second from which on an axis is judged whose reference came after two minutes of forward flight.
    ``excluded_loss`` is, of a motor without a finding, the smallest loss of thrust that is excluded.
    ``late`` counts samples that came too late to be judged, ``implausible`` by quantity the values that no
    such actuator can have, which count as not measured.
    """

    moving_fraction: float = Field(ge=0, le=1)
    windows: int = Field(ge=0)
    decidable: int = Field(ge=0)
    excluded: int = Field(default=0, ge=0)
    excluded_until_s: float | None = None
    judged_from_s: float | None = None
    excluded_loss: float | None = Field(default=None, ge=0)
    late: int = Field(default=0, ge=0)
    implausible: dict[str, int] = {}


DRIFT: Final = "_drift"
"""Ends the kind of a finding that departs from the actuator's own baseline."""


class Evidence(Contract):
    """One finding, with the rule that made it one."""

    kind: str
    start_s: float
    end_s: float
    value: float
    limit: float | None = None
    rule: str

    @property
    def condition(self) -> str:
        """The condition that it gives, which its rule begins with."""
        return self.rule.partition(" ")[0].rstrip(":")

    @property
    def fault(self) -> str:
        """The fault that it shows, by a limit or by the own baseline."""
        return self.kind.removesuffix(DRIFT)


class Indicator(Contract):
    """A physical quantity that shows a fault, estimated over the whole flight.

    Attributes
    ----------
    fault
        That it shows.
    quantity, unit
        What was estimated, for example ``Coulomb friction`` in ``N·m``.
    value
        Over the whole flight.
    windows, scatter
        Number of decidable windows that do not overlap, and the standard deviation of their estimates;
        None of fewer than two.
    mean, mean_error
        Mean of those windows, each counted by its certainty, and its standard error. It leaves out errors
        that all flights share, and is compared with earlier flights; None of an axis or a motor, whose value
        is.
    limit
        Value from which the actuator is degraded; None where only its own baseline can decide.
    emergency
        Value from which it is an emergency; None where the fault alone is none. A fault grows upwards.
    baseline
        95 % prediction interval for one flight, from the actuator's own history.
    baseline_flights, needed_flights
        How many flights that baseline rests on, and how many it takes; None where limits alone decide.
    least_rise
        Share of the baseline by which the quantity must rise to be found with 95 % probability.
    load
        Mean size of the load in the flight's motion, in the quantity's unit; None where the friction does not
        depend on it, or nothing shows it.
    """

    fault: str
    quantity: str
    unit: str
    value: Interval
    windows: int = Field(ge=1)
    scatter: float | None = Field(default=None, ge=0)
    mean: float | None = None
    mean_error: float | None = Field(default=None, ge=0)
    limit: float | None = None
    emergency: float | None = None
    baseline: Interval | None = None
    baseline_flights: int | None = Field(default=None, ge=0)
    needed_flights: int | None = Field(default=None, ge=1)
    least_rise: float | None = Field(default=None, ge=0)
    load: float | None = Field(default=None, ge=0)

    @property
    def compared(self) -> tuple[float, float]:
        """The value that is compared with earlier flights, and its standard error."""
        if self.mean is not None and self.mean_error is not None:
            return self.mean, self.mean_error
        # The interval is the only form in which the error was stored.
        return self.value.estimate, (self.value.high - self.value.low) / 2 / NORMAL_95

    @classmethod
    def of_mean(
        cls, fault: str, quantity: str, unit: str, mean: tuple[float, float], *, windows: int, needed: int
    ) -> Indicator:
        """Return that of a mean over windows, with its standard error, compared from so many flights."""
        value, error = mean
        return cls(
            fault=fault,
            quantity=quantity,
            unit=unit,
            value=Interval.around(value, NORMAL_95 * error).significant(5),
            windows=windows,
            scatter=float(f"{error * windows**0.5:.4g}"),
            needed_flights=needed,
        )


class OwnRecord(Contract):
    """A flight's sums for one own-scale equation, for the comparison with the actuator's other flights.

    Attributes
    ----------
    equation
        That the sums belong to.
    setup
        How it was measured, in words; flights that were measured in another way are not compared.
    rate_hz, duration_s
        Of the samples, and the time that they cover.
    groups
        Sums over parts of the flight: the number of samples, and the upper triangle of the sums of products
        of the equation's columns, the left side last.
    """

    equation: str
    setup: str
    rate_hz: float = Field(gt=0)
    duration_s: float = Field(gt=0)
    groups: tuple[tuple[float, ...], ...]


class Verdict(Contract):
    """Verdict on one actuator, one axis of the aircraft, or one motor of a multirotor.

    ``subject`` says which; ``actuator`` is its name, for an axis ``roll``, ``pitch`` or ``yaw``, and
    ``surfaces`` are those that move it; for a motor ``motor 1`` and so on, in the autopilot's order.
    ``effectiveness`` is the share of its reference, or of its thrust, that it keeps now,
    and ``limits`` are those by which it was judged; ``highest_evidence`` is how near an axis came to an alarm
    of a loss or a lag, which comes at ln(360,000 / N) for N accepted false alarms in 100 h.
    ``condition`` is the last decidable state, ``worst`` the worst one reached. ``normal``, ``degraded`` and
    ``emergency`` rest on a known limit; without one, ``unchanged``, ``changed`` and ``learning`` compare the
    actuator with its own flights before. ``undecided`` always carries ``reason`` and ``remedy``, and
    ``reason_codes`` their rows of :data:`mavhums.results.reasons.MESSAGES`, the binding one first;
    ``advice`` is the recommended action, which files of earlier versions lack. ``network``
    is a network's answer on its friction; None if none covers the log.

    Of an axis with a finding, ``candidates`` are the surfaces that explain it, the likeliest one first, and
    ``consequence_of`` is the axis whose finding explains this one: one fault is one finding.

    Examples
    --------
    >>> Verdict(vehicle=1, actuator="elevator", condition="normal", worst="degraded").gravest
    'degraded'
    """

    subject: Literal["actuator", "axis", "motor"] = "actuator"
    vehicle: int | None
    actuator: str
    surfaces: tuple[str, ...] = ()
    candidates: tuple[Candidate, ...] = ()
    consequence_of: str | None = None
    condition: Condition
    worst: Condition
    effectiveness: Interval | None = None
    limits: AxisLimits | None = None
    highest_evidence: float | None = None
    network: NetworkAnswer | None = None
    friction_nm: Interval | None = None
    suspects: tuple[Suspect, ...] = ()
    since: Since | None = None
    coverage: Coverage = Coverage(moving_fraction=0, windows=0, decidable=0)
    tier: str | None = None
    provenance: dict[str, str] = {}
    evidence: tuple[Evidence, ...] = ()
    indicators: tuple[Indicator, ...] = ()
    own: tuple[OwnRecord, ...] = ()
    reason: str | None = None
    remedy: str | None = None
    reason_codes: tuple[str, ...] = ()
    advice: str | None = None

    @property
    def gravest(self) -> Condition:
        """The condition that the maintainer must act on: a fault, else missing evidence, else normal."""
        return max(self.worst, self.condition, key=URGENCY.__getitem__)
