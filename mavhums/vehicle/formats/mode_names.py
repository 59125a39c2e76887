"""The names of flight modes, as ground stations show them.

They are those of pymavlink.mavutil: to import that loads every message of MAVLink, which takes longer than to
decode an ordinary log. A test compares the two for each kind of vehicle.
"""

from __future__ import annotations

from typing import Final

_PX4_AUTO: Final = 4


def _numbered(names: str) -> dict[int, str]:
    """Return the names by their place; a dash is a number without one."""
    return {number: name for number, name in enumerate(names.split()) if name != "-"}


_PLANE = _numbered(
    """MANUAL CIRCLE STABILIZE TRAINING ACRO FBWA FBWB CRUISE AUTOTUNE - AUTO RTL LOITER TAKEOFF
    AVOID_ADSB GUIDED INITIALISING QSTABILIZE QHOVER QLOITER QLAND QRTL QAUTOTUNE QACRO THERMAL
    LOITERALTQLAND AUTOLAND"""
)
_COPTER = _numbered(
    """STABILIZE ACRO ALT_HOLD AUTO GUIDED LOITER RTL CIRCLE POSITION LAND OF_LOITER DRIFT - SPORT FLIP
    AUTOTUNE POSHOLD BRAKE THROW AVOID_ADSB GUIDED_NOGPS SMART_RTL FLOWHOLD FOLLOW ZIGZAG SYSTEMID
    AUTOROTATE AUTO_RTL TURTLE RATE_ACRO"""
)
_ROVER = _numbered(
    """MANUAL ACRO LEARNING STEERING HOLD LOITER FOLLOW SIMPLE DOCK CIRCLE AUTO RTL SMART_RTL - - GUIDED
    INITIALISING"""
)
_SUB = _numbered("STABILIZE ACRO ALT_HOLD AUTO GUIDED - - CIRCLE - SURFACE - - - - - - POSHOLD - - MANUAL")
_TRACKER = _numbered("MANUAL STOP SCAN - GUIDED - - - - - AUTO - - - - - INITIALISING")
_BLIMP = _numbered("LAND MANUAL VELOCITY LOITER RTL AUTO HOLD")
_ARDUPILOT: Final = {  # by MAV_TYPE
    **dict.fromkeys((1, 19, 20, 21), _PLANE),
    **dict.fromkeys((2, 3, 4, 13, 14, 15, 29, 35), _COPTER),
    **dict.fromkeys((10, 11), _ROVER),
    5: _TRACKER,
    7: _BLIMP,
    12: _SUB,
}
_PX4_MAIN: Final = _numbered("- MANUAL ALTCTL POSCTL - ACRO OFFBOARD STABILIZED RATTITUDE")
_PX4_SUB: Final = _numbered("- - TAKEOFF LOITER MISSION RTL LAND RTGS FOLLOWME")
NAVIGATION_STATES: Final = _numbered(
    """MANUAL ALTCTL POSCTL MISSION LOITER RTL POSITION_SLOW - - - ACRO - DESCEND TERMINATION OFFBOARD
    STABILIZED - TAKEOFF LAND FOLLOWME PRECISION_LAND ORBIT VTOL_TAKEOFF"""
)
"""By PX4's vehicle_status.nav_state, whose numbers of modes that are no more were given to others."""


def ardupilot_mode(kind: int, number: int) -> str:
    """Return the name of a mode of ArduPilot by the vehicle's MAV_TYPE."""
    return _ARDUPILOT.get(kind, {}).get(number, f"Mode({number})")


def px4_mode(number: int) -> str:
    """Return the name of a mode of PX4 by the custom mode of its HEARTBEAT."""
    main, sub = number >> 16 & 0xFF, number >> 24 & 0xFF
    return (_PX4_SUB.get(sub) if main == _PX4_AUTO else _PX4_MAIN.get(main)) or "UNKNOWN"
