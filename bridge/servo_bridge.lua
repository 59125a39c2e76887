--[[
Sends the telemetry of each servo over MAVLink, so that the ground station's log holds it.

ArduPilot 4.7 and later read position, command, voltage, current, speed and temperature of smart servos
(serial Volz, DroneCAN, HiMark) and write them to the on-board log only. This script sends them as
NAMED_VALUE_FLOAT, for servo n:

    S<n>Cmd   commanded position, degrees      S<n>A     current, A
    S<n>Pos   measured position, degrees       S<n>Spd   speed of the output shaft, degrees per second
    S<n>V     voltage, V                       S<n>T     motor temperature, degrees Celsius, once a second

Install: bridge/README.md of mavhums. MIT licence.
--]]

local TABLE_KEY, PREFIX = 97, "HUMS_"
local WARNING, INFO = 4, 6
local MAX_SERVOS = 32
local FRAME_BYTES = 20      -- MAVLink 2 header and checksum (12), time and value (8); the name comes on top
local LOOK_MS = 1000        -- how often the script looks for servos, and sends a temperature
local REPORT_MS = 10000     -- over which the reached rate is measured
local WEAR_RATE_HZ = 20     -- friction in gusts needs it; below, mavhums judges jams and offsets at most
local MOST_TURNS = 8        -- caught up in one call, so that a long pause makes no burst

assert(param:add_table(TABLE_KEY, PREFIX, 6), "HUMS: parameter table key 97 is in use by another script")

local function parameter(index, name, default)
   assert(param:add_param(TABLE_KEY, index, name, default), "HUMS: cannot add parameter " .. name)
   return Parameter(PREFIX .. name)
end

local ENABLE = parameter(1, "ENABLE", 1)
local RATE = parameter(2, "RATE", 10)        -- samples per second of each servo
local LINK = parameter(3, "LINK", 2500)      -- bytes per second that the script may send, over all servos
local MASK = parameter(4, "MASK", 0)         -- bit n-1 is servo n; 0 sends every servo that reports
local FIRST = parameter(5, "FIRST", 1)       -- servo number of telemetry index 0: serial 1, DroneCAN 0
local SEND = parameter(6, "SEND", 63)        -- sum of 1 Cmd, 2 Pos, 4 V, 8 A, 16 Spd, 32 T

local QUANTITIES = {
   { "Cmd", function(telemetry) return telemetry:command_position() end },
   { "Pos", function(telemetry) return telemetry:measured_position() end },
   { "V", function(telemetry) return telemetry:voltage() end },
   { "A", function(telemetry) return telemetry:current() end },
   { "Spd", function(telemetry) return telemetry:speed() end },
}

local servos = {}           -- those that report, in the order of their turns
local turn = 0
local credit = 0            -- bytes that may be sent now
local refilled_ms, looked_ms
local due_ms                -- when the next servo's turn is
local report = { due = false }

local function send(name, value)
   if value == nil or value ~= value then
      return 0
   end
   gcs:send_named_float(name, value)
   return FRAME_BYTES + #name
end

local function has_bit(value, bit)
   return math.floor(value) & (1 << bit) ~= 0
end

local function is_wanted(number)
   return MASK:get() == 0 or has_bit(MASK:get(), number - 1)
end

local function new_servo(index, number)
   local servo = { index = index, names = {}, temperature = "S" .. number .. "T" }
   for k, quantity in ipairs(QUANTITIES) do
      servo.names[k] = "S" .. number .. quantity[1]
   end
   return servo
end

