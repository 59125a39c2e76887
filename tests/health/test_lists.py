"""Detectors and equations are in explicit lists; a module that no list names would never be asked."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import pytest

from mavhums.health.actuator import detectors
from mavhums.health.actuator.detectors import DETECTORS
from mavhums.health.estimation import equations
from mavhums.health.estimation.equations import EQUATIONS, OWN_EQUATIONS, STROKE_EQUATIONS, interface
from tests.present import present

SHARED = {"interface"}
OWN = (*OWN_EQUATIONS, *STROKE_EQUATIONS)


def modules(package: ModuleType) -> set[str]:
    """Return the names of a package's modules."""
    return {path.stem for path in Path(present(package.__file__)).parent.glob("*.py")} - {"__init__"}


def test_the_list_of_detectors_is_the_folder() -> None:
    defined = [vars(getattr(detectors, module)) for module in modules(detectors)]
    found = {
        value
        for names in defined
        for value in names.values()
        if isinstance(value, type) and hasattr(value, "fault") and value.__module__ == names["__name__"]
    }
    assert found == set(DETECTORS)
    assert [detector.fault for detector in DETECTORS] == sorted(detector.fault for detector in DETECTORS)


def test_every_module_of_equations_is_in_a_list() -> None:
    listed = {one.prior.__module__ for one in EQUATIONS} | {one.left.__module__ for one in OWN}
    assert {name.rsplit(".", 1)[-1] for name in listed} == modules(equations) - SHARED


@pytest.mark.parametrize("module", sorted(modules(equations) - SHARED))
def test_every_equation_of_a_module_is_in_a_list(module: str) -> None:
    defined = vars(getattr(equations, module)).values()
    found = [one for one in defined if isinstance(one, interface.Equation | interface.OwnEquation)]
    assert found
    assert {one.name for one in found} <= {one.name for one in EQUATIONS} | {one.name for one in OWN}
