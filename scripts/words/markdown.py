"""Passages of Markdown: documents, doc comments, docstrings."""

import re

from passages import Passage, passage

FENCE = re.compile(r"^\s*(```|~~~)")
ITEM = re.compile(r"^\s*(?:[-*+]|\d+[.)])\s+")
HEADING = re.compile(r"^\s*#{1,6}\s")
TABLE = re.compile(r"^\s*\|")
ADMONITION = re.compile(r"^\s*(!!!|\?\?\?|===)")
OLD = "<!-- words: old -->"
IMAGE = re.compile(r"!\[([^\]]*)\]\([^)]*\)")
LINK = re.compile(r"\[([^\]]+)\]\([^)]*\)(\{[^}]*\})?")
REFERENCE = re.compile(r"^\s*\[[^\]]+\]:\s")
RUST_LINK = re.compile(r"\[(`[^`]+`)\](\[[^\]]*\])?")


def plain(text: str) -> str:
    """Drops the addresses of links and pictures, and the signs of emphasis."""
    text = IMAGE.sub(r"\1", text)
    text = LINK.sub(lambda m: f"“{m[1]}”" if m[1].startswith("What ") else m[1], text)  # a title
    text = RUST_LINK.sub(r"\1", text)
    return text.replace("**", "").replace("\\|", "|")


def cells(number: int, text: str, old: bool) -> list[Passage]:
    """Returns the cells of a row of a table; sentences in them are not measured."""
    return [passage([(number, plain(cell))], False, old) for cell in text.strip().strip("|").split("|") if cell.strip(" -:")]


def blocks(lines: list[tuple[int, str]]) -> list[list[tuple[int, str]]]:
    """Splits numbered lines at blank lines. Blocks of code and link targets are left out."""
    found: list[list[tuple[int, str]]] = [[]]
    fence = ""
    for number, text in lines:
        mark = FENCE.match(text)
        if mark and not fence:
            fence = mark[1]
        elif mark and text.strip().startswith(fence):
            fence = ""
            continue
        if fence or not text.strip():
            found.append([])
        elif not REFERENCE.match(text):
            found[-1].append((number, text.rstrip()))
    return [block for block in found if block]


def block_passages(block: list[tuple[int, str]], old: bool) -> list[Passage]:
    """Returns the passages of one block: a heading, rows of a table, list items or a paragraph."""
    found: list[Passage] = []
    open_lines: list[tuple[int, str]] = []

    def close() -> None:
        if open_lines:
            found.append(passage(list(open_lines), old=old))
            open_lines.clear()

    for number, text in block:
        if TABLE.match(text):
            close()
            found += cells(number, text, old)
        elif HEADING.match(text) or ADMONITION.match(text):
            close()
            found.append(passage([(number, plain(text.strip("#!?= ")))], False, old))
        else:
            if ITEM.match(text):
                close()
            open_lines.append((number, plain(ITEM.sub("", text).strip().lstrip("> "))))
    close()
    return found


def passages(lines: list[tuple[int, str]]) -> list[Passage]:
    """Returns the passages of numbered lines of Markdown."""
    found: list[Passage] = []
    old = False
    for block in blocks(lines):
        rest = [(number, text) for number, text in block if OLD not in text]
        old = old or len(rest) < len(block)
        if rest:
            found += block_passages(rest, old)
            old = False
    return found
