"""The actuators of a log: a monitor for each, with its profile, and what the networks say of it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.mapping import MappedSamples
from mavhums.actuator.profile import Airframe
from mavhums.engine.options import EngineOptions
from mavhums.health.decision.events import ActuatorRecord, Classified
from mavhums.results.sections import Decide, ModelSummary, NetworkAnswer, WindowsOfClass

if TYPE_CHECKING:
    from mavhums.health.actuator.monitor import ActuatorFindings, Monitor
    from mavhums.learn import Model

Key = tuple[int, str]
"""A vehicle and the name of one of its actuators."""


class Monitors:
    """Makes a monitor for each actuator at its first samples.

    Parameters
    ----------
    options
        Models and the like.

    Attributes
    ----------
    models
        The models that may vote.
    profiles
        Names of the profiles by which the actuators are judged.
    """

    def __init__(self, options: EngineOptions) -> None:
        self.models = tuple(options.models)
        self.profiles: dict[Key, str] = {}
        self._options = options
        self._monitors: dict[Key, Monitor] = {}

    def __iter__(self) -> Iterator[tuple[Key, Monitor]]:
        return iter(list(self._monitors.items()))

    def get(self, vehicle: int, actuator: str) -> Monitor | None:
        """Return the monitor of an actuator; None before its first samples."""
        return self._monitors.get((vehicle, actuator))

    def forget(self, vehicle: int, actuator: str) -> Monitor | None:
        """Give an actuator's monitor up; return it, if there was one."""
        return self._monitors.pop((vehicle, actuator), None)

    def forget_all(self, vehicle: int) -> None:
        """Give up the monitors of a vehicle that names another profile."""
        for key in [key for key in self._monitors if key[0] == vehicle]:
            del self._monitors[key]

    def of(self, airframe: Airframe, mapped: MappedSamples) -> Monitor:
        """Return the monitor of an actuator that sends."""
        key = (mapped.vehicle, mapped.actuator.name)
        if key not in self._monitors:
            from mavhums.health.actuator.monitor import Monitor  # most logs have no telemetry of servos

            self.profiles[key] = airframe.name
            self._monitors[key] = Monitor(
                mapped.vehicle,
                mapped.actuator,
                self.serving(airframe),
                by_network=self._options.decide == "network",
                false_alarms=self._options.false_alarms,
                recorded=self._options.recorded,
            )
        return self._monitors[key]

    def records(self, *, whole: bool) -> dict[Key, ActuatorRecord]:
        """Return this flight's records."""
        return {key: monitor.record(whole=whole) for key, monitor in self._monitors.items()}

    def serving(self, airframe: Airframe) -> list[Model]:
        """Return the models that are for an airframe."""
        return [model for model in self.models if model.card.airframe == airframe.name]


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
