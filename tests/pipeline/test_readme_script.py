"""The example of the README as a script of its own."""

import re
import subprocess
import sys

from small import ROOT


def test_the_example_is_a_script_that_workers_can_import(tmp_path):
    """A worker process imports the script under another name, in which it must compute nothing."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"## From Python\n\n```python\n(.*?)```", text, re.DOTALL)
    (tmp_path / "script.py").write_text(code)
    subprocess.run([sys.executable, "-c", "import script"], cwd=tmp_path, check=True)
