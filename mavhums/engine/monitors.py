"""The monitors of all actuators of a log, each with its profile and its models."""

from __future__ import annotations

from collections.abc import Iterator

from mavhums.actuator.mapping import Mapped
from mavhums.actuator.profile import Airframe
from mavhums.engine.options import EngineOptions
from mavhums.health.actuator.monitor import Monitor
from mavhums.health.decision.records import ActuatorRecord
from mavhums.learn import Model

__all__ = ["Key", "Monitors"]

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

    def of(self, airframe: Airframe, mapped: Mapped) -> Monitor:
        """Return the monitor of an actuator that sends."""
        key = (mapped.vehicle, mapped.actuator.name)
        if key not in self._monitors:
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

    def records(self, *, whole: bool = True) -> dict[Key, ActuatorRecord]:
        """Return this flight's records."""
        return {key: monitor.record(whole=whole) for key, monitor in self._monitors.items()}

    def serving(self, airframe: Airframe) -> list[Model]:
        """Return the models that are for an airframe."""
        return [model for model in self.models if model.card.airframe == airframe.name]
