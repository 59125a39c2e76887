"""Studies: published results set beside ours, with one command.

>>> from mavhums.study import write_study
>>> write_study("report", quick=True)  # doctest: +SKIP
"""

from __future__ import annotations

from typing import Any

__all__ = ["write_study"]


def __getattr__(name: str) -> Any:
    if name != "write_study":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from mavhums.core.errors import MissingExtraError

    try:
        from mavhums.study.run import write_study
    except ModuleNotFoundError as error:
        raise MissingExtraError("the study", "all") from error
    return write_study
