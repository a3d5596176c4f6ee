"""Runs the Python examples of README.md and the book on a finished run.

    python scripts/docs/examples.py RUN

Every fenced block tagged `python` runs in a scratch folder, where `results/lot` is RUN. The blocks of a file run one
after another and share their variables. This needs the roadplane package with its extras (scripts/python/check).
"""

import os
import re
import sys
import tempfile
import traceback
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
BLOCK = re.compile(r"^```python\s*\n(.*?)^```\s*$", re.MULTILINE | re.DOTALL)


def main() -> int:
    run = Path(sys.argv[1]).resolve()
    files = [ROOT / "README.md", *sorted((ROOT / "docs/book").rglob("*.md"))]
    total = failed = 0
    for file in files:
        text = file.read_text(encoding="utf-8")
        names: dict[str, Any] = {"__name__": "__main__"}
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / "results").mkdir()
            (Path(folder) / "results/lot").symlink_to(run)
            os.chdir(folder)
            for block in BLOCK.finditer(text):
                total += 1
                # Empty lines before the code, so that messages name the line of the file.
                lines_before = text.count("\n", 0, block.start(1))
                try:
                    exec(compile("\n" * lines_before + block[1], str(file), "exec"), names)
                except Exception:
                    failed += 1
                    traceback.print_exc()
            os.chdir(ROOT)
    print(f"{total} Python examples run, {failed} failed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
