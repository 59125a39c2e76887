"""Link load of the servo bridge: ``python -m benchmarks.bridge``.

Runs ``bridge/servo_bridge.lua`` for 20 s against a stand-in of the autopilot whose servos report everything
at 200 Hz, packs what it sends as MAVLink 2, and counts the bytes. A serial radio of 57.6 kbit/s carries
5760 bytes per second.
"""

from __future__ import annotations

from tests.bridge.autopilot import Autopilot, Telemetry

RADIO_BYTES_S = 57600 / 10
ALL, CURRENT_AND_SPEED = 63, 24


def cost(servos: int, rate_hz: float, send: int) -> tuple[float, float]:
    """Return bytes per second and the rate of each servo, on an unlimited link."""
    parameters = {"HUMS_RATE": rate_hz, "HUMS_LINK": 1e6, "HUMS_SEND": send}

    def report(now_ms: int) -> dict[int, Telemetry]:
        updated = now_ms // 5 * 5
        return {k: Telemetry(updated, 1.0, 1.0, 27.0, 0.3, 12.0, 3100) for k in range(servos)}

    autopilot = Autopilot(report, parameters)
    autopilot.run(22, start_ms=5000)
    start_ms, end_ms = 6000, 26000
    samples = sum(one.name == "S1A" and start_ms <= one.time_ms < end_ms for one in autopilot.sent)
    return autopilot.bytes_per_second(start_ms, end_ms), 1000 * samples / (end_ms - start_ms)


def main() -> None:
    """Print the table of ``bridge/README.md``."""
    print(
        "| servos | HUMS_RATE, Hz | reached, Hz | everything, B/s | of 57.6 kbit/s | A and Spd, B/s | of it |"
    )
    print("|---|---|---|---|---|---|---|")
    for servos in (4, 8):
        for rate_hz in (10, 25):
            full, reached = cost(servos, rate_hz, ALL)
            lean, _ = cost(servos, rate_hz, CURRENT_AND_SPEED)
            shares = [f"{100 * value / RADIO_BYTES_S:.0f} %" for value in (full, lean)]
            row = (servos, rate_hz, f"{reached:.1f}", f"{full:.0f}", shares[0], f"{lean:.0f}", shares[1])
            print("| " + " | ".join(map(str, row)) + " |")


if __name__ == "__main__":
    main()
