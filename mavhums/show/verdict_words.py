"""One verdict in words: the cells of its row, its findings, the surfaces that explain them."""

from __future__ import annotations

from typing import Final

from mavhums.core.conditions import SEVERITY, Condition
from mavhums.health.axis.thresholds import NORMAL_EFFECTIVENESS
from mavhums.health.decision.thresholds import NORMAL_S
from mavhums.results.sections import NetworkAnswer, fault_of
from mavhums.results.verdict import ABSTAINED, OUTSIDE, Candidate, Evidence, Verdict
from mavhums.show.words import clock, effectiveness, join, percent

LOSS: Final = percent(1.0 - NORMAL_EFFECTIVENESS)
"""Of the control effectiveness, which a normal axis excludes."""

_WIDEST: Final = 1.0
"""A 95 % interval wider than the whole control effectiveness says nothing about it."""

_SAID_BY_RULE: Final = ("effectiveness", "slow", "thrust", "speed")
"""Kinds of findings whose rule contains the value."""


def control_left(verdict: Verdict) -> str | None:
    """Return what an axis keeps of its control, as far as the figure can be relied on; None without one.

    A gain above the reference's is no gain to a maintainer, and that of an axis that answers late is intact.

    Examples
    --------
    >>> from mavhums.results.verdict import Interval
    >>> axis = Verdict(subject="axis", vehicle=1, actuator="roll", condition="normal", worst="normal")
    >>> control_left(axis.model_copy(update={"effectiveness": Interval(estimate=1.19, low=1.1, high=1.28)}))
    'no loss'
    """
    left, condition, coverage = verdict.effectiveness, verdict.condition, verdict.coverage
    if condition == "undecided" and coverage.decidable < NORMAL_S and coverage.excluded:
        return f"above 60 % for {coverage.excluded} s"
    if left is None:
        return "no loss" if verdict.subject == "axis" and condition in ("normal", "unchanged") else None
    if condition == "undecided" and coverage.decidable < NORMAL_S:
        return f"not reliable: {coverage.decidable} of {NORMAL_S} s judged"
    if not is_reliable(verdict):
        return "not reliable"
    if SEVERITY[condition] == SEVERITY["normal"] and left.high >= 1.0:
        return "no loss"
    late = [item for item in verdict.evidence if item.kind == "slow"]
    if late and all(item.kind != "effectiveness" for item in verdict.evidence):
        return f"gain intact, {late[-1].value:.2g} s late"
    return effectiveness(left)


def is_reliable(verdict: Verdict) -> bool:
    """Return whether what an axis keeps of its control was judged for long enough, and is known well."""
    left, few = verdict.effectiveness, verdict.coverage.decidable < NORMAL_S
    brief = verdict.subject == "axis" and verdict.condition == "undecided" and few
    return left is not None and not brief and left.high - left.low <= _WIDEST


def kept_percent(verdict: Verdict, item: Evidence) -> int:
    """Return what is left by a finding, in per cent: by the verdict's own estimate, where it is of now.

    Examples
    --------
    >>> item = Evidence(kind="thrust", start_s=38, end_s=68, value=0.66, rule="emergency")
    >>> kept_percent(Verdict(vehicle=1, actuator="motor 1", condition="normal", worst="emergency"), item)
    34
    """
    if verdict.effectiveness is not None and verdict.condition == verdict.worst:
        return round(100 * max(verdict.effectiveness.estimate, 0.0))
    return round(100 * max(1.0 - item.value if item.kind == "thrust" else item.value, 0.0))


def course(verdict: Verdict) -> tuple[Condition, str] | None:
    """Return the worst condition, where it is past, and when it was; None where it is the present one.

    Examples
    --------
    >>> course(Verdict(vehicle=1, actuator="rudder", condition="undecided", worst="normal"))
    ('normal', '')
    """
    worst = verdict.worst
    if worst == verdict.condition:
        return None
    if SEVERITY[worst] <= SEVERITY["normal"]:
        return worst, ""
    shown = [item for item in verdict.evidence if item.condition == worst] or verdict.evidence
    if not shown:
        return worst, "during the flight"
    return worst, f"{clock(min(e.start_s for e in shown))}–{clock(max(e.end_s for e in shown))}"


def judged(verdict: Verdict) -> str | None:
    """Return how many seconds were judged; None where there was none to judge, or the alarm rests on others.

    Examples
    --------
    >>> judged(Verdict(vehicle=1, actuator="rudder", condition="normal", worst="normal"))
    """
    coverage = verdict.coverage
    shown = coverage.windows and (coverage.decidable or not verdict.evidence)
    return f"{coverage.decidable} of {coverage.windows} s" if shown else None


def implausible(verdict: Verdict) -> str | None:
    """Return how many values no such actuator can have; None if there are none.

    Examples
    --------
    >>> implausible(Verdict(vehicle=1, actuator="rudder", condition="normal", worst="normal"))
    """
    counts = verdict.coverage.implausible
    if not counts:
        return None
    values = ", ".join(f"{count:,} of {key}" for key, count in counts.items())
    return f"values that no such actuator can have, counted as not measured: {values}"


