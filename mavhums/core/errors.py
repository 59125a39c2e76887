"""Errors that a user can act on, and the exit codes of the command line."""

from __future__ import annotations

from enum import IntEnum
from typing import Final


class ExitCode(IntEnum):
    """Exit codes of ``mavhums analyse``; if several apply, the first in this order is used.

    2, 11, 10, 1, 12, 3, 0. Only ``fleet digest`` ends with 4.
    """

    OK = 0
    ERROR = 1
    USAGE = 2
    READ_WITH_LOSSES = 3
    NOT_SENT = 4
    DEGRADED = 10
    EMERGENCY = 11
    UNDECIDED = 12


GRAVEST_FIRST: Final = (
    ExitCode.EMERGENCY,
    ExitCode.DEGRADED,
    ExitCode.ERROR,
    ExitCode.UNDECIDED,
    ExitCode.READ_WITH_LOSSES,
    ExitCode.OK,
)
"""Of several exit codes the first one applies."""


class MavhumsError(Exception):
    """A problem in one line, and its remedy.

    Parameters
    ----------
    problem
        What is wrong, naming the file and the place.
    remedy
        What the user can do about it.

    Examples
    --------
    >>> import mavhums
    >>> try:
    ...     mavhums.analyse("missing.tlog")
    ... except MavhumsError as error:
    ...     print(f"{error.problem} ({error.remedy})")
    missing.tlog: no such file (check the path)
    """

    def __init__(self, problem: str, remedy: str = "") -> None:
        super().__init__(f"{problem}: {remedy}" if remedy else problem)
        self.problem = problem
        self.remedy = remedy


class UnreadableLogError(MavhumsError):
    """The file is missing, or is not a log that mavhums reads."""


class MissingExtraError(MavhumsError):
    """A feature needs packages that are not part of the base install."""

    def __init__(self, feature: str, extra: str) -> None:
        super().__init__(
            f"{feature} needs an optional package",
            f"pip install 'mavhums[{extra}]' (from a clone: .venv/bin/pip install -e '.[{extra}]')",
        )
