"""The version of the package, and the notice in every result."""

from __future__ import annotations

from typing import Final

__version__ = "0.3.0"
REPOSITORY: Final = "https://github.com/mavhums/mavhums"

NOTICE: Final = (
    "not an airworthiness decision; wear is validated in simulation and on a bench with seeded faults, "
    "control effectiveness also on real flights"
)
EPILOG: Final = f"{NOTICE[:1].upper()}{NOTICE[1:]}."
"""The notice as a sentence, at the end of a command's help."""
