"""Write a Rerun recording of one's own: how far each actuator's shaft lags behind its command.

    python examples/own_recording.py flight.tlog lag.rrd [AIRFRAME]

``mavhums.record`` writes the recording with the verdicts; this one shows that any quantity of the
histories can be drawn beside it. Needs the extra mavhums[viewer].
"""

from __future__ import annotations

import sys

import mavhums


def main(path: str, recording: str, airframe: str | None = None) -> None:
    """Record V1, V3 and their difference of each actuator."""
    import rerun as rr

    histories = mavhums.actuators(mavhums.read_log(path), airframe)
    if not histories:
        raise mavhums.MavhumsError(f"{path}: contains no data of the actuators", f"mavhums inspect {path}")
    stream = rr.RecordingStream("own_recording")
    stream.save(recording)
    for name, history in histories.items():
        frame = history.frame
        time = rr.TimeColumn("time", timestamp=frame.index.to_numpy(dtype="datetime64[us]"))
        curves = {"command": frame["V1"], "angle": frame["V3"], "behind": frame["V1"] - frame["V3"]}
        for curve, values in curves.items():
            stream.send_columns(f"{name}/{curve}", [time], rr.Scalars.columns(scalars=values.to_numpy()))
        if curves["behind"].notna().any():
            print(f"{name}: up to {curves['behind'].abs().max():.1f}° behind its command")
        else:
            print(f"{name}: command or angle is not in the log")
    stream.disconnect()
    print(f"open it with: rerun --bind 127.0.0.1 {recording}")


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit("usage: own_recording.py LOG RECORDING.rrd [AIRFRAME]")
    try:
        main(*sys.argv[1:4])
    except ImportError as error:
        sys.exit(f"{error}: pip install 'mavhums[viewer]'")
    except mavhums.MavhumsError as error:
        sys.exit(str(error))
