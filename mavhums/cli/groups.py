"""The list of commands in the help: in groups, and one line a command."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import click

__all__ = ["Grouped"]

_LONGEST = 60  # a line of 80 columns holds that beside the name


class Grouped(click.Group):
    """A group that lists its commands under headings.

    Parameters
    ----------
    headings
        Names of commands by heading, in the order of the help. A command that is under none comes last,
        under *Other*.
    """

    def __init__(
        self, *arguments: Any, headings: Mapping[str, Sequence[str]] | None = None, **options: Any
    ) -> None:
        super().__init__(*arguments, **options)
        self._headings = dict(headings or {})

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the commands, the most used first."""
        names = self.list_commands(ctx)
        told = {name for several in self._headings.values() for name in several}
        rest = [name for name in names if name not in told]
        width = max(map(len, names), default=0)
        for heading, several in {**self._headings, "Other": rest}.items():
            rows = [
                (name.ljust(width), self.commands[name].get_short_help_str(_LONGEST))
                for name in several
                if name in names
            ]
            if rows:
                with formatter.section(heading):
                    formatter.write_dl(rows)
