"""Runs the commands that README.md and the book show, and compares their output with the shown one.

    python3 scripts/docs/commands.py [--update] [--bin DIR] [CHAPTER.md ...]

A fenced block tagged `console` holds commands and their output:

    ```console
    $ roadplane distance results/lot 3 7 --at 12.5
    12.50 s: [..] m
    ```

- A line that begins with `$ ` is a command for bash. If it ends in a backslash, the next line belongs to it.
- The lines below it are its output: stdout and stderr together. `[..]` stands for any text within a line. `...` alone
  on a line stands for any number of lines.
- A command must succeed. If it fails on purpose, the block shows its exit code: `$ roadplane run no.mp4; echo $?`.

Each file gets a fresh scratch folder, and its commands run there one after another. The folder holds:

- `lot.mp4` and its truth, `lot.truth.json` (tests/data);
- `still.jpg`, the first frame of the clip (docs/book/images);
- `results/lot`, a finished run of the clip with `--frames`.

`roadplane` and `roadplane-lab` come from target/release, or from the folder that --bin names.

--update writes the outputs into the files. Lines that still match keep their elisions. In new lines, paths of this
machine are elided.
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
# A line of progress, which a run prints after each ten seconds: only a slow machine shows it.
PROGRESS = re.compile(r" INFO .*\d frames/s(, .* left)?$")
FENCE = re.compile(r"^(?P<indent> *)```console\s*$")
LIMIT_S = 300
# One line of a comparison: a mark and the line. Marks: " " the line matches, "-" only shown, "+" only printed.
Change = tuple[str, str]


@dataclass
class Command:
    """A command of a file and its shown output, `lines[start:end]` of the file."""

    text: str
    indent: str
    start: int
    end: int
    shown: list[str]


def commands(lines: list[str]) -> list[Command]:
    """Returns the commands of all `console` blocks of a file."""
    found: list[Command] = []
    at = 0
    while at < len(lines):
        fence = FENCE.match(lines[at])
        at += 1
        if not fence:
            continue
        indent = fence["indent"]
        block_end = next((i for i in range(at, len(lines)) if lines[i].rstrip() == indent + "```"), len(lines))
        while at < block_end:
            if not lines[at].startswith(indent + "$ "):
                raise ValueError(f"line {at + 1}: a console block must begin with a command, `$ …`")
            parts = [lines[at].removeprefix(indent + "$ ")]
            while parts[-1].endswith("\\") and at + 1 < block_end:
                at += 1
                parts.append(lines[at].removeprefix(indent))
            start = at = at + 1
            while at < block_end and not lines[at].startswith(indent + "$ "):
                at += 1
            shown = [line.removeprefix(indent).rstrip() for line in lines[start:at]]
            found.append(Command("\n".join(parts), indent, start, at, shown))
    return found


def matches(shown: str, printed: str) -> bool:
    """Returns whether a printed line matches the shown one, which may contain `[..]`."""
    return re.fullmatch(".*".join(map(re.escape, shown.split("[..]"))), printed) is not None


def compare(shown: list[str], printed: list[str]) -> tuple[int, list[Change]]:
    """Aligns the shown lines with the printed ones.

    Returns the number of differing lines, and the aligned lines. A matching line is returned as it is shown.
    """
    rows, columns = len(shown), len(printed)
    # cost[i][j]: the fewest differences between shown[i:] and printed[j:].
    cost = [[0] * (columns + 1) for _ in range(rows + 1)]
    step = [[""] * (columns + 1) for _ in range(rows + 1)]
    for i in range(rows, -1, -1):
        for j in range(columns, -1, -1):
            choices: list[tuple[int, str]] = []
            if i < rows and shown[i] == "...":
                choices.append((cost[i + 1][j], "end of ..."))
                if j < columns:
                    choices.append((cost[i][j + 1], "within ..."))
            else:
                if i < rows and j < columns and matches(shown[i], printed[j]):
                    choices.append((cost[i + 1][j + 1], "match"))
                if i < rows:
                    choices.append((cost[i + 1][j] + 1, "-"))
            if j < columns:
                choices.append((cost[i][j + 1] + 1, "+"))
            if choices:
                cost[i][j], step[i][j] = min(choices, key=lambda choice: choice[0])
    changes: list[Change] = []
    i = j = 0
    while kind := step[i][j]:
        if kind in ("match", "end of ..."):
            changes.append((" ", shown[i]))
        elif kind == "-":
            changes.append(("-", shown[i]))
        elif kind == "+":
            changes.append(("+", printed[j]))
        i += kind in ("match", "end of ...", "-")
        j += kind in ("match", "within ...", "+")
    return cost[0][0], changes


class Scratch:
    """A folder in which commands run.

    Its path is the same for all files, since results contain the path of their input.
    """

    def __init__(self, folder: Path, binaries: Path) -> None:
        self.work = folder / "work"
        self.template = folder / "template"
        self.environment = {
            "PATH": f"{binaries}:{os.environ['PATH']}",
            "HOME": str(folder),
            "LANG": "C.UTF-8",
            "TERM": "dumb",
            "ROADPLANE_MODELS": str(ROOT / "models"),
            "ORT_DYLIB_PATH": os.environ.get("ORT_DYLIB_PATH", str(ROOT / ".runtime/libonnxruntime.so")),
        }
        self.work.mkdir()
        for name in ("lot.mp4", "lot.truth.json"):
            shutil.copy(ROOT / "tests/data" / name, self.work)
        shutil.copy(ROOT / "docs/book/images/still.jpg", self.work)
        status, printed = self.run("roadplane run lot.mp4 --out results --frames")
        if status:
            raise RuntimeError("\n".join(["the scratch folder cannot be filled: the run failed", *printed]))
        self.work.rename(self.template)

    def renew(self) -> None:
        """Restores the first state of the folder."""
        shutil.rmtree(self.work, ignore_errors=True)
        shutil.copytree(self.template, self.work)

    def run(self, command: str) -> tuple[int, list[str]]:
        """Runs a command; returns its exit status and the lines that it printed."""
        try:
            done = subprocess.run(
                ["bash", "-c", command],
                cwd=self.work,
                env=self.environment,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                timeout=LIMIT_S,
            )
        except subprocess.TimeoutExpired:
            return 124, [f"not done after {LIMIT_S} s"]
        printed = done.stdout.decode("utf-8", "replace").split("\n")
        lines = [line.rstrip() for line in printed if not PROGRESS.search(line)]
        while lines and not lines[-1]:
            lines.pop()
        return done.returncode, lines

    def elide(self, line: str) -> str:
        """Returns a printed line with the paths of this machine elided."""
        for path in (self.work, ROOT):
            line = re.sub(re.escape(str(path.resolve())) + r"(?=/|\b)", "[..]", line)
        return line


def check(file: Path, scratch: Scratch, update: bool) -> tuple[int, int]:
    """Runs the commands of one file; returns their number, and the number of those that differ."""
    lines = file.read_text(encoding="utf-8").split("\n")
    try:
        found = commands(lines)
    except ValueError as error:
        sys.exit(f"{file}: {error}")
    wrong = 0
    if found:
        scratch.renew()
    updated: list[tuple[Command, list[str]]] = []
    for command in found:
        status, printed = scratch.run(command.text)
        shown = command.shown
        trailing = [""] if shown and not shown[-1] else []
        differences, changes = compare(shown[:-1] if trailing else shown, printed)
        if status or (differences and not update):
            wrong += 1
            print(f"{file}:{command.start}: $ {command.text}")
            print("".join(f"  {mark} {line}\n" for mark, line in changes), end="")
            if status:
                print(f"  exit status {status}, but a command must succeed")
        elif differences:
            print(f"{file}:{command.start}: $ {command.text}: {differences} lines changed")
            kept = [scratch.elide(line) if mark == "+" else line for mark, line in changes if mark != "-"]
            updated.append((command, [(command.indent + line).rstrip() for line in kept + trailing]))
    for command, output in reversed(updated):
        lines[command.start : command.end] = output
    if updated:
        file.write_text("\n".join(lines), encoding="utf-8")
    return len(found), wrong


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("chapters", nargs="*", type=Path, help="default: README.md and all of docs/book")
    parser.add_argument("--update", action="store_true", help="write the outputs into the chapters")
    parser.add_argument("--bin", type=Path, default=ROOT / "target/release", help="folder of roadplane and roadplane-lab")
    arguments = parser.parse_args()
    for program in ("roadplane", "roadplane-lab"):
        if not (arguments.bin / program).exists():
            sys.exit(f"there is no {arguments.bin / program}: cargo build --release")
    chapters = arguments.chapters or [ROOT / "README.md", *sorted((ROOT / "docs/book").rglob("*.md"))]
    total = failed = 0
    with tempfile.TemporaryDirectory() as folder:
        scratch = Scratch(Path(folder).resolve(), arguments.bin.resolve())
        for chapter in chapters:
            run, wrong = check(chapter, scratch, arguments.update)
            total, failed = total + run, failed + wrong
    print(f"{total} commands run, " + (f"{failed} not as documented" if failed else "all as documented"))
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
