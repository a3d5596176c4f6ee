"""The command `roadplane-train PART NAME [OPTION]...`: runs the `main` of one module of this package."""

from __future__ import annotations

import ast
import sys
from importlib import import_module
from pathlib import Path

PARTS = ("cars", "render", "net", "detect", "activity", "tracks")


def commands() -> dict[tuple[str, str], str]:
    """Maps part and name of each command to the first line of its module's docstring."""
    found = {}
    for part in PARTS:
        for path in sorted((Path(__file__).parent / part).glob("*.py")):
            tree = ast.parse(path.read_text(encoding="utf-8"))
            if any(isinstance(node, ast.FunctionDef) and node.name == "main" for node in tree.body):
                found[part, path.stem.replace("_", "-")] = (ast.get_docstring(tree) or "").partition("\n")[0]
    return found


def main() -> None:
    """Runs the command that the arguments name, or lists all commands."""
    known = commands()
    if len(sys.argv) == 2 and sys.argv[1] in ("-h", "--help"):
        print("usage: roadplane-train PART NAME [OPTION]...\n\nEach command explains its options: add --help.\n")
        for (part, name), summary in known.items():
            print(f"  {f'{part} {name}':<20} {summary}")
        return
    part, name = (*sys.argv[1:3], "", "")[:2]
    name = name.replace("_", "-")
    if (part, name) not in known:
        raise SystemExit("usage: roadplane-train PART NAME [OPTION]...   (roadplane-train --help lists the commands)")
    sys.argv = [f"roadplane-train {part} {name}", *sys.argv[3:]]
    import_module(f"roadplane_train.{part}.{name.replace('-', '_')}").main()


if __name__ == "__main__":
    main()
