"""The documentation is complete: every command, option and public name; calls in pages exist.

The strict build of the site (``make docs``) finds dead links in it and fields without a description.
"""

from __future__ import annotations

import inspect
import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
import pytest

import mavhums
from mavhums import learn
from mavhums.cli.main import cli
from mavhums_sim.cli import cli as simulator

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
GUIDES = sorted([*ROOT.glob("*.md"), ROOT / "bridge" / "README.md", *(ROOT / "mavhums").rglob("*.md")])
PAGES = sorted([*DOCS.rglob("*.md"), *GUIDES])
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
README_WORDS = 600


def commands(name: str, command: click.Command) -> Iterator[tuple[str, click.Command]]:
    yield name, command
    if isinstance(command, click.Group):
        context = click.Context(command)
        for key in command.list_commands(context):
            one = command.get_command(context, key)
            assert one, f"{name} lists {key}, which is not there"
            yield from commands(f"{name} {key}", one)


COMMANDS = dict([*commands("mavhums", cli), *commands("mavhums-sim", simulator)])


def named(path: Path) -> str:
    return str(path.relative_to(ROOT))


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_and_option_has_a_help_text(name: str) -> None:
    command = COMMANDS[name]
    assert command.help, f"{name} has no help"
    silent = [one.opts for one in command.params if isinstance(one, click.Option) and not one.help]
    assert not silent, f"{name}: no help for {silent}"


def undocumented(name: str, value: Any) -> Iterator[str]:
    """Yield a public name, and the members of a class, without a docstring of their own."""
    if callable(value) and not vars(value).get("__doc__", value.__doc__):
        yield name
    for key, one in vars(value).items() if inspect.isclass(value) else ():
        plain = one.__func__ if isinstance(one, staticmethod | classmethod) else one
        if not key.startswith("_") and (inspect.isfunction(plain) or isinstance(plain, property)):
            yield from [] if plain.__doc__ else [f"{name}.{key}"]


@pytest.mark.parametrize("module", [mavhums, learn])
def test_every_public_name_has_a_docstring(module: Any) -> None:
    names = [name for key in module.__all__ for name in undocumented(key, getattr(module, key))]
    assert names == [], "the site leaves out a name without a docstring"


def test_every_error_that_a_user_meets_is_public() -> None:
    for file in (ROOT / "mavhums").rglob("*.py"):
        for name in re.findall(
            r"^class ([A-Z]\w+Error)\(\w*Error\)", file.read_text(encoding="utf-8"), re.MULTILINE
        ):
            assert name in mavhums.__all__, f"{file.relative_to(ROOT)}: export {name} in mavhums/__init__.py"


def test_every_selector_is_introduced() -> None:
    page = (DOCS / "guide" / "selectors.md").read_text(encoding="utf-8")
    estimators = [
        name
        for name in learn.__all__
        if hasattr(getattr(learn, name), "fit") or hasattr(getattr(learn, name), "fit_transform")
    ]
    assert estimators
    assert [name for name in estimators if f"`{name}`" not in page] == []


@pytest.mark.parametrize("words", ["DShot", "QGroundControl", "vibration", "engine failure"])
@pytest.mark.parametrize("owner", ["ardupilot", "px4"])
def test_an_owner_finds_the_words_of_the_field_on_one_page(owner: str, words: str) -> None:
    page = (DOCS / "guide" / f"{owner}.md").read_text(encoding="utf-8")
    assert words.lower() in page.lower()


def _anchors(path: Path) -> set[str]:
    text = FENCE.sub("", path.read_text(encoding="utf-8"))
    headings = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", GUIDES, ids=named)
def test_every_link_leads_somewhere(page: Path) -> None:
    broken = []
    for target in re.findall(r"\]\(([^)\s]+)\)", FENCE.sub("", page.read_text(encoding="utf-8"))):
        if target.startswith(("https://", "mailto:")):
            continue
        name, _, anchor = target.partition("#")
        file = (page.parent / name).resolve() if name else page
        if not file.exists() or (anchor and file.suffix == ".md" and anchor not in _anchors(file)):
            broken.append(target)
    assert broken == []


def _called(page: Path) -> list[list[str]]:
    """Return the calls of our programs in a page's blocks of commands, as words."""
    text = page.read_text(encoding="utf-8")
    lines = [
        line
        for kind, body in FENCE.findall(text)
        if kind in ("console", "bash", "")
        for line in body.splitlines()
    ]
    calls = [line.removeprefix("$ ") for line in lines]
    return [
        shlex.split(line, comments=True) for line in calls if line.startswith(("mavhums ", "mavhums-sim "))
    ]


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_every_call_in_a_page_names_commands_and_options_that_exist(page: Path) -> None:
    for words in _called(page):
        name, rest = words[0], words[1:]
        while rest and f"{name} {rest[0]}" in COMMANDS:
            name, rest = f"{name} {rest[0]}", rest[1:]
        command = COMMANDS[name]
        assert not isinstance(command, click.Group) or rest[:1] in ([], ["--help"]), words
        known = {option for one in command.params for option in one.opts} | {"--help", "--version"}
        unknown = [word for word in rest if re.match(r"--?[a-z]", word) and word.split("=")[0] not in known]
        assert unknown == [], words


def test_the_readme_is_short() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").split()) <= README_WORDS


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_no_page_shows_a_path_of_somebodys_machine(page: Path) -> None:
    assert not re.search(r"/(home|root|tmp|Users|work)/\w", page.read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", [name for name, one in COMMANDS.items() if isinstance(one, click.Group)])
def test_the_list_of_commands_has_one_whole_line_each(name: str) -> None:
    group = COMMANDS[name]
    assert isinstance(group, click.Group)
    with click.Context(group, info_name=name, terminal_width=80) as context:
        formatter = context.make_formatter()
        group.format_commands(context, formatter)
    lines = [line for line in formatter.getvalue().splitlines() if line.startswith("  ")]
    assert sorted(line.split()[0] for line in lines) == sorted(group.list_commands(context))
    assert not [line for line in lines if line.endswith("...")]
