"""What a network says of an actuator, in words: once, and never as a second voice."""

from __future__ import annotations

from typing import Final

from mavhums.core.conditions import SEVERITY
from mavhums.report.assessment import Assessment, Verdict
from mavhums.show._words import clock, join, name, percent

__all__ = ["beside", "in_column", "told"]

_TAKEN: Final = {
    "winding_resistance": "the higher winding resistance",
    "torque_constant": "the lost torque constant",
    "backlash": "the play of the gear",
    "sensor_bias": "the sensor's bias",
    "supply_sag": "the weak supply",
    "following": "what keeps the shaft from following",
    "jam": "the jam",
}
"""What a network that knows friction alone may take for friction, by the fault that the physics finds."""


def in_column(verdict: Verdict) -> str:
    """Return the table's cell: the condition that the network held; of an old file its last probability.

    The share of single samples would mislead here: without the load torque a quarter of a healthy flight's
    samples may say emergency, and no window does.
    """
    said = verdict.network
    if said is None:
        return "—"
    if said.windows is None and said.p_emergency is not None:
        return percent(said.p_emergency)
    return said.condition


def told(verdict: Verdict) -> str | None:
    """Return one sentence on the network if it decides, or is held against the physics; else None.

    Examples
    --------
    >>> told(Verdict(vehicle=1, actuator="rudder", condition="normal", worst="normal"))
    """
    said = verdict.network
    if said is None or said.decides == "physics":
        return None
    if said.decides == "both":
        return _compared(verdict)
    return f"the network {said.model.name} decides, not the physics: {_share(verdict)}"


def beside(assessment: Assessment) -> list[str]:
    """Return what :func:`told` says, once for all actuators of which it says the same."""
    said: dict[str, list[str]] = {}
    for verdict in assessment.ranked():
        if sentence := told(verdict):
            said.setdefault(sentence, []).append(name(verdict, assessment))
    return [f"{join(names)}: {sentence}" for sentence, names in said.items()]


def _share(verdict: Verdict) -> str:
    said = verdict.network
    assert said is not None
    share = percent(said.share_of_samples or 0.0)
    first = "" if said.first_emergency_s is None else f", first around {clock(said.first_emergency_s)}"
    return f"it calls {share} of the samples in motion an emergency{first}"


def _compared(verdict: Verdict) -> str:
    """Return whether the network agrees with the physics on the friction, and if not, how it differs."""
    said, share = verdict.network, _share(verdict)
    assert said is not None
    if said.condition == "undecided":
        return f"the network {said.model.name} is undecided: {share}"
    emergency = said.condition == "emergency"
    found = {item.kind.removesuffix("_drift") for item in verdict.evidence} | {
        item.fault for item in verdict.suspects
    }
    faulty = SEVERITY[verdict.worst] > SEVERITY["normal"]
    if verdict.worst == "undecided":
        return f"the physics is undecided; the network {said.model.name} says {said.condition}: {share}"
    rubs = faulty and _rubs(verdict)
    if rubs and verdict.worst == "degraded":
        nearer = "an emergency" if emergency else "normal"
        return f"the network {said.model.name} knows no degraded; it finds the friction nearer to {nearer}"
    others = [words for fault, words in _TAKEN.items() if faulty and fault in found]
    if emergency and not rubs:
        takes = f"it takes {others[0]} for friction" if others else "the physics finds the friction normal"
        return f"the network {said.model.name} disagrees: {share}; {takes}"
    if rubs and not emergency:
        return f"the network {said.model.name} disagrees: it calls the friction normal"
    of = "" if rubs or not others else " that the friction is normal"
    return f"the network {said.model.name} agrees{of}"


def _rubs(verdict: Verdict) -> bool:
    """Return whether the physics found a fault of the friction."""
    findings = (item for item in verdict.evidence if item.kind in ("friction", "friction_drift"))
    return any(not item.rule.startswith("normal") for item in findings)
