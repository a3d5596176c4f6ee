"""Which files are read, and how."""

import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import lexing
from rules import Finding, Rules
from table import Table

ROOT = Path(__file__).resolve().parents[2]
DOCUMENTS = ("README.md", "CONTRIBUTING.md", "ARCHITECTURE.md", "CHANGELOG.md", "SECURITY.md")
DOCUMENT_FOLDERS = ("docs", "models", "scripts", "examples", "crates", ".github")
Reader = Callable[[str, bool], lexing.Source]
# Identifiers are checked in these; in others only text is.
NAMED = (".rs", ".py", ".js")


def reader(path: str) -> Reader | None:
    """Returns what reads a file, or nothing for files that are not checked."""
    name = path.rsplit("/", 1)[-1]
    suffix = name.rsplit(".", 1)[-1] if "." in name.lstrip(".") else ""
    if suffix == "md":
        return lexing.document if path in DOCUMENTS or path.startswith(DOCUMENT_FOLDERS) else None
    if path.startswith("docs/schemas/"):
        return lexing.schema
    by_suffix: dict[str, Reader] = {"rs": lexing.rust, "py": lexing.python, "toml": lexing.toml, "js": lexing.javascript}
    by_suffix |= {"html": lexing.page, "sh": lexing.shell}
    return by_suffix.get(suffix)


def script_reader(text: str) -> Reader | None:
    """Returns what reads a script without a suffix."""
    first = text.split("\n", 1)[0]
    if not first.startswith("#!"):
        return None
    return lexing.python if "python" in first else lexing.shell


def is_test(path: str) -> bool:
    """Says whether a file holds tests, whose strings are data."""
    name = path.rsplit("/", 1)[-1]
    return path.startswith("tests/") or "/tests/" in path or name.startswith("test_") or name in ("tests.rs", "test.rs")


def listed(under: list[Path]) -> list[str]:
    """Returns the files of the checkout, those that git does not know yet included."""
    command = ["git", "-C", str(ROOT), "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    paths = subprocess.run(command, check=True, capture_output=True, text=True).stdout.split("\0")
    inside = [str(path.relative_to(ROOT)) for path in under]
    if inside and "." not in inside:
        paths = [path for path in paths if any(within(path, folder) for folder in inside)]
    return sorted({path for path in paths if path})


def within(path: str, folder: str) -> bool:
    """Says whether a path is a folder or lies in it."""
    return path == folder or path.startswith(folder + "/")


def checked(table: Table, rules: Rules, under: list[Path]) -> Iterator[Finding]:
    """Yields the findings of every file under some folders, or of the whole checkout."""
    for path in listed(under):
        full = ROOT / path
        if any(within(path, folder) for folder in table.exempt) or full.is_symlink() or not full.is_file():
            continue
        if word := rules.name(full.name.split(".")[0]) if full.suffix in NAMED else None:
            yield Finding(path, 1, "names", f"file name ({word.ours} → {word.field})")
        read = reader(path)
        if read is None and "." in full.name:
            continue
        text = full.read_bytes().decode("utf-8", "ignore") if read or full.stat().st_size < 100_000 else ""
        read = read or script_reader(text)
        if read is None:
            continue
        source = read(text, is_test(path))
        for passage in source.passages:
            yield from rules.passage(path, passage)
        for name, line in source.names.items():
            if word := rules.name(name):
                yield Finding(path, line, "names", f"{name} ({word.ours} → {word.field})")
