"""Prints findings and their counts."""

from collections import Counter

from rules import Finding


def folder(path: str) -> str:
    """Returns the folder that a file is counted under: two levels deep, or the file itself at the top."""
    return "/".join(path.split("/")[:2])


def print_findings(findings: list[Finding], count_only: bool) -> None:
    """Prints each finding, then how many there are by folder and category."""
    if not count_only:
        for finding in findings:
            print(f"{finding.path}:{finding.line}: {finding.category}: {finding.text}")
    counts = Counter((folder(finding.path), finding.category) for finding in findings)
    totals = Counter(finding.category for finding in findings)
    if not findings:
        print("words: nothing found")
        return
    categories = ("long", "words", "names", "what")
    print(f"{'':32}" + "".join(f"{category:>8}" for category in categories))
    for name in sorted({name for name, _ in counts}):
        print(f"{name:32}" + "".join(f"{counts[name, category]:8}" for category in categories))
    print(f"{'total':32}" + "".join(f"{totals[category]:8}" for category in categories))
