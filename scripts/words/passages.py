"""Passages of text and where each of their letters comes from."""

import re
from dataclasses import dataclass

# Code, addresses and formulas count as one word each and are not searched for words.
MASKED = re.compile(r"`+[^`]+`+|https?://[^\s)>\]]+|\$[^$\s][^$]*\$|<[a-zA-Z/!][^>]*>")
WORD = re.compile(r"`[^`]*`|\d+(?:[.,:×]\d+)*|[^\W\d_][\w]*(?:['’\-–/.][\w]+)*")
# Stands for an escaped line end in a message.
BREAK = "\x1e"
# A sentence ends with a mark, closing signs and a space before a capital, code or a digit.
END = re.compile(
    r"(?<!\be\.g)(?<!\bi\.e)(?<!\bcf)(?<!\bvs)(?<!\bFig)(?<!\bEq)[.!?][\"'”’)*_\]]*\s+(?=[\"'“‘(*_\[]*[A-Z`\d])"
    f"|{BREAK}+"
)


@dataclass(frozen=True)
class Passage:
    """A paragraph, list item, comment or message. `starts` holds (offset in `text`, line in the file)."""

    text: str
    starts: tuple[tuple[int, int], ...]
    measured: bool = True  # false for tables and headings: only their words are checked
    old: bool = False  # true where the page says that it quotes old words

    def line(self, offset: int) -> int:
        """Returns the line in the file of the letter at `offset`."""
        line = self.starts[0][1]
        for start, number in self.starts:
            if start > offset:
                break
            line = number
        return line


def passage(lines: list[tuple[int, str]], measured: bool = True, old: bool = False) -> Passage:
    """Joins numbered lines to one passage."""
    starts: list[tuple[int, int]] = []
    length = 0
    for number, text in lines:
        starts.append((length, number))
        length += len(text) + 1
    return Passage(" ".join(text for _, text in lines), tuple(starts), measured, old)


def masked(text: str) -> str:
    """Blanks code, addresses and formulas to one word of the same length, so that offsets stay."""
    return MASKED.sub(lambda m: "`" + "·" * (len(m[0]) - 2) + "`" if m[0][0] != "<" else " " * len(m[0]), text)


def sentences(blanked: str) -> list[tuple[int, str]]:
    """Returns the sentences of a blanked text with their offsets."""
    found = []
    begin = 0
    for end in END.finditer(blanked):
        found.append((begin, blanked[begin : end.end()]))
        begin = end.end()
    found.append((begin, blanked[begin:]))
    return [(offset, text) for offset, text in found if text.strip()]
