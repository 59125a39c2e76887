"""The twelve quantities V1–V12 that describe an actuator's operation (paper, section 5).

Their order is the same everywhere: in arrays of shape ``(n, 12)``, in tables, in the
``data`` field of the instrumented tier and in model files.

Signs: positive current accelerates towards positive angles; V11 is the external (hinge)
load and is positive when it opposes motion towards positive V3.
"""

from __future__ import annotations

from typing import Final, NamedTuple

__all__ = ["KEYS", "QUANTITIES", "Quantity", "column"]


class Quantity(NamedTuple):
    """One controlled parameter of the actuator."""

    key: str
    name: str
    unit: str


QUANTITIES: Final = (
    Quantity("V1", "input signal", "°"),
    Quantity("V2", "rotor rotation", "°"),
    Quantity("V3", "output shaft angle", "°"),
    Quantity("V4", "supply voltage", "V"),
    Quantity("V5", "supply current", "A"),
    Quantity("V6", "supply power", "W"),
    Quantity("V7", "rotor speed", "rev/min"),
    Quantity("V8", "rotor shaft torque", "N·m"),
    Quantity("V9", "rotor shaft power", "W"),
    Quantity("V10", "output shaft speed", "rev/min"),
    Quantity("V11", "output shaft torque", "N·m"),
    Quantity("V12", "output shaft power", "W"),
)
KEYS: Final = tuple(quantity.key for quantity in QUANTITIES)


def column(key: str) -> int:
    """Return the column of a quantity in an array of shape ``(n, 12)``.

    Raises
    ------
    ValueError
        If ``key`` is none of V1…V12.

    Examples
    --------
    >>> column("V5")
    4
    """
    return KEYS.index(key)
