"""A synthetic DataFlash log with the mix of records of a fixed-wing aircraft, and its peer DFReader."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

NEEDED = ["ATT", "CSRV", "RCOU", "IMU"]
_ROUND_US = 1_000_000
_LETTERS = {"Q": "<u8", "B": "u1", "H": "<u2", "h": "<i2", "I": "<u4", "f": "<f4", "c": "<i2", "C": "<u2",
            "L": "<i4", "e": "<i4", "N": "S16", "Z": "S64", "n": "S4"}  # fmt: skip
# type: letters, columns, records a second
_TYPES = {
    "FMT": (128, "BBnNZ", "Type,Length,Name,Format,Columns", 0),
    "IMU": (1, "QBffffffIIfBBHH", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz", 100),
    "ATT": (2, "QffffffB", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,AEKF", 25),
    "RCOU": (3, "Q" + 14 * "H", "TimeUS," + ",".join(f"C{n}" for n in range(1, 15)), 25),
    "CSRV": (4, "QBfffBfffffB", "TimeUS,Id,Pos,Force,Speed,Pow,PosCmd,V,A,MotT,PCBT,Err", 200),
    "XKF1": (5, "QBccCfffffffccce", "TimeUS,C,Roll,Pitch,Yaw,VN,VE,VD,dPD,PN,PE,PD,GX,GY,GZ,OH", 200),
    "XKQ": (6, "QBffff", "TimeUS,C,Q1,Q2,Q3,Q4", 100),
    "PIDR": (7, "QffffffffffB", "TimeUS,Tar,Act,Err,P,I,D,FF,DFF,Dmod,SRate,Flags", 50),
    "BARO": (8, "QBffcffIffB", "TimeUS,I,Alt,Press,Temp,CRt,AltAMSL,SMS,Offset,GndTemp,H", 20),
    "GPS": (9, "QBBIHBhLLeffffB", "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,Yaw,U", 5),
    "MSG": (10, "QZ", "TimeUS,Message", 1),
    "PARM": (11, "QNff", "TimeUS,Name,Value,Default", 10),
}


def _wire(name: str) -> np.dtype[np.void]:
    _, letters, columns, _ = _TYPES[name]
    fields = [(column, _LETTERS[letter]) for column, letter in zip(columns.split(","), letters, strict=True)]
    return np.dtype([("head", "S3"), *fields])


def _rows(name: str, count: int, rng: np.random.Generator) -> np.ndarray[Any, Any]:
    rows = np.zeros(count, dtype=_wire(name))
    rows["head"] = bytes([0xA3, 0x95, _TYPES[name][0]])
    for field in rows.dtype.names or ():
        kind = rows.dtype[field].kind
        if kind == "f":
            rows[field] = rng.uniform(-100, 100, count)
        elif kind in "iu" and field != "TimeUS":
            rows[field] = rng.integers(0, 100, count)
        elif kind == "S" and field != "head":
            rows[field] = rng.choice([b"SERVO1_TRIM", b"Mission: 3 WP", b"Throttle armed"], count)
    return rows


def write_log(path: Path, megabytes: int) -> int:
    """Write definitions and rounds of one second under ever later times; return the number of records."""
    rng = np.random.default_rng(1)
    head = np.zeros(len(_TYPES), dtype=_wire("FMT"))
    head["head"] = bytes([0xA3, 0x95, 128])
    for k, (name, (number, letters, columns, _)) in enumerate(_TYPES.items()):
        for field, value in zip(
            _TYPES["FMT"][2].split(","), (number, _wire(name).itemsize, name, letters, columns), strict=True
        ):
            head[field][k] = value
    names = [name for name in _TYPES if name != "FMT"]
    owner = rng.permutation(np.repeat(np.arange(len(names)), [_TYPES[name][3] for name in names]))
    pools = [_rows(name, _TYPES[name][3], rng) for name in names]
    taken = [iter(pool) for pool in pools]
    block = np.frombuffer(b"".join(next(taken[k]).tobytes() for k in owner), dtype=np.uint8).copy()
    sizes = np.array([pools[k].dtype.itemsize for k in owner])
    places = (np.cumsum(sizes) - sizes + 3)[:, None] + np.arange(8)
    rounds = max(1, round(megabytes * 1e6 / block.size))
    steps = np.arange(owner.size) * (_ROUND_US // owner.size)
    with path.open("wb") as file:
        file.write(head.tobytes())
        for k in range(rounds):
            times = (10**6 + k * _ROUND_US + steps).astype("<u8")
            block[places] = times.view(np.uint8).reshape(-1, 8)
            file.write(block.tobytes())
    return len(_TYPES) + rounds * owner.size


def dfreader(path: str, needed: bool) -> int:
    """Read with pymavlink's DFReader to DataFrames; return the number of rows."""
    import pandas as pd
    from pymavlink.DFReader import DFReader_binary

    reader = DFReader_binary(path)
    columns: dict[str, list[Any]] = {}
    while (message := reader.recv_match(type=NEEDED) if needed else reader.recv_msg()) is not None:
        fields = message.get_fieldnames()
        row = [getattr(message, field) for field in fields]
        columns.setdefault(message.get_type(), [fields]).append(row)
    frames = [pd.DataFrame(rows, columns=fields) for fields, *rows in columns.values()]
    return sum(len(frame) for frame in frames)
