"""The package as installed, not as it lies in the tree; and the base install without the extras."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tarfile
import time
import zipfile
from pathlib import Path

import pytest

from mavhums.show.viewer import free_port

ROOT = Path(__file__).parents[1]
EXTRAS = ("torch", "sklearn", "rerun", "pyarrow", "matplotlib")


def python(*arguments: str, cwd: Path, path: Path) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": str(path)}
    return subprocess.run(
        [sys.executable, *arguments], cwd=cwd, env=environment, capture_output=True, text=True, check=False
    )


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the wheel and the source distribution."""
    folder = tmp_path_factory.mktemp("dist")
    command = [sys.executable, "-m", "hatchling", "build", "-d", str(folder)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    return folder


@pytest.fixture(scope="module")
def site(built: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder into which the wheel is installed."""
    folder = tmp_path_factory.mktemp("site")
    (wheel,) = built.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder)
    for package, home in (("mavhums", ROOT), ("mavhums_sim", ROOT / "sim")):
        # What is compiled fits modules of the same bytes and times.
        for path in (home / package).rglob("*"):
            own = folder / path.relative_to(home)
            if path.suffix == ".py" and own.exists():
                shutil.copystat(path, own)
            elif path.suffix in (".nbi", ".nbc"):
                own.parent.mkdir(exist_ok=True)
                shutil.copy2(path, own)
    return folder


def test_the_wheel_holds_both_packages_and_their_data(built: Path) -> None:
    (wheel,) = built.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
        [metadata] = [archive.read(name) for name in names if name.endswith("/METADATA")]
    for name in (
        "mavhums/py.typed",
        "mavhums/results/schema/assessment-2.json",
        "mavhums/actuator/airframes/paper.toml",
        "mavhums/learn/models/paper-instrumented.safetensors",
        "mavhums_sim/py.typed",
        "mavhums_sim/cli.py",
    ):
        assert name in names
    relative = re.findall(r"\]\((?!https://)[^)]*\)", metadata.decode())
    assert relative == [], "the package index shows the README away from its folder"
    assert not [name for name in names if name.startswith(("tests/", "sim/", "benchmarks/"))]
    assert "mavhums/_kernels.txt" in names, "no sources are named that the kernels were built from"
    assert "mavhums/_dialect.json" in names
    kernels = {f"mavhums/_kernels_{room}" for room in ("health", "log")}
    assert {name.split(".")[0] for name in names} >= kernels
    assert wheel.stat().st_size < 2_200_000


def test_the_source_distribution_holds_what_building_and_testing_need(built: Path) -> None:
    (source,) = built.glob("*.tar.gz")
    with tarfile.open(source) as archive:
        names = {name.split("/", 1)[1] for name in archive.getnames() if "/" in name}
    for name in ("pyproject.toml", "README.md", "LICENSE", "tests/conftest.py", "sim/mavhums_sim/ema.py"):
        assert name in names
    assert not [name for name in names if name.startswith(("mavhums/_kernels", "mavhums/_dialect"))]


@pytest.mark.slow
def test_what_is_installed_judges_a_log(site: Path, growing_log: Path, tmp_path: Path) -> None:
    script = "import mavhums; print(mavhums.__file__); import mavhums.cli.main; mavhums.cli.main.main()"
    outcome = python("-c", script, "analyse", str(growing_log), cwd=tmp_path, path=site)
    assert outcome.returncode == 11, outcome.stderr
    assert outcome.stdout.splitlines()[0] == str(site / "mavhums" / "__init__.py")
    assert "EMERGENCY: elevator" in outcome.stdout


def without_extras(*arguments: str) -> list[str]:
    """Run the command line in a Python that cannot import what the extras bring."""
    script = f"""
import sys
class Missing:
    def find_spec(self, name, path=None, target=None):
        if name in {EXTRAS!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
sys.meta_path.insert(0, Missing())
from mavhums.cli.main import main
main()
"""
    return ["-c", script, *arguments]


@pytest.mark.slow
def test_the_base_install_judges_a_log(site: Path, growing_log: Path, tmp_path: Path) -> None:
    outcome = python(*without_extras("analyse", str(growing_log), "--json"), cwd=tmp_path, path=site)
    assert outcome.returncode == 11, outcome.stderr
    assert '"condition": "emergency"' in outcome.stdout
    assert '"latest": "friction_emergency"' in outcome.stdout


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "extra"),
    [(("analyse", "LOG", "--rrd", "out.rrd"), "viewer"), (("train", "-o", "m"), "train")],
)
def test_a_missing_extra_is_one_line_that_names_the_command(
    site: Path, growing_log: Path, tmp_path: Path, command: tuple[str, ...], extra: str
) -> None:
    arguments = (str(growing_log) if argument == "LOG" else argument for argument in command)
    outcome = python(*without_extras(*arguments), cwd=tmp_path, path=site)
    assert outcome.returncode == 1
    assert f"pip install 'mavhums[{extra}]'" in outcome.stderr
    assert len(outcome.stderr.splitlines()) == 2
    assert list(tmp_path.iterdir()) == []


def _of_image(instruction: str) -> list[str]:
    """Return the words of an instruction of the Dockerfile, the last one of its name."""
    text = (ROOT / "Dockerfile").read_text(encoding="utf-8")
    words: list[str] = json.loads(re.findall(rf"^{instruction}\b[^\[]*(\[.*\])$", text, re.MULTILINE)[-1])
    return words


def test_the_image_serves_the_page_and_its_health_check_notices_its_end(tmp_path: Path) -> None:
    pytest.importorskip("uvicorn", reason="the page needs the extra 'serve'")
    port = str(free_port(0))
    command = [word.replace("/data", str(tmp_path)) for word in (*_of_image("ENTRYPOINT"), *_of_image("CMD"))]
    check = [sys.executable, *(word.replace("8080", port) for word in _of_image("HEALTHCHECK")[1:])]

    def is_healthy() -> bool:
        return subprocess.run(check, capture_output=True, check=False).returncode == 0

    assert not is_healthy()
    served = subprocess.Popen(
        [sys.executable, "-m", *command, "--port", port], cwd=tmp_path, stdout=subprocess.DEVNULL
    )
    try:
        end = time.monotonic() + 60
        while not is_healthy():
            assert time.monotonic() < end
            assert served.poll() is None
    finally:
        served.terminate()
        served.wait(30)
    assert not is_healthy()
