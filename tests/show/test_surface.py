from __future__ import annotations

import subprocess
import sys

import pytest

from mavhums import show


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'Viewer'"):
        _ = show.Viewer


@pytest.mark.parametrize(
    ("names", "unloaded"),
    [("", {"rerun", "rich", "pyarrow"}), ("; from mavhums.show import markdown, render", {"rerun"})],
)
def test_what_is_imported_does_not_load_rerun(names: str, unloaded: set[str]) -> None:
    code = f"import sys, mavhums.show{names}; print({unloaded} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
