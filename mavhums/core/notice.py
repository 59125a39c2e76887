"""What every result says of itself."""

from __future__ import annotations

from typing import Final

__all__ = ["EPILOG", "NOTICE"]

NOTICE: Final = (
    "not an airworthiness decision; wear is validated in simulation only, "
    "control effectiveness also on real flights"
)
EPILOG: Final = f"{NOTICE[:1].upper()}{NOTICE[1:]}."
"""The notice as a sentence, at the end of a command's help."""
