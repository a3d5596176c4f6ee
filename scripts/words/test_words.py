"""Tests of the check of words: `python3 -m pytest scripts/words`."""

from pathlib import Path

import lexing
import pytest
from files import ROOT, is_test, reader
from rules import Rules
from table import load, parts

RULES = Rules(load(ROOT, Path(__file__).parent / "table.toml"))


def found(text: str, path: str = "page.md", read: str = "document") -> list[tuple[int, str]]:
    """Returns line and category of each finding in a text."""
    source = getattr(lexing, read)(text, False)
    return sorted((f.line, f.category) for passage in source.passages for f in RULES.passage(path, passage))


def test_long_sentences_are_found_at_their_line() -> None:
    long = " ".join(["word"] * 31)
    assert found(f"Short one.\n\nShort. {long}.\n") == [(3, "long")]
    assert found(f"{long[:-5]}.\n") == []
    assert found(f"| {long} |\n\n# {long}\n\n```sh\n{long}\n```\n") == []


def test_code_and_addresses_are_one_word() -> None:
    code = "`" + " ".join(["word"] * 40) + "`"
    assert found(f"Run {code} or see [this]({'x' * 50}) or https://example.org/a/b.\n") == []


def test_numbers_and_abbreviations_do_not_end_sentences() -> None:
    words = " ".join(["word"] * 14)
    assert found(f"{words} 2.5 m, e.g. Those {words} and more.\n") == [(1, "long")]


@pytest.mark.parametrize(
    "text",
    [
        "Each look costs 3 ms.",
        "A clue is added.",
        "The car stands still.",
        "Boxes are held over.",
        "It was told a length.",
        "An honest sd.",
        "A lens bends lines.",
        "The stretch begins.",
        "What it `Sighting` is?",
        "It remembers cameras.",
    ],
)
def test_words_of_the_table_are_found(text: str) -> None:
    assert found(text + "\n") == [(1, "words")]


@pytest.mark.parametrize(
    "text",
    [
        "Look at the report.",
        "It looks like rain.",
        "Set `watch.look_s` and `--known`.",
        "The key 'told' is kept.",
        "A held-out set.",
        "Which frames: see `held_since`.",
        "The metric recall is 0.9.",
        "GB stands for gigabyte.",
        "The image is stretched.",
    ],
)
def test_contracts_and_ordinary_english_are_allowed(text: str) -> None:
    assert found(text + "\n") == []


def test_old_words_may_be_quoted() -> None:
    assert found("A `Clue` is now a factor.\n", "docs/book/glossary.md") == []
    assert found("| clue | factor |\n\nA clue.\n", "CHANGELOG.md") == [(3, "words")]
    assert found("A `Clue` is now a factor.\n", "README.md") == [(1, "words")]
    assert found("<!-- words: old -->\n\n| ours | new |\n|---|---|\n| clue | factor |\n\nA clue.\n") == [(7, "words")]


def test_files_may_not_have_old_names() -> None:
    assert found("See `view/src/camera.rs`.\n") == []
    assert found("See `view/src/look.rs`.\n") == [(1, "words")]


def test_what_needs_a_question() -> None:
    assert found("It draws what moves.\n") == [(1, "what")]
    assert found("What moves is drawn.\n") == [(1, "what")]
    assert found("The log says what is missing. What comes next?\n") == []
    assert found('# What comes out\n\nSee [What comes out](a.md) and "What moves".\n') == []
    assert found("Errors say what is wrong, where, and what to do.\n") == []


def test_rust_is_split_into_comments_messages_and_names() -> None:
    text = (
        "//! Crate of clues.\n\n/// A sighting:\n/// ```\n/// told();\n/// ```\nfn sighting_of(x: &str) -> String {\n"
        '    // held\n    let a = \'"\'; let b: &\'static str = r#"the car stands"#;\n    format!("it was told {known}")\n}\n'
        '#[cfg(test)]\nmod tests {\n    const TEXT: &str = "a car stands here";\n}\n'
    )
    assert found(text, "a.rs", "rust") == [(1, "words"), (3, "words"), (8, "words"), (10, "words")]
    names = lexing.rust(text, False).names
    assert names["sighting_of"] == 7 and "clues" not in names and "known" not in names and names["tests"] == 13


def test_a_message_of_several_lines_has_the_line_of_its_word() -> None:
    assert found('x("one line\\n \\\n   and a clue here")\n', "a.rs", "rust") == [(2, "words")]


def test_python_is_split_into_docstrings_comments_and_messages() -> None:
    text = 'def f() -> None:\n    """Text.\n\n    A clue.\n    """\n    # It was told.\n    print(f"the car stands {look}")\n'
    assert found(text, "a.py", "python") == [(4, "words"), (6, "words"), (7, "words")]


def test_comments_behind_code_are_sentences_of_their_own() -> None:
    half = " ".join(["word"] * 20)
    assert found(f"a = 1  # {half}\nb = 2  # {half}\n", "a.py", "python") == []
    assert found(f"a,  // {half}\nb,  // {half}\n", "a.rs", "rust") == []
    assert found(f'a = """\n{half}\n{half}\nit was told\n"""\n', "a.py", "python") == [(4, "words")]


def test_entries_of_docstrings_and_usages_are_sentences_of_their_own() -> None:
    entry = " ".join(["word"] * 20)
    text = f'"""Text.\n\n    Attributes:\n        a: {entry}\n        b: {entry}\n    """\n'
    assert found(text, "a.py", "python") == []
    assert found(f"#!/bin/sh\n# Text:\n#   do this  {entry}\n#   do that  {entry}\n", "a", "shell") == []


def test_other_files() -> None:
    assert found('a = "#" # a clue\n# one look\n', "a.toml", "toml") == [(1, "words"), (2, "words")]
    assert found('{\n "description": "A clue.\\nIt stands."\n}\n', "a.json", "schema") == [(2, "words"), (2, "words")]
    assert found('<p title="a clue">it stands<script>\nclue\n</script>\n', "a.html", "page") == [(1, "words"), (1, "words")]
    assert found("#!/bin/bash\n# A clue.\necho 'it was told'\n", "a", "shell") == [(2, "words"), (3, "words")]


@pytest.mark.parametrize("name", ["KnownCar", "known_cars", "CameraMemory", "left_half_rest", "is_told", "car-look"])
def test_names_of_the_table_are_found(name: str) -> None:
    assert RULES.name(name) is not None


@pytest.mark.parametrize("name", ["unknown", "lookup", "look_s", "known", "held_since_is_read", "memory", "recall", "HELD_OUT"])
def test_other_names_are_allowed(name: str) -> None:
    assert RULES.name(name) is None


def test_names_are_split_into_parts() -> None:
    assert parts("HTTPServer_v2-x") == ("http", "server", "v", "2", "x")


def test_files_have_readers() -> None:
    assert reader("README.md") is lexing.document and reader("notes.txt") is None
    assert is_test("crates/a/tests/b.rs") and not is_test("crates/a/src/b.rs")