def finding(item: Evidence) -> str:
    """Return one finding: time, value and rule.

    Examples
    --------
    >>> finding(Evidence(kind="friction", start_s=38, end_s=68, value=0.41, limit=0.375, rule="above normal"))
    '38.0s to 1m08s: above normal (highest estimate 0.410 N·m)'
    """
    when = f"{clock(item.start_s)} to {clock(item.end_s)}"
    if item.kind == "network":
        return f"{when}: {item.rule} (highest probability {percent(item.value)})"
    if item.kind == "friction":
        return f"{when}: {item.rule} (highest estimate {item.value:.3f} N·m)"
    if item.kind in ("hard_over", "tracking"):
        beyond = "" if item.limit is None else f", limit {item.limit:.1f}"
        return f"{when}: {item.rule} ({item.value:.1f} times the healthy scatter{beyond})"
    if item.kind in _SAID_BY_RULE or item.kind != item.fault:
        return f"{when}: {item.rule}"
    return f"{when}: {item.kind.replace('_', ' ')} {item.value:.3g}, {item.rule}"


def explanation(verdict: Verdict) -> str | None:
    """Return which surface explains a finding about an axis, or which other finding; None if nothing does.

    Examples
    --------
    >>> axis = Verdict(subject="axis", vehicle=1, actuator="roll", condition="emergency", worst="emergency")
    >>> explanation(axis.model_copy(update={"consequence_of": "yaw"}))
    'one fault: that of yaw control explains this, too'
    """
    if verdict.consequence_of:
        return f"one fault: that of {verdict.consequence_of} control explains this, too"
    if not verdict.candidates or not verdict.candidates[0].because:
        return None
    first = verdict.candidates[0]
    sure = f" with {percent(first.probability)}" if first.probability is not None else ""
    return f"{_output(first)} explains it{sure}: {first.because}"


def culprits(verdict: Verdict) -> list[str]:
    """Return the surfaces that a headline names: the one that is singled out, else all candidates."""
    if verdict.candidates:
        named = verdict.candidates[:1] if verdict.candidates[0].because else verdict.candidates
        return [_output(one) for one in named]
    return [surface.removesuffix(f" (moves with {verdict.actuator})") for surface in verdict.surfaces]


def _output(one: Candidate) -> str:
    if one.surface.startswith("moves with "):
        return f"servo {one.servo}"
    return one.surface if "servo" in one.surface else f"{one.surface} (servo {one.servo})"


def excluded(verdict: Verdict) -> str | None:
    """Return over how many seconds of an axis a loss is excluded, and until when; None where it is not."""
    coverage = verdict.coverage
    if not coverage.excluded:
        return None
    until = "" if coverage.excluded_until_s is None else f", until {clock(coverage.excluded_until_s)}"
    return f"{LOSS} or more for {coverage.excluded} s{until}"


def network_cell(verdict: Verdict) -> str | None:
    """Return the network's condition, or the fault that it names.

    The share of single samples would mislead here: without the load torque a quarter of a healthy flight's
    samples may say emergency, and no window does.
    """
    said = verdict.network
    if said is None:
        return None
    fault = fault_of(said.says or "normal")
    return said.condition if fault in ("normal", "friction") else fault.replace("_", " ")


def network_sentence(verdict: Verdict) -> str | None:
    """Return one sentence on the network if it decides, or is compared with the physics; else None.

    Examples
    --------
    >>> network_sentence(Verdict(vehicle=1, actuator="rudder", condition="normal", worst="normal"))
    """
    said = verdict.network
    if said is None or said.decides == "physics":
        return None
    share = windows_by_class(said)
    if said.first_emergency_s is not None:
        share += f", the first emergency around {clock(said.first_emergency_s)}"
    if said.decides != "both":
        return f"the network {said.model.name} decides, not the physics: {share}"
    if said.condition == "undecided":
        return f"the network {said.model.name} is undecided: {share}"
    if verdict.worst == "undecided":
        return f"the physics is undecided; the network {said.model.name} says {said.condition}: {share}"
    faulty = SEVERITY[verdict.worst] > SEVERITY["normal"]
    found = [item.fault for item in verdict.evidence if item.condition != "normal"]
    found += [item.fault for item in verdict.suspects]
    same = said.says is None or fault_of(said.says) in found
    alike = said.condition == verdict.worst and (same or not faulty)
    if not alike:
        physics = join(sorted({one.replace("_", " ") for one in found})) if faulty else "no fault"
        return f"the network {said.model.name} disagrees: {share}; by the physics: {physics}"
    return f"the network {said.model.name} agrees"


def windows_by_class(said: NetworkAnswer) -> str:
    """Return how many windows are of each class and how probable it is in them, the most frequent first."""
    (most, first), *others = said.classes.items()
    total = first.windows + sum(one.windows for _, one in others)
    shown = f"{first.windows} of {total} windows are {class_words(most, first.probability)}"
    return ", ".join([shown, *(f"{one.windows} {class_words(key, one.probability)}" for key, one in others)])


def class_words(said: str | None, probability: float | None) -> str:
    """Return what a network says of a window.

    Examples
    --------
    >>> class_words("friction_degraded", 0.987), class_words("abstained", 0.6), class_words(None, None)
    ('friction degraded (99 %)', 'not sure', '—')
    """
    if said is None or probability is None:
        return "—"
    unsure = {ABSTAINED: "not sure", OUTSIDE: "outside its training range"}
    return unsure.get(said) or f"{said.replace('_', ' ')} ({percent(probability)})"
