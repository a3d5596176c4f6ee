"""The table of words, read from table.toml."""

import json
import re
import tomllib
from dataclasses import dataclass
from pathlib import Path

CAMEL = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+|\d+")


@dataclass(frozen=True)
class Word:
    """One row: our word, the field's, and how to find ours in text and in names."""

    ours: str
    field: str
    prose: re.Pattern[str] | None
    names: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Table:
    """Every row, and what is allowed."""

    words: tuple[Word, ...]
    longest: int
    exempt: tuple[str, ...]
    quoting: tuple[str, ...]
    contracts: frozenset[str]
    ordinary: re.Pattern[str]
    ordinary_names: tuple[tuple[str, ...], ...]
    what: re.Pattern[str]
    what_after: frozenset[str]


def parts(name: str) -> tuple[str, ...]:
    """Splits a name: `KnownCar`, `known_car` and `known-car` give ("known", "car")."""
    return tuple(part.lower() for part in CAMEL.findall(name))


def schema_contracts(root: Path) -> set[str]:
    """Returns the property names and the allowed values of the schemas of our files."""
    found: set[str] = set()

    def walk(node: object) -> None:
        if isinstance(node, dict):
            found.update(node["properties"] if isinstance(node.get("properties"), dict) else ())
            found.update(value for value in node.get("enum", ()) if isinstance(value, str))
            for value in node.values():
                walk(value)
        elif isinstance(node, list):
            for value in node:
                walk(value)

    for path in sorted(root.glob("docs/schemas/*.json")):
        walk(json.loads(path.read_text()))
    return found


def setting_contracts(root: Path) -> set[str]:
    """Returns the keys of the default configuration, those in comments too."""
    text = (root / "configs/default.toml").read_text() if (root / "configs/default.toml").exists() else ""
    return set(re.findall(r"^(?:# )?(\w+) = ", text, re.M)) | set(re.findall(r"^\[(\w+)\]", text, re.M))


def alternatives(patterns: list[str]) -> re.Pattern[str] | None:
    """Joins patterns to one that finds any of them."""
    return re.compile("|".join(f"(?:{p})" for p in patterns), re.I) if patterns else None


def load(root: Path, path: Path) -> Table:
    """Reads the table and the contracts of a checkout."""
    data = tomllib.loads(path.read_text())
    words = tuple(
        Word(row["ours"], row["field"], alternatives(row["prose"]), tuple(parts(name) for name in row["names"]))
        for row in data["word"]
    )
    contracts = set(data["contracts"]["flags"]) | set(data["contracts"]["keys"])
    contracts |= schema_contracts(root) | setting_contracts(root)
    return Table(
        words,
        data["longest_sentence"],
        tuple(data["exempt"]),
        tuple(data["quoting"]["pages"]),
        frozenset(contracts),
        alternatives(data["ordinary"]["phrases"]) or re.compile(r"(?!)"),
        tuple(parts(name) for name in data["ordinary"]["names"]),
        re.compile(data["what"]["pattern"], re.I),
        frozenset(data["what"]["verbs"].split("|")),
    )