local function look_for_servos(now_ms)
   if looked_ms and now_ms - looked_ms < LOOK_MS then
      return
   end
   looked_ms = now_ms
   local known, first = {}, math.floor(FIRST:get())
   for _, servo in ipairs(servos) do
      known[servo.index] = servo
   end
   local found = {}
   for index = 0, MAX_SERVOS - 1 do
      local number = index + first
      if number >= 1 and is_wanted(number) and servo_telem:get_telem(index) then
         found[#found + 1] = known[index] or new_servo(index, number)
      end
   end
   -- Other servos or other parameters, another rate: it is measured and reported anew.
   local setup = string.format("%d %g %g %.0f %.0f", #found, RATE:get(), LINK:get(), MASK:get(), SEND:get())
   if setup ~= report.setup then
      report = { setup = setup, start_ms = now_ms, samples = 0, bytes = 0, waits = 0, turns = 0, due = #found > 0 }
      due_ms = nil
   end
   servos = found
end

-- Sends one servo's values if they are new; returns the bytes.
local function send_servo(servo, now_ms)
   local telemetry = servo_telem:get_telem(servo.index)
   if not telemetry then
      return 0
   end
   local updated_ms = telemetry:last_update_ms():toint()
   if updated_ms == servo.updated_ms then
      return 0
   end
   servo.updated_ms = updated_ms
   local bytes = 0
   local chosen = SEND:get()
   for k, quantity in ipairs(QUANTITIES) do
      if has_bit(chosen, k - 1) then
         bytes = bytes + send(servo.names[k], quantity[2](telemetry))
      end
   end
   if has_bit(chosen, #QUANTITIES) and (not servo.warmth_ms or now_ms - servo.warmth_ms >= LOOK_MS) then
      local centidegrees = telemetry:motor_temperature_cdeg()
      bytes = bytes + send(servo.temperature, centidegrees and centidegrees * 0.01)
      servo.warmth_ms = now_ms
   end
   return bytes
end

-- Says once, after ten seconds with the same servos and parameters, what the link carries and what holds it.
local function report_rate(now_ms)
   if not report.due or now_ms - report.start_ms < REPORT_MS then
      return
   end
   report.due = false
   local seconds = (now_ms - report.start_ms) * 0.001
   local rate = report.samples / seconds / #servos
   local text = string.format("HUMS: %d servos, %.1f Hz, %.0f B/s", #servos, rate, report.bytes / seconds)
   gcs:send_text(INFO, text)
   if rate < WEAR_RATE_HZ - 1 then
      local remedy = "servos report slower"
      if report.waits > 0.1 * report.turns then
         remedy = "raise HUMS_LINK"
      elseif RATE:get() < WEAR_RATE_HZ then
         remedy = "raise HUMS_RATE"
      end
      gcs:send_text(WARNING, string.format("HUMS: wear needs %d Hz: %s", WEAR_RATE_HZ, remedy))
   end
end

local function update()
   if ENABLE:get() < 1 then
      return update, LOOK_MS
   end
   local now_ms = millis():toint()
   look_for_servos(now_ms)
   if #servos == 0 then
      return update, LOOK_MS
   end
   local limit = LINK:get()
   credit = math.min(credit + limit * (now_ms - (refilled_ms or now_ms)) * 0.001, 0.1 * limit)
   refilled_ms = now_ms
   -- The scheduler is often late, and calls at whole milliseconds: turns that were missed are caught up.
   local period_ms = 1000 / (math.max(RATE:get(), 0.1) * #servos)
   due_ms = math.max(due_ms or now_ms, now_ms - MOST_TURNS * period_ms)
   while due_ms <= now_ms do
      due_ms = due_ms + period_ms
      report.turns = report.turns + 1
      if credit >= 0 then
         turn = turn % #servos + 1
         local bytes = send_servo(servos[turn], now_ms)
         credit = credit - bytes
         report.bytes = report.bytes + bytes
         report.samples = report.samples + (bytes > 0 and 1 or 0)
      else
         report.waits = report.waits + 1
      end
   end
   report_rate(now_ms)
   return update, math.max(1, math.floor(due_ms - now_ms))
end

if not servo_telem then
   gcs:send_text(WARNING, "HUMS: this firmware has no servo telemetry; ArduPilot 4.7 or later is needed")
   return
end
gcs:send_text(INFO, "HUMS: servo bridge loaded")
return update()
