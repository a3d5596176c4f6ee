"""Comments, messages and identifiers of source files."""

import re
from dataclasses import dataclass, field

import markdown
from passages import BREAK, Passage, passage

RUST = re.compile(
    r"""(?P<doc>//[/!][^\n]*)|(?P<comment>//[^\n]*)|(?P<block>/\*.*?\*/)"""
    r"""|(?P<raw>b?r(?P<hashes>\#+)".*?"(?P=hashes)|b?r"[^"]*")|(?P<string>b?"(?:[^"\\]|\\.)*")"""
    r"""|(?P<char>b?'(?:\\[^\n]+?|[^\\\n])')|(?P<name>[A-Za-z_]\w*)|(?P<number>\d[\w.]*)""",
    re.S,
)
PYTHON = re.compile(
    r"""(?P<comment>\#[^\n]*)|(?P<doc>[rR]?\"\"\".*?\"\"\")"""
    r"""|(?P<string>(?:\b[bBrRfFuU]{1,2})?(?:'(?:[^'\\\n]|\\.)*'|"(?:[^"\\\n]|\\.)*"))|(?P<name>[A-Za-z_]\w*)""",
    re.S,
)
SCRIPT = re.compile(
    r"""(?P<comment>(?<!:)//[^\n]*)|(?P<block>/\*.*?\*/)"""
    r"""|(?P<string>"(?:[^"\\\n]|\\.)*"|'(?:[^'\\\n]|\\.)*'|`[^`]*`)""",
    re.S,
)
SHELL_COMMENT = re.compile(r"^\s*#(?!!) ?(.*)")
SHELL_MESSAGE = re.compile(r"\b(?:echo|say|die|step|printf)\s+(['\"])(.*?)\1")
TOML_COMMENT = re.compile(r"""^(?P<code>(?:[^#"']|"[^"]*"|'[^']*')*)#\s?(?P<text>.*)$""")
TESTS = re.compile(r"#\[cfg\(test\)\]\s*(?:#\[[^\]]*\]\s*)*mod \w+ \{")
ATTRIBUTE = re.compile(r"\b(?:title|alt|placeholder|aria-label)=\"([^\"]*)\"")
CODE = re.compile(r"</|\);|^\s*(SELECT|CREATE|COPY|WITH|INSERT)\b")
# Sections of a Python docstring, and their entries.
SECTION = re.compile(r"^\s*(Args|Attributes|Returns|Yields|Raises|Example|Examples):\s*$")
ENTRY = re.compile(r"^\s*[*\w`]+(, [*\w`]+)*( \([^)]*\))?: ")
PLACEHOLDER = re.compile(r"\{[^{}]*\}|\$\{[^}]*\}|%[sd]")


@dataclass
class Source:
    """The passages of one file, and its identifiers with the line of their first use."""

    passages: list[Passage] = field(default_factory=list)
    names: dict[str, int] = field(default_factory=dict)


class Lines:
    """Comment lines that follow each other, gathered to passages."""

    def __init__(self, source: Source) -> None:
        self.source = source
        self.kind = ""
        self.gathered: list[tuple[int, str]] = []

    def add(self, kind: str, number: int, text: str) -> None:
        """Adds a line. A gap or another kind of comment begins a new group."""
        if self.gathered and (kind != self.kind or number != self.gathered[-1][0] + 1):
            self.close()
        self.kind = kind
        self.gathered.append((number, text))

    def close(self) -> None:
        """Hands the gathered lines on."""
        self.source.passages += markdown.passages(self.gathered)
        self.gathered = []


def message(number: int, text: str) -> list[Passage]:
    """Returns the passage of a string if it is a message: it holds words with spaces between them, and no code."""
    if CODE.search(text):
        return []
    text = PLACEHOLDER.sub(lambda m: "X" * len(m[0]), text)
    if not re.search(r"[a-z]{2,} [a-z(]", text):
        return []
    text = text.replace("\\n", BREAK * 2).replace('\\"', ' "')
    lines = [line.strip().rstrip("\\") for line in text.split("\n")]
    return [passage([(number + i, line) for i, line in enumerate(lines)])]


def docstring(line: int, body: str) -> list[tuple[int, str]]:
    """Returns the numbered lines of a docstring or block comment; entries of its sections become list items."""
    lines = []
    section = False
    for number, part in enumerate(body.split("\n"), line):
        if SECTION.match(part):
            section, part = True, ""
        elif section and ENTRY.match(part):
            part = "- " + part.strip()
        lines.append((number, part.strip(" *")))
    return lines


