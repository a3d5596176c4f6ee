"""The rules: long sentences, words of the table in text and in names, clauses with "what"."""

import re
from collections.abc import Iterator
from dataclasses import dataclass

from passages import WORD, Passage, masked, sentences
from table import Table, Word, parts

CODE = re.compile(r"`([^`]+)`")
NAME = re.compile(r"[A-Za-z_]\w*(?:-\w+)*")
# Titles and examples in quotation marks.
QUOTED = re.compile(r"“[^”]*”|\"[^\"]*\"")
LISTED = re.compile(r"(,|\band|\bor)\s+$")
LAST_WORD = re.compile(r"(\w+)\W*$")


@dataclass(frozen=True, order=True)
class Finding:
    """One place that breaks a rule."""

    path: str
    line: int
    category: str
    text: str


def shortened(text: str, limit: int = 160) -> str:
    """Returns a sentence on one line, cut after `limit` letters."""
    text = " ".join(text.split())
    return text if len(text) <= limit else text[: limit - 1] + "…"


class Rules:
    """Checks passages and names against a table."""

    def __init__(self, table: Table) -> None:
        self.table = table
        self.seen: dict[str, Word | None] = {}
        self.contracts = {parts(name) for name in table.contracts}
        within = [contract for contract in self.contracts if len(contract) > 1] + list(table.ordinary_names)
        self.within = sorted(within, key=lambda name: (-len(name), name))

    def name(self, name: str) -> Word | None:
        """Returns the row that a name breaks, if any. A longer contract or ordinary English within it is allowed."""
        if name not in self.seen:
            self.seen[name] = self._name(parts(name))
        return self.seen[name]

    def _name(self, split: tuple[str, ...]) -> Word | None:
        if split in self.contracts:
            return None
        joined = "_" + "_".join(split) + "_"
        for allowed in self.within:
            joined = joined.replace("_" + "_".join(allowed) + "_", "_·_")
        for word in self.table.words:
            if any("_" + "_".join(name) + "_" in joined for name in word.names):
                return word
        return None

    def passage(self, path: str, passage: Passage) -> Iterator[Finding]:
        """Yields what a passage breaks."""
        blanked = masked(passage.text)
        if passage.measured:
            yield from self.long(path, passage, blanked)
            yield from self.what(path, passage, blanked)
        if not passage.old and (passage.measured or path not in self.table.quoting):
            yield from self.words(path, passage, blanked)

    def long(self, path: str, passage: Passage, blanked: str) -> Iterator[Finding]:
        """Yields the sentences that are too long."""
        for offset, sentence in sentences(blanked):
            count = len(WORD.findall(sentence))
            if count > self.table.longest:
                text = shortened(passage.text[offset : offset + len(sentence)])
                yield Finding(path, passage.line(offset), "long", f"{count} words: {text}")

    def words(self, path: str, passage: Passage, blanked: str) -> Iterator[Finding]:
        """Yields the words of the table, in text and in code between backticks."""
        allowed = [match.span() for match in self.table.ordinary.finditer(blanked)]
        for word in self.table.words:
            for match in word.prose.finditer(blanked) if word.prose else ():
                if not any(begin <= match.start() < end for begin, end in allowed) and not self.quoted(blanked, match):
                    yield self.word(path, passage, match, word)
        for code in CODE.finditer(passage.text) if path not in self.table.quoting else ():
            for match in NAME.finditer(passage.text, *code.span(1)):
                if word := self.name(match[0]):
                    yield self.word(path, passage, match, word)

    def quoted(self, text: str, match: re.Match[str]) -> bool:
        """Says whether a match is a contract between quotation marks."""
        around = text[match.start() - 1 : match.start()] + text[match.end() : match.end() + 1]
        return around in ('""', "''", "“”", "‘’") and parts(match[0]) in self.contracts

    def word(self, path: str, passage: Passage, match: re.Match[str], word: Word) -> Finding:
        """Returns the finding of a word, with some text around it."""
        around = shortened(passage.text[max(0, match.start() - 40) : match.end() + 40])
        return Finding(path, passage.line(match.start()), "words", f"{match[0]!r} ({word.ours} → {word.field}): …{around}…")

    def what(self, path: str, passage: Passage, blanked: str) -> Iterator[Finding]:
        """Yields clauses with "what" in place of a noun. Questions are allowed, asked directly or reported."""
        for offset, sentence in sentences(QUOTED.sub(lambda m: "·" * len(m[0]), blanked)):
            if "?" in sentence:
                continue
            reported = False
            for match in self.table.what.finditer(sentence):
                before = sentence[: match.start()]
                last = LAST_WORD.search(before)
                # "It says what is wrong, where, and what to do": the verb counts for the whole list.
                if (last and last[1].lower() in self.table.what_after) or (reported and LISTED.search(before)):
                    reported = True
                    continue
                at = offset + match.start()
                around = shortened(passage.text[max(0, at - 40) : at + 50])
                yield Finding(path, passage.line(at), "what", f"…{around}…")
