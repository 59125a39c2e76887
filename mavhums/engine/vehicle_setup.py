"""The airframe profile and the parameters of a vehicle, each from the flight second at which it applies."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np

from mavhums.actuator.contradictions import (
    Contradiction,
    against_log,
    contradictions,
    reconciled,
)
from mavhums.actuator.profile import Airframe
from mavhums.core.arrays import Array, Flags
from mavhums.results.reasons import Reason
from mavhums.vehicle.parameters import Parameters, assigned_outputs
from mavhums.vehicle.rotors import TURNED, Rotors, rotors_of
from mavhums.vehicle.surfaces import Surfaces, of_parameters

_APPLIES_S: Final = 10
"""A fact applies this long after it was read, together with what comes until then: most lists of parameters
come within, and one that takes longer is applied in parts."""

_SETTLED_S: Final = 3  # the samples of earlier seconds are settled no later than this after a fact was read

_MOST: Final = 64  # changes that are remembered, so that memory does not grow with the flight


class VehicleSetup(NamedTuple):
    """The profile and the parameters of a vehicle, and where the two contradict."""

    airframe: Airframe | None = None
    parameters: Parameters | None = None
    contradictions: tuple[Contradiction, ...] = ()

    @property
    def surfaces(self) -> Surfaces | None:
        """The outputs of each axis; None if they are not known."""
        if self.airframe is not None:
            return reconciled(self.airframe, self.parameters)
        return None if self.parameters is None else of_parameters(self.parameters)

    @property
    def rotors(self) -> Rotors | Reason | None:
        """The motors of a multirotor; why they are not known; None if it is not known to be one."""
        return None if self.parameters is None else rotors_of(self.parameters)

    def against(self, actuator: str) -> Reason | None:
        """Return why an actuator cannot be judged by the profile: its output moves something else."""
        found = [one for one in self.contradictions if one.actuator == actuator and one.key == "servo"]
        return against_log(found) if found else None

    def after(self, fact: Airframe | Parameters) -> VehicleSetup:
        """Return the setup with one more fact."""
        airframe, parameters = self.airframe, self.parameters
        if isinstance(fact, Airframe):
            airframe = fact
        else:
            parameters = fact
        found = contradictions(airframe, parameters) if airframe and parameters else ()
        return VehicleSetup(airframe, parameters, found)


def setup_notices(setup: VehicleSetup, surfaces: Surfaces | None) -> Iterator[str]:
    """Yield what contradicts the profile, and what is not judged, where no verdict says so."""
    others = [one for one in setup.contradictions if one.key != "servo"]
    if others:
        reason = against_log(others)
        yield f"{reason.text}; {reason.remedy}"
    if setup.rotors == TURNED:
        yield TURNED.text
    contradicted = surfaces.contradicted if surfaces else {}
    by_log = [axis for axis in contradicted if surfaces and axis in surfaces.by_log]
    if by_log:
        yield f"{', '.join(by_log)}: judged by the log's parameters, which contradict the profile"


class SetupHistory:
    """The setups of a vehicle, each with the flight second from which it applies.

    The facts of one block of the log may come in any order.

    Parameters
    ----------
    airframe
        The profile that was given; None if the vehicle may name one.
    """

    def __init__(self, airframe: Airframe | None = None) -> None:
        self._keys: list[tuple[int, str]] = []
        self._facts: list[Airframe | Parameters] = []
        self._states = [VehicleSetup(airframe)]  # before the first fact, and after each
        self._last_read: object = None

    @property
    def last(self) -> VehicleSetup:
        """The setup after all facts."""
        return self._states[-1]

    def add_parameters(self, second: int, parameters: Parameters) -> None:
        """Add the parameters as they are after a flight second."""
        read = assigned_outputs(parameters), of_parameters(parameters), rotors_of(parameters)
        if read != self._last_read:
            self._last_read = read
            self._add(second, "parameters", parameters)

    def add_profile(self, second: int, airframe: Airframe) -> None:
        """Add the profile that the vehicle names in a flight second."""
        self._add(second, "airframe", airframe)

    def at(self, second: float) -> VehicleSetup:
        """Return what applies in a flight second."""
        return self._states[bisect_right(self._times, second)]

    def settled(self, second: int) -> VehicleSetup:
        """Return what applies in a flight second; nothing while something else was read before it."""
        due = self.next_s(second)
        return VehicleSetup() if due is not None and due < second + _APPLIES_S else self.at(second)

    def next_s(self, second: int) -> int | None:
        """Return the first flight second after this one from which something else applies."""
        k = bisect_right(self._times, second)
        return self._keys[k][0] if k < len(self._keys) else None

    def refused(self, actuator: str, time_s: Array) -> Flags:
        """Return at which flight times an actuator cannot be judged by the profile, shape (n,)."""
        against = np.array([bool(setup.against(actuator)) for setup in self._states])
        refused: Flags = against[np.searchsorted(self._times, time_s, side="right")]
        return refused

    @property
    def _times(self) -> list[int]:
        return [from_s for from_s, _ in self._keys]

    def _add(self, second: int, kind: str, fact: Airframe | Parameters) -> None:
        last = max((from_s for from_s, one in self._keys if one == kind), default=-1)
        key = (last if second + _SETTLED_S <= last else second + _APPLIES_S), kind
        k = bisect_left(self._keys, key)
        if k < len(self._keys) and self._keys[k] == key:
            self._facts[k] = fact
        else:
            self._keys.insert(k, key)
            self._facts.insert(k, fact)
        del self._states[k + 1 :]
        for later in self._facts[k:]:
            self._states.append(self._states[-1].after(later))
        if len(self._keys) > _MOST:
            del self._keys[0], self._facts[0], self._states[0]