def tokens(pattern: re.Pattern[str], text: str, with_messages: bool, tests_from: int) -> Source:
    """Returns comments, messages and identifiers of a source file. Messages after `tests_from` are left out."""
    source = Source()
    comments = Lines(source)
    line = 1
    counted = 0
    for token in pattern.finditer(text):
        kind = token.lastgroup or ""
        if kind == "name":
            if token[0] not in source.names:
                source.names[token[0]] = text.count("\n", counted, token.start()) + line
            continue
        line += text.count("\n", counted, token.start())
        counted = token.start()
        # A comment behind code, and a long string within code, belong to that line alone.
        alone = not text[text.rfind("\n", 0, token.start()) + 1 : token.start()].strip()
        if kind == "comment" and not alone:
            source.passages += markdown.passages([(line, token[0].lstrip("#/!").strip())])
        elif kind == "doc" and pattern is PYTHON and not alone:
            for i, part in enumerate(token[0].split("\n") if with_messages else []):
                source.passages += message(line + i, part)
        elif pattern is RUST and kind in ("doc", "comment"):
            comments.add(kind, line, token[0].lstrip("/!").strip() if kind == "comment" else token[0][3:])
        elif kind == "comment":
            comments.add(kind, line, token[0].lstrip("#/!").strip())
        elif kind in ("doc", "block"):
            body = token[0].strip("\"'rR/*")
            source.passages += markdown.passages(docstring(line, body))
        elif kind == "string" and with_messages and token.start() < tests_from:
            source.passages += message(line, token[0].lstrip("bBrRfFuU")[1:-1])
    comments.close()
    return source


def rust(text: str, is_test: bool) -> Source:
    """Reads a Rust file."""
    tests = TESTS.search(text)
    return tokens(RUST, text, not is_test, tests.start() if tests else len(text))


def python(text: str, is_test: bool) -> Source:
    """Reads a Python file."""
    return tokens(PYTHON, text, not is_test, len(text))


def javascript(text: str, _is_test: bool) -> Source:
    """Returns comments and messages of a script of a page."""
    return tokens(SCRIPT, text, True, len(text))


def shell(text: str, _is_test: bool) -> Source:
    """Returns comments and messages of a shell script."""
    source = Source()
    comments = Lines(source)
    for number, line in enumerate(text.split("\n"), 1):
        if comment := SHELL_COMMENT.match(line):
            # Indented lines are those of a usage: each is a passage of its own.
            usage = comment[1].startswith("  ")
            comments.add("comment", number, ("- " if usage else "") + comment[1].strip("- "))
        for said in SHELL_MESSAGE.finditer(line):
            source.passages += message(number, said[2])
    comments.close()
    return source


def toml(text: str, _is_test: bool) -> Source:
    """Returns the comments of a TOML file. A comment behind a value is a passage of its own."""
    source = Source()
    comments = Lines(source)
    for number, line in enumerate(text.split("\n"), 1):
        comment = TOML_COMMENT.match(line)
        if comment and comment["code"].strip():
            source.passages.append(passage([(number, comment["text"])]))
        elif comment:
            comments.add("comment", number, comment["text"])
    comments.close()
    return source


def schema(text: str, _is_test: bool) -> Source:
    """Returns the descriptions of a JSON schema."""
    source = Source()
    for number, line in enumerate(text.split("\n"), 1):
        if found := re.search(r'"description": "((?:[^"\\]|\\.)*)"', line):
            parts = found[1].replace('\\"', '"').split("\\n")
            source.passages += markdown.passages([(number, part) for part in parts])
    return source


def page(text: str, _is_test: bool) -> Source:
    """Returns the text of an HTML page."""
    source = Source()
    text = re.sub(r"<(script|style).*?</\1>", lambda m: "\n" * m[0].count("\n"), text, flags=re.S)
    for number, line in enumerate(text.split("\n"), 1):
        for part in ATTRIBUTE.findall(line) + re.sub(r"<[^>]*>", "\n", line).split("\n"):
            if part.strip():
                source.passages.append(passage([(number, part.strip())]))
    return source


def document(text: str, _is_test: bool) -> Source:
    """Returns the passages of a Markdown document, without its front matter."""
    front = re.match(r"---\n.*?\n---\n", text, re.S)
    skipped = front[0].count("\n") if front else 0
    lines = text.split("\n")
    return Source(markdown.passages([(i, line) for i, line in enumerate(lines, 1) if i > skipped]))
