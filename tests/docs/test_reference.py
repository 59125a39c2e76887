"""The documentation is complete and current: every command, option, field and public name, every link."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import click
import pytest

import mavhums
from docs import _commands, _public_names, _schemas, generate
from mavhums import learn

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = sorted([*DOCS.glob("*.md"), *ROOT.glob("*.md"), ROOT / "bridge" / "README.md"])
COMMANDS = {name: command for name, command, _ in _commands.commands()}
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
README_WORDS = 900


def named(path: Path) -> str:
    return str(path.relative_to(ROOT))


@pytest.mark.parametrize("page", generate.PAGES)
def test_the_generated_part_is_current(page: str) -> None:
    assert (DOCS / page).read_text(encoding="utf-8") == generate.current(page), "run make docs"


def test_check_names_a_stale_page_and_changes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for page in generate.PAGES:
        (tmp_path / page).write_text(generate.current(page), encoding="utf-8")
    stale = tmp_path / "profile.md"
    before = stale.read_text(encoding="utf-8").replace("gear_ratio", "ratio_of_the_gear")
    stale.write_text(before, encoding="utf-8")
    monkeypatch.setattr(generate, "FOLDER", tmp_path)
    assert generate.main(["--check"]) == 1
    assert capsys.readouterr().err == "docs/profile.md is stale: run make docs\n"
    assert stale.read_text(encoding="utf-8") == before
    assert generate.main([]) == 0
    assert generate.main(["--check"]) == 0


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_and_option_has_a_help_text(name: str) -> None:
    command = COMMANDS[name]
    assert command.help, f"{name} has no help"
    silent = [one.opts for one in command.params if isinstance(one, click.Option) and not one.help]
    assert not silent, f"{name}: no help for {silent}"


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_its_chapter(name: str) -> None:
    assert f"\n## {name}\n" in (DOCS / "command-line.md").read_text(encoding="utf-8")


def test_every_field_is_described_and_nothing_else_is() -> None:
    assert _schemas.undescribed() == [], "describe these in docs/fields.toml"
    assert _schemas.unused() == [], "docs/fields.toml describes what does not exist"


def test_every_public_name_has_a_docstring_and_a_chapter() -> None:
    assert _public_names.undocumented() == []
    page = (DOCS / "python.md").read_text(encoding="utf-8")
    for module in (mavhums, learn):
        for name in module.__all__:
            assert f"\n### {module.__name__}.{name}\n" in page


def test_every_error_that_a_user_meets_is_public() -> None:
    for file in (ROOT / "mavhums").rglob("*.py"):
        for name in re.findall(
            r"^class ([A-Z]\w+Error)\(\w*Error\)", file.read_text(encoding="utf-8"), re.MULTILINE
        ):
            assert name in mavhums.__all__, f"{file.relative_to(ROOT)}: export {name} in mavhums/__init__.py"


def test_every_selector_is_introduced() -> None:
    page = (DOCS / "selectors.md").read_text(encoding="utf-8")
    estimators = [
        name
        for name in learn.__all__
        if hasattr(getattr(learn, name), "fit") or hasattr(getattr(learn, name), "fit_transform")
    ]
    assert estimators
    assert [name for name in estimators if f"`{name}`" not in page] == []


def test_every_page_is_in_the_index() -> None:
    index = (DOCS / "index.md").read_text(encoding="utf-8")
    pages = [page.name for page in DOCS.glob("*.md") if page.name != "index.md"]
    assert [page for page in pages if f"({page})" not in index] == []


def _anchors(path: Path) -> set[str]:
    text = FENCE.sub("", path.read_text(encoding="utf-8"))
    headings = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=named)
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
