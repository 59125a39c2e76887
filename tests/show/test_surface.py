from __future__ import annotations

import subprocess
import sys

import pytest

from mavhums import show


def test_the_surface_is_what_it_says() -> None:
    assert show.__all__ == ["LiveViewer", "Recorder", "layout", "markdown", "render"]
    assert set(show.__all__) <= set(dir(show))
    for name in show.__all__:
        assert getattr(show, name).__name__ == name


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'Viewer'"):
        _ = show.Viewer


def test_importing_the_room_loads_neither_rerun_nor_rich() -> None:
    code = "import sys, mavhums.show; print(sorted({'rerun', 'rich', 'pyarrow'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_the_report_and_the_table_need_no_rerun() -> None:
    code = "import sys; from mavhums.show import markdown, render; print('rerun' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
