"""Checks that the relative links of Markdown files point to files that exist, and to headings that they have.

    python3 scripts/docs/links.py FILE.md ...

mkdocs checks the links of the book's chapters.
"""

import re
import sys
from pathlib import Path

LINK = re.compile(
    r"!?\[[^\]]*\]\(<?([^)\s>]+)>?(?:\s+\"[^\"]*\")?\)|(?:src|href)=\"([^\"]+)\"|^\[[^\]]+\]:\s+(\S+)", re.MULTILINE
)
FENCE = re.compile(r"^( *)(```|~~~).*?^\1\2\s*$", re.MULTILINE | re.DOTALL)
CODE = re.compile(r"`[^`\n]*`")
HEADING = re.compile(r"^#{1,6}\s+(.+?)\s*#*$", re.MULTILINE)
ELSEWHERE = re.compile(r"^[a-z][a-z0-9+.-]*:", re.IGNORECASE)


def anchors(text: str) -> set[str]:
    """Returns the anchors of a file's headings, as GitHub and mkdocs name them."""
    found: set[str] = set()
    for heading in HEADING.findall(FENCE.sub("", text)):
        words = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).replace("`", "")
        slug = re.sub(r"[^\w\s-]", "", words.lower())
        found |= {re.sub(r"\s", "-", slug.strip()), re.sub(r"[\s-]+", "-", slug.strip())}
    return found


def broken(file: Path) -> list[str]:
    """Returns one message for every broken link of a file."""
    messages = []
    text = file.read_text(encoding="utf-8")
    for match in LINK.finditer(CODE.sub("", FENCE.sub("", text))):
        link = next(group for group in match.groups() if group)
        if ELSEWHERE.match(link):
            continue
        path, _, anchor = link.partition("#")
        target = file.parent / path if path else file
        if not target.exists():
            messages.append(f"{file}: there is no {link}")
        elif anchor and target.suffix == ".md" and anchor not in anchors(target.read_text(encoding="utf-8")):
            messages.append(f"{file}: {path or file.name} has no heading #{anchor}")
    return messages


def main() -> int:
    messages: list[str] = []
    for name in sys.argv[1:]:
        file = Path(name)
        messages += broken(file) if file.exists() else [f"{file} is missing"]
    print("\n".join(messages) or f"links of {len(sys.argv) - 1} files are good", file=sys.stderr if messages else sys.stdout)
    return 1 if messages else 0


if __name__ == "__main__":
    sys.exit(main())
