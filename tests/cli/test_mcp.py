"""The server for assistants, asked by the SDK's own client: over a pipe, and in this process."""

from __future__ import annotations

import asyncio
import json
import os
import shutil
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jsonschema
import psutil
import pytest

from mavhums.app.assistant import LogAssistant, Reach
from mavhums.app.settings import Options
from mavhums.results.assessment import json_schema
from tests.conftest import CARRIED, Run

pytest.importorskip("mcp", reason="the server needs the extra 'mcp'")

from mcp import Client
from mcp.client.stdio import StdioServerParameters, stdio_client

from mavhums.cli.serve import server_of

FROZEN = "aileron_frozen.tlog"


def asked(assistant: LogAssistant, tool: str, **given: Any) -> tuple[bool, str]:
    """Return whether a tool failed, and its text."""

    async def ask() -> tuple[bool, str]:
        async with Client(server_of(assistant)) as client:
            answer = await client.call_tool(tool, given)
            return bool(answer.is_error), answer.content[0].text  # type: ignore[union-attr]

    return asyncio.run(ask())


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with a log, a file that is none, and links that lead out of it."""
    opened = tmp_path / "opened"
    opened.mkdir()
    shutil.copy(CARRIED / FROZEN, opened)
    shutil.copy(CARRIED / "healthy.tlog", tmp_path / "secret.tlog")
    (opened / "text.tlog").write_text("no log at all")
    (opened / "link.tlog").symlink_to(tmp_path / "secret.tlog")
    (opened / "up").symlink_to(tmp_path)
    os.mkfifo(opened / "pipe.tlog")
    return opened


def test_a_client_over_a_pipe_gets_the_contract_and_the_words(folder: Path) -> None:
    server = StdioServerParameters(
        command=sys.executable,
        args=["-m", "mavhums", "mcp", "--folder", str(folder)],
        env={**os.environ, "MAVHUMS_STORE": "none"},
    )

    async def talk() -> tuple[Mapping[str, Any], list[str], list[bool | None]]:
        async with Client(stdio_client(server)) as client:
            tools = (await client.list_tools()).tools
            answer = await client.call_tool("analyse", {"logs": [FROZEN, "text.tlog"]})
            children = psutil.Process().children(recursive=True)
            assert [one for child in children for one in child.net_connections(kind="inet")] == []
            assert answer.structured_content is not None
            hints = [tool.annotations.read_only_hint if tool.annotations else None for tool in tools]
            return answer.structured_content, [tool.name for tool in tools], hints

    answer, tools, hints = asyncio.run(talk())
    assert tools == ["inspect", "analyse", "trend", "explain"]
    assert hints == [True] * 4
    [assessment], [failure] = answer["assessments"], answer["failures"]
    jsonschema.Draft202012Validator(json_schema()).validate(assessment)
    assert failure["log"] == "text.tlog"
    assert failure["remedy"]


def test_a_subject_is_explained_with_reason_and_advice(folder: Path) -> None:
    assistant = LogAssistant(Reach(folders=(folder,)))
    failed, text = asked(assistant, "explain", log=FROZEN, subject="Roll")
    assert not failed
    assert text.startswith("# DEGRADED: aileron ")
    assert "**What to do:** inspect each surface" in text
    assert "yaw" not in text
    assert asked(assistant, "explain", log=FROZEN, subject="pitch control")[1].startswith(
        "# undecided: pitch control not"
    )
    failed, text = asked(assistant, "explain", log=FROZEN, subject="flux capacitor")
    assert failed
    assert "Remedy: one of: roll control" in text
    assert json.loads(asked(assistant, "inspect", log=FROZEN)[1])["vehicles"][0]["kind"] == "fixed wing"


@pytest.mark.parametrize(
    ("log", "problem"),
    [
        ("../secret.tlog", "lies outside of"),
        ("link.tlog", "lies outside of"),
        ("up/secret.tlog", "lies outside of"),
        ("/etc/passwd", "lies outside of"),
        ("/nonesuch", "lies outside of"),  # whether it exists is not said
        ("missing.tlog", "no such file in"),
        ("pipe.tlog", "no such file in"),
        ("-", "no such file in"),
        ("", "no such file in"),
        ("a\0b", "no name of a file"),
        ("x" * 100_000, "no name of a file"),
        ("text.tlog", "text.tlog: "),
    ],
)
def test_what_may_not_be_read_is_refused_with_a_remedy(log: str, problem: str, folder: Path) -> None:
    assistant = LogAssistant(Reach(folders=(folder,)))
    answers = asked(assistant, "inspect", log=log), asked(assistant, "explain", log=log, subject="roll")
    for failed, text in answers:
        assert failed
        assert problem in text
        assert "Remedy: " in text
        assert len(text) < 700


def test_requests_and_logs_have_a_largest_size(folder: Path) -> None:
    small = LogAssistant(Reach(folders=(folder,), logs=2, log_bytes=1000))
    failed, text = asked(small, "analyse", logs=[FROZEN] * 3)
    assert failed
    assert "name 1 to 2" in text
    assert "larger than" in asked(small, "explain", log=FROZEN, subject="roll")[1]
    shutil.copy(CARRIED / FROZEN, folder / "big.tlog")
    packed = shutil.make_archive(str(folder / "packed"), "zip", folder, "big.tlog")
    unpacked = (folder / FROZEN).stat().st_size
    bounded = LogAssistant(Reach(folders=(folder,), log_bytes=unpacked - 1))
    assert Path(packed).stat().st_size < unpacked - 1
    assert "larger than" in asked(bounded, "inspect", log="packed.zip")[1]


def test_trends_are_those_of_the_store_and_nothing_is_kept(folder: Path, tmp_path: Path, run: Run) -> None:
    assert "no flights are kept yet" in asked(LogAssistant(Reach(folders=(folder,))), "trend")[1]
    store = tmp_path / "flights.sqlite"
    run("analyse", folder / FROZEN, "--store", store, "--keep")
    before = store.read_bytes()
    assistant = LogAssistant(Reach(folders=(folder,)), Options(store=store, keep=True))
    assert json.loads(asked(assistant, "trend")[1])["flights"] == 1
    assert not asked(assistant, "analyse", logs=[FROZEN])[0]
    assert store.read_bytes() == before
    failed, text = asked(assistant, "trend", aircraft="nobody")
    assert failed
    assert "nobody" in text
