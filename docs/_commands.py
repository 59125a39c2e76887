"""The command-line reference, from the commands themselves."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack

import click

from mavhums.cli.main import cli as mavhums
from mavhums_sim.cli import cli as simulator

__all__ = ["PROGRAMS", "commands", "render"]

PROGRAMS = {"mavhums": mavhums, "mavhums-sim": simulator}
_WIDTH = 100


def commands() -> Iterator[tuple[str, click.Command, click.Context]]:
    """Yield every command of both programs with its full name and context, groups before what they hold."""
    for name, program in PROGRAMS.items():
        settings = {**program.context_settings, "max_content_width": _WIDTH, "terminal_width": _WIDTH}
        with click.Context(program, info_name=name, **settings) as root:
            yield from _below(name, program, root)


def _below(
    name: str, command: click.Command, context: click.Context
) -> Iterator[tuple[str, click.Command, click.Context]]:
    yield name, command, context
    if not isinstance(command, click.Group):
        return
    for child in command.list_commands(context):
        found = command.get_command(context, child)
        assert found is not None
        with ExitStack() as stack:
            inner = stack.enter_context(click.Context(found, info_name=child, parent=context))
            yield from _below(f"{name} {child}", found, inner)


def render() -> str:
    """Return the help text of every command, one heading each."""
    parts = []
    for name, command, context in commands():
        text = command.get_help(context)
        parts.append(f"## {name}\n\n```text\n{_trimmed(text)}\n```")
    return "\n\n".join(parts)


def _trimmed(text: str) -> str:
    return "\n".join(line.rstrip() for line in text.splitlines())
