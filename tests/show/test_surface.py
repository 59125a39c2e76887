from __future__ import annotations

import subprocess
import sys


def test_a_text_loads_no_rerun() -> None:
    code = "import sys, mavhums.show.markdown_report, mavhums.show.terminal; print('rerun' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
