"""Count what is recovered of a damaged DataFlash log, beside pymavlink.

    python -m tests.log.dataflash.recovery [LOG.BIN] [--records 90000] [--seed 1]

A record counts as good if all its bytes are in the stream, unchanged and together; one that is accepted
and is not good counts as false. A record of an old cluster is false: it is in the log a second time. For
pymavlink, ``trusting`` is what DFReader's sequential reading accepts and ``indexed`` what its index does.
"""

from __future__ import annotations

import argparse
import gc
import tempfile
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tests.log.dataflash.kernel_check import scan
from tests.log.dataflash.synthetic import KINDS, damage, damaged_bytes, stream

COUNTS = dict(zip(KINDS, (400, 200, 200, 50, 100, 50, 10), strict=True))


class Recovery(NamedTuple):
    """Records: intact ones in the stream, then good and false ones of each reader."""

    intact: int
    good: int
    false: int
    trusting: tuple[int, int]
    indexed: tuple[int, int] | None


def recover(data: bytes, kind: str, count: int, seed: int, *, peers: bool = True) -> Recovery:
    """Damage a log and read what is left of it."""
    origin = damage(data, kind, count, seed)
    damaged = damaged_bytes(data, origin)
    starts = {record.offset: len(record.payload) + 3 for record in scan(data)[0]}
    intact = {
        place
        for place in np.flatnonzero(np.isin(origin, list(starts))).tolist()
        if _together(origin, place, starts[int(origin[place])])
        and (kind != "old clusters" or origin[place] == place)
    }
    found = {record.offset for record in scan(damaged)[0]}
    trusted = set(_trusting(damaged)) if peers else set()
    indexed = _indexed(damaged) if peers else None
    return Recovery(
        len(intact),
        len(found & intact),
        len(found - intact),
        (len(trusted & intact), len(trusted - intact)),
        None if indexed is None else (len(indexed & intact), len(indexed - intact)),
    )


def _together(origin: np.ndarray[tuple[int], np.dtype[np.int64]], place: int, size: int) -> bool:
    start = int(origin[place])
    return np.array_equal(origin[place : place + size], np.arange(start, start + size))


def _trusting(data: bytes) -> Iterator[int]:
    """Yield the offsets that DFReader's sequential reading accepts: it trusts every length."""
    lengths = {128: 89}
    place = 0
    while place + 3 <= len(data):
        length = lengths.get(data[place + 2], 0)
        if data[place : place + 2] != b"\xa3\x95" or length == 0 or place + length > len(data):
            place += 1
            continue
        if data[place + 2] == 128:
            lengths[data[place + 3]] = data[place + 4]
        yield place
        place += length


def _indexed(data: bytes) -> set[int] | None:
    """Return the offsets in DFReader's index; None if it raises."""
    from contextlib import redirect_stderr, redirect_stdout
    from io import StringIO

    from pymavlink.DFReader import DFReader_binary

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "damaged.bin"
        path.write_bytes(data)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ResourceWarning)  # it leaves the file open where it raises
            try:
                with redirect_stdout(StringIO()), redirect_stderr(StringIO()):
                    reader = DFReader_binary(str(path))
            except (ValueError, IndexError, TypeError, KeyError):
                gc.collect()
                return None
        reader.filehandle.close()
        return {int(offset) for offsets in reader.offsets for offset in offsets}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("log", nargs="?", type=Path)
    parser.add_argument("--records", type=int, default=90_000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    data = options.log.read_bytes() if options.log else b"".join(stream(options.seed, options.records))
    print("damage                    intact     good  false   trusting: good  false    indexed: good  false")
    for kind, count in COUNTS.items():
        row = recover(data, kind, count, options.seed)
        indexed = f"{row.indexed[0]:13,}{row.indexed[1]:7}" if row.indexed else f"{'raised':>20}"
        print(
            f"{count:4} {kind:16}{row.intact:11,}{row.good:9,}{row.false:7}"
            f"{row.trusting[0]:17,}{row.trusting[1]:7}{indexed:>24}",
            flush=True,
        )


if __name__ == "__main__":
    main()
