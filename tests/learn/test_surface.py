"""What the room shows, and what it must not import to show it."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import mavhums.learn
from mavhums.core.errors import MissingExtraError
from mavhums.learn import Card, Network, save_model


def python(code: str, *arguments: str) -> str:
    command = [sys.executable, "-W", "error", "-c", code, *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


def test_public_names() -> None:
    assert set(mavhums.learn.__all__) == set(dir(mavhums.learn))
    for name in mavhums.learn.__all__:
        assert getattr(mavhums.learn, name).__name__ == name
    with pytest.raises(AttributeError, match="no attribute 'pickle'"):
        getattr(mavhums.learn, "pickle")  # noqa: B009


def test_importing_the_room_imports_nothing_heavy() -> None:
    heavy = "{'sklearn', 'torch', 'scipy', 'pandas', 'safetensors', 'pydantic', 'numpy'}"
    assert python(f"import sys, mavhums.learn; print({heavy} & set(sys.modules))") == "set()"


def test_a_model_serves_without_scikit_learn_torch_and_scipy(
    tmp_path: Path, network: Network, card: Card, values: np.ndarray
) -> None:
    save_model(tmp_path / "model", network, card)
    np.save(tmp_path / "values.npy", values)
    code = """
import sys
sys.modules.update(dict.fromkeys(("sklearn", "torch", "scipy")))
import numpy as np
from mavhums.learn import load_model
model = load_model(sys.argv[1] + "/model")
print(model.network.p_emergency(np.load(sys.argv[1] + "/values.npy")).tolist())
"""
    assert python(code, str(tmp_path)) == str(network.p_emergency(values).tolist())


@pytest.mark.parametrize("name", ["ChiSquareRanking", "train_network"])
def test_without_scikit_learn_the_extra_is_named(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    for module in [name for name in sys.modules if name.startswith("mavhums.learn.")]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.delitem(vars(mavhums.learn), name, raising=False)
    monkeypatch.setitem(sys.modules, "sklearn", None)
    monkeypatch.setitem(sys.modules, "sklearn.base", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'mavhums\[train\]'"):
        getattr(mavhums.learn, name)
