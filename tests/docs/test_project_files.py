"""The files around the code: workflows, templates, citation and metadata agree with the package."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path

import pytest

import mavhums
from mavhums.core.about import REPOSITORY
from mavhums.results.assessment import json_schema

yaml = pytest.importorskip("yaml", reason="YAML files are read with PyYAML")
ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
FILES = sorted([*(ROOT / ".github").rglob("*.yml"), ROOT / ".pre-commit-config.yaml", ROOT / "CITATION.cff"])


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.name)
def test_every_yaml_file_can_be_read(file: Path) -> None:
    assert isinstance(yaml.safe_load(file.read_text(encoding="utf-8")), dict)


def test_version_licence_and_address_agree() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert mavhums.__version__ == citation["version"]
    assert f"\n## {citation['version']}" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert citation["license"] == PROJECT["license"]
    assert citation["repository-code"] == PROJECT["urls"]["Homepage"] == REPOSITORY


@pytest.mark.parametrize("name", ["assessment-2", "live-1"])
def test_a_schema_is_identified_by_where_it_is_found(name: str) -> None:
    path = json_schema(name)["$id"].removeprefix(f"{REPOSITORY}/raw/main/")
    assert json.loads((ROOT / path).read_text(encoding="utf-8")) == json_schema(name)


def test_the_workflow_calls_what_ci_runs_on_every_python() -> None:
    jobs = yaml.safe_load((ROOT / ".github" / "workflows" / "ci.yml").read_text(encoding="utf-8"))["jobs"]
    assert jobs["full"]["strategy"]["matrix"]["python"] == ["3.11", "3.12", "3.13"]
    assert jobs["full"]["steps"][-1]["run"] == ".ci/run"
    for path in re.findall(r"tests/\w+", jobs["short"]["steps"][-1]["run"]):
        assert (ROOT / path).is_dir()


def test_a_release_publishes_without_a_secret_what_was_tried() -> None:
    workflow = yaml.safe_load((ROOT / ".github" / "workflows" / "release.yml").read_text(encoding="utf-8"))
    jobs = workflow["jobs"]
    assert "secrets." not in str(workflow)
    assert jobs["publish"]["permissions"] == {"id-token": "write"}
    assert jobs["publish"]["needs"] == ["source", "wheels"]
    assert "twine check --strict" in str(jobs["source"]["steps"])
    assert "mavhums.analyse" in str(jobs["wheels"]["steps"])


def test_every_document_that_the_code_names_exists() -> None:
    folders = [ROOT / name for name in ("mavhums", "sim", "benchmarks", "examples", "bridge")]
    files = [
        path for folder in folders for kind in ("*.py", "*.toml", "*.lua") for path in folder.rglob(kind)
    ]
    texts = {path: path.read_text(encoding="utf-8") for path in (*files, ROOT / "pyproject.toml")}
    named = {(path, name) for path, text in texts.items() for name in re.findall(r"\bdocs/[\w/-]+\.md", text)}
    assert not [(path, name) for path, name in named if not (ROOT / name).is_file()]
