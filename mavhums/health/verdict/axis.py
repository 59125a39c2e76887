"""Converts an axis's findings to a verdict, or to its reasons if there are none."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import datetime
from math import hypot, sqrt
from typing import Final

from mavhums.actuator.profile import Airframe
from mavhums.core.conditions import SEVERITY
from mavhums.core.statistics import NORMAL_95
from mavhums.health.axis.findings import AxisFindings
from mavhums.health.axis.monitor import AxisMonitor
from mavhums.health.axis.reference import Reference
from mavhums.health.axis.thresholds import (
    DELAYS_S,
    LAGS_S,
    REFERENCE_S,
    WINDOW_DEVIATION,
)
from mavhums.health.decision.conditions import since
from mavhums.health.decision.limits import MOST_CONFIDENCE
from mavhums.health.decision.thresholds import LASTING_FLIGHTS, NAMED
from mavhums.health.estimation.thresholds import WINDOW_S
from mavhums.health.verdict.actuator import rounded, rounded_suspects
from mavhums.health.verdict.obstacles import why_undecided
from mavhums.results.reasons import Reason, said
from mavhums.results.verdict import Candidate, Indicator, Verdict
from mavhums.vehicle.flight import Flight
from mavhums.vehicle.grid import RATE_HZ, Grid
from mavhums.vehicle.surfaces import STEERING, Surfaces

_SPEEDS: Final = (
    "the airspeed sensor",
    "the wind triangle",
    "the speed over ground",
    "the speed over ground less any known current",
)
_GAIN: Final = {"roll": (1, "rad/m"), "pitch": (2, "rad/m²"), "yaw": (2, "1/m"), STEERING: (1, "rad/m")}
_CONSTANTS: Final = {"hard_over": ("trim", "1"), "manoeuvre": ("load factor by full demand", "s²/m²")}


def verdicts_of_axes(
    vehicle: int,
    monitor: AxisMonitor,
    surfaces: Surfaces | None,
    flight: Flight,
    start_utc: datetime,
    grid: Grid,
) -> Iterator[Verdict]:
    """Yield the verdicts on the axes of a vehicle that flew: one fault is one finding."""
    origins = monitor.origins()
    for axis in monitor.axes:
        findings = monitor.findings(axis)
        verdict = verdict_of_axis(vehicle, findings, surfaces, flight, start_utc, grid)
        if axis in origins:
            verdict = verdict.model_copy(update={"consequence_of": origins[axis]})
        elif SEVERITY[verdict.worst] > SEVERITY["normal"] and surfaces is not None:
            verdict = verdict.model_copy(update={"candidates": _candidates(findings, surfaces)})
        yield verdict


def _candidates(findings: AxisFindings, surfaces: Surfaces) -> tuple[Candidate, ...]:
    """Return the surfaces that explain a finding; of two mixed ones the one that fits, if only one does."""
    moved = surfaces.of_axis(findings.axis)
    shares = {one.servo: findings.shares.get(one.side, 0.0) for one in moved}
    is_certain = max(shares.values(), default=0.0) >= NAMED and len(moved) == len(findings.shares) - 1
    found = [
        Candidate(
            surface=surfaces.what(one),
            servo=one.servo,
            probability=min(round(shares[one.servo], 2), MOST_CONFIDENCE) if is_certain else None,
            because="the demand about one axis moves the aircraft about the other" if is_certain else None,
        )
        for one in moved
    ]
    return tuple(sorted(found, key=lambda one: -(one.probability or 0.0)))


def named_by_telemetry(
    axes: Sequence[Verdict], actuators: Sequence[Verdict], airframe: Airframe | None
) -> Iterator[Verdict]:
    """Yield the verdicts on axes, first the candidate whose servo alone shows a fault by telemetry."""
    servos = {one.name: one.servo for one in airframe.actuators} if airframe else {}
    faulty = {servos.get(one.actuator) for one in actuators if SEVERITY[one.worst] > SEVERITY["normal"]}
    for verdict in axes:
        match [one for one in verdict.candidates if one.servo in faulty]:
            case [first]:
                said = {"probability": None, "because": "its servo's telemetry shows a fault"}
                others = [one for one in verdict.candidates if one is not first]
                rest = [one.model_copy(update={"probability": None, "because": None}) for one in others]
                candidates = (first.model_copy(update=said), *rest)
                yield verdict.model_copy(update={"candidates": candidates})
            case _:
                yield verdict


def verdict_of_axis(
    vehicle: int,
    findings: AxisFindings,
    surfaces: Surfaces | None,
    flight: Flight,
    start_utc: datetime,
    grid: Grid,
) -> Verdict:
    """Return the verdict on one axis of a vehicle that flew; the grid knows which messages were used."""
    reasons, received = list[Reason](), grid.received()
    if findings.condition == "undecided":
        reasons += why_undecided(findings, surfaces, flight, received)
    elif findings.condition == "unchanged":
        reasons.append(Reason("begins_in_flight"))
    elif findings.condition == "normal" and findings.coverage.judged_from_s is not None:
        reasons.append(Reason("late_reference", judged_from_s=findings.coverage.judged_from_s))
    axis = findings.axis
    # Inferred outputs, and those instead of a profile's, have another scale than in other flights.
    comparable = surfaces is not None and surfaces.origin != "inferred" and axis not in surfaces.contradicted
    origin = {} if surfaces is None else {"V1": f"servo outputs, by {_origin(surfaces, axis)}"}
    origin |= _measured(axis, flight, grid)
    coverage = findings.coverage
    late = sum(counts.late for counts in received.values())
    counted = coverage.model_copy(
        update={"moving_fraction": round(coverage.moving_fraction, 4), "late": late}
    )
    return Verdict(
        subject="axis",
        vehicle=vehicle,
        actuator=findings.axis,
        surfaces=surfaces.names(findings.axis) if surfaces else (),
        condition=findings.condition,
        worst=findings.worst,
        since=since(findings.since_s, start_utc),
        coverage=counted,
        suspects=rounded_suspects(findings.suspects),
        evidence=tuple(e.model_copy(update={"value": round(e.value, 4)}) for e in findings.evidence),
        effectiveness=rounded(findings.effectiveness, 3),
        limits=findings.limits,
        highest_evidence=None if findings.highest_evidence is None else round(findings.highest_evidence, 2),
        indicators=tuple(indicators(findings)) if comparable else (),
        provenance=origin,
        **said(*reasons),
    )


def _measured(axis: str, flight: Flight, grid: Grid) -> dict[str, str]:
    """Return what the motion was measured with, and for how long where it changed."""
    found = {}
    for signal in ("rates", "speed") if axis in ("roll", STEERING) else ("rates", "force", "speed"):
        used = [
            (_SPEEDS[rank] if signal == "speed" else grid.source(signal, rank), seconds)
            for rank, seconds in flight.used_s(signal).items()
        ]
        if used:
            found[signal] = ", ".join(f"{name} for {s} s" if len(used) > 1 else name for name, s in used)
    return found


def _origin(surfaces: Surfaces, axis: str) -> str:
    words = {"parameters": "the log's parameters", "profile": "the airframe profile"}
    if axis in surfaces.by_log:
        contradicts = axis in surfaces.contradicted
        return f"{words['parameters']}{', which contradict the airframe profile' if contradicts else ''}"
    return words.get(surfaces.origin, "inference from the flight's beginning")


def indicators(findings: AxisFindings) -> Iterator[Indicator]:
    """Yield the quantities that the reference determined; the gain is that of the present condition."""
    reference = findings.reference
    if reference is None:
        return
    power, unit = _GAIN[findings.axis]
    share, error = _share(findings, reference)
    scale = abs(reference.gain) / reference.speed**power
    lag_s = reference.shape.delay_rows / RATE_HZ + reference.shape.tau_s
    measured = [
        ("effectiveness", "control gain", unit, (scale * share, scale * error)),
        ("slow", "lag", "s", (lag_s, _lag_error(findings.axis))),
        *((fault, *_CONSTANTS[fault], known) for fault, known in reference.constants.items()),
    ]
    for each in measured:
        yield Indicator.of_mean(*each, windows=REFERENCE_S, needed=LASTING_FLIGHTS)


def _lag_error(axis: str) -> float:
    """Return the standard error of a lag whose delay and time constant are the nearest ones tried."""
    steps = (tried[axis][1] - tried[axis][0] for tried in (DELAYS_S, LAGS_S))
    return hypot(*steps) / sqrt(12.0)


def _share(findings: AxisFindings, reference: Reference) -> tuple[float, float]:
    """Return the gain of the flight as a share of the reference's, and its standard error.

    Of a fault it is that of the present condition, else the mean of the reference and the windows after it.
    """
    k = findings.effectiveness
    if k is None:
        return 1.0, reference.error
    if SEVERITY[findings.condition] > SEVERITY["normal"]:
        return k.estimate, (k.high - k.low) / 2 / NORMAL_95
    own, after = REFERENCE_S / WINDOW_S, float(findings.windows)
    share = (own + after * k.estimate) / (own + after)
    error = ((own * reference.error) ** 2 + after * WINDOW_DEVIATION**2) ** 0.5 / (own + after)
    return share, error
