"""A stand-in of the autopilot's scripting interface: it runs a Lua script and records what the script calls.

It offers exactly the functions that servo_bridge.lua needs; any other name is an error, as are arithmetic
on the interface's 32-bit times and names that are too long for the message.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from lupa import lua53
from pymavlink.dialects.v20 import ardupilotmega

SCRIPT = Path(__file__).parents[2] / "bridge" / "servo_bridge.lua"
_NAME_LENGTH = 10

_GLUE = """
local host, script = ...
local function strict(name, members)
   return setmetatable(members, { __index = function(_, key) error(name .. " has no " .. key) end })
end
local function uint32(value)
   return strict("uint32_t", { toint = function() return value end })
end
local function telemetry(values)
   local function getter(key) return function() return values[key] end end
   return strict("ServoTelemetryData", {
      command_position = getter("command"), measured_position = getter("position"),
      voltage = getter("voltage"), current = getter("current"), speed = getter("speed"),
      motor_temperature_cdeg = getter("temperature"),
      last_update_ms = function() return uint32(values.updated_ms) end,
   })
end
local function read(_, index)
   local values = host.telemetry(index)
   return values and telemetry(values) or nil
end
local environment = strict("the interpreter", {
   assert = assert, ipairs = ipairs, math = math, string = string, tostring = tostring,
   millis = function() return uint32(host.millis()) end,
   gcs = strict("gcs", {
      send_named_float = function(_, name, value) host.send_named_float(name, value) end,
      send_text = function(_, severity, text) host.send_text(severity, text) end,
   }),
   param = strict("param", {
      add_table = function(_, key, prefix, size) return host.add_table(key, prefix, size) end,
      add_param = function(_, key, index, name, default) return host.add_param(key, index, name, default) end,
   }),
   Parameter = function(name)
      return strict("Parameter", { get = function() return host.parameter(name) end })
   end,
   servo_telem = host.has_servo_telemetry() and strict("servo_telem", { get_telem = read }) or false,
})
return assert(load(script, "servo_bridge.lua", "t", environment))()
"""


@dataclass
class Telemetry:
    """What a servo reports now; None where it does not."""

    updated_ms: int
    command: float | None = None
    position: float | None = None
    voltage: float | None = None
    current: float | None = None
    speed: float | None = None
    temperature: int | None = None


class Sent(NamedTuple):
    """One named value, as the script sent it."""

    time_ms: int
    name: str
    value: float


@dataclass
class Autopilot:
    """Runs the bridge against servos that report what ``servos`` returns at a time in milliseconds.

    Attributes
    ----------
    parameters
        Values that differ from the script's defaults, by full name.
    firmware
        Version as (major, minor); servo telemetry exists from 4.7 on.
    late_ms
        How much later than asked for each call comes.
    """

    servos: Callable[[int], dict[int, Telemetry]]
    parameters: dict[str, float] = field(default_factory=dict)
    firmware: tuple[int, int] = (4, 7)
    late_ms: int = 0
    sent: list[Sent] = field(default_factory=list)
    texts: list[tuple[int, str]] = field(default_factory=list)
    _now_ms: int = 0
    _prefix: str = ""

    def run(self, seconds: float, start_ms: int = 5000) -> None:
        """Call the script as the scheduler would, each time after the delay that it asked for."""
        lua = lua53.LuaRuntime(unpack_returned_tuples=True, register_eval=False)
        self._lua, self._now_ms = lua, start_ms
        script = SCRIPT.read_text(encoding="utf-8")
        outcome = lua.execute(_GLUE, lua.table_from(self._host()), script)
        while outcome is not None:
            update, delay_ms = outcome
            assert delay_ms == int(delay_ms) >= 1
            self._now_ms += int(delay_ms) + self.late_ms
            if self._now_ms >= start_ms + 1000 * seconds:
                return
            outcome = update()

    def bytes_per_second(self, start_ms: int, end_ms: int) -> float:
        """Return what the named values of this time cost on the wire, from their packed MAVLink 2 frames."""
        link = ardupilotmega.MAVLink(None, srcSystem=1, srcComponent=1)
        total = sum(len(frame(link, one)) for one in self.sent if start_ms <= one.time_ms < end_ms)
        return 1000 * total / (end_ms - start_ms)

    def _host(self) -> dict[str, Any]:
        return {
            "millis": lambda: self._now_ms,
            "telemetry": self._telemetry,
            "send_named_float": self._send_named_float,
            "send_text": lambda severity, text: self.texts.append((severity, text)),
            "add_table": self._add_table,
            "add_param": self._add_param,
            "parameter": lambda name: self.parameters[name],
            "has_servo_telemetry": lambda: self.firmware >= (4, 7),
        }

    def _telemetry(self, index: int) -> Any:
        assert 0 <= index < 32
        values = self.servos(self._now_ms).get(index)
        return None if values is None else self._lua.table_from(vars(values))

    def _send_named_float(self, name: str, value: float) -> None:
        assert len(name) <= _NAME_LENGTH
        assert math.isfinite(value)
        self.sent.append(Sent(self._now_ms, name, value))

    def _add_table(self, key: int, prefix: str, size: int) -> bool:
        assert 0 <= key <= 200
        assert size <= 63
        self._prefix = prefix
        return True

    def _add_param(self, key: int, index: int, name: str, default: float) -> bool:
        assert 1 <= index <= 63
        assert len(self._prefix + name) <= 16
        self.parameters.setdefault(self._prefix + name, default)
        return True


def frame(link: ardupilotmega.MAVLink, one: Sent) -> bytes:
    """Return the named value as a frame of MAVLink 2."""
    message = ardupilotmega.MAVLink_named_value_float_message(one.time_ms, one.name.encode(), one.value)
    return bytes(message.pack(link))
