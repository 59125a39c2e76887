"""What the networks say of an actuator: its samples, and its flight."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.mapping import MappedSamples
from mavhums.health.decision.events import Classified
from mavhums.results.sections import Decide, ModelSummary, NetworkAnswer, WindowsOfClass

if TYPE_CHECKING:
    from mavhums.health.actuator.monitor import ActuatorFindings
    from mavhums.learn import Model


def summary_of(model: Model) -> ModelSummary:
    """Return the name and the hash of a model."""
    return ModelSummary(name=model.card.name, hash=model.hash)


def network_answer(
    findings: ActuatorFindings, serving: Sequence[Model], decide: Decide
) -> NetworkAnswer | None:
    """Return what the networks that serve an actuator say of its flight; None if none answered a window."""
    said = findings.network
    if said is None:
        return None
    model = serving[said.network]
    # Where the physics lacks the limits, the network decides, whatever was asked for.
    otherwise: Decide = "both" if decide == "both" else "physics"
    return NetworkAnswer(
        model=summary_of(model),
        inputs={"samples": model.keys, "windows": model.window_quantities},
        windows=said.windows,
        classes={
            name: WindowsOfClass(windows=windows, probability=round(probability, 4))
            for name, (windows, probability) in said.classes.items()
        },
        says=said.says,
        latest=said.latest.said,
        probability=round(said.latest.probability, 4),
        first_emergency_s=None if said.first_emergency_s is None else round(said.first_emergency_s, 3),
        share_of_samples=round(said.share_of_samples, 4),
        condition=said.condition,
        decides="network" if findings.by_network else otherwise,
    )


def classified(
    mapped: MappedSamples, time_s: NDArray[np.float64], rows: slice, serving: Sequence[Model]
) -> Iterator[Classified]:
    """Yield what the networks say of each of these samples, if any serves the actuator.

    Parameters
    ----------
    mapped
        Samples of an actuator.
    time_s
        Their flight times, shape (n,).
    rows
        Which of them are asked about.
    serving
        Networks for the airframe; the one with the most inputs comes first.
    """
    if serving:
        from mavhums.health.actuator.votes import answer_samples

        ema = mapped.actuator.ema
        answers = answer_samples(serving, mapped.values[rows], ema.gear_ratio if ema else None)
        yield Classified(mapped.vehicle, mapped.actuator.name, time_s[rows], *answers)
