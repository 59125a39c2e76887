"""The program: ``python -m mavhums``, and ``mavhums``."""

import os
import signal

# Nothing that other packages install changes a verdict: to look for it costs each start 15 ms. Matrices are
# small: OpenBLAS's threads cost it 100 ms.
os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# Before anything is loaded there is nothing to end in order: Ctrl-C ends the program without a traceback.
if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def main() -> None:
    """Run the command line."""
    from mavhums.cli.main import main as run

    run()


if __name__ == "__main__":
    main()
