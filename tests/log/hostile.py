"""Hold a decoder against mutated records, more of them than a run of the tests takes.

    NUMBA_BOUNDSCHECK=1 NUMBA_CACHE_DIR=checked python -m tests.log.hostile mavlink [--mutations 1000000]

With NUMBA_BOUNDSCHECK=1 (and a NUMBA_CACHE_DIR of its own) every array access of the kernels is checked.
"""

from __future__ import annotations

import argparse
import importlib
import resource
import time


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("format", choices=("mavlink", "dataflash", "ulog"))
    parser.add_argument("--mutations", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    begin = time.perf_counter()
    check = importlib.import_module(f"tests.log.{options.format}.hostile").check
    size, found = check(options.mutations, options.seed)
    took = time.perf_counter() - begin
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(
        f"{options.mutations:,} mutations, seed {options.seed}: {size / 1e6:.0f} MB, {found:,} records, "
        f"no difference; {took:.0f} s, peak memory {peak:.0f} MiB"
    )


if __name__ == "__main__":
    main()
