"""The documents are short enough to be read: words as `wc -w` counts them, with code and tables."""

from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
GENERATED = {"api", "arms", "contact", "hardware", "leaderboard", "performance", "reference", "tournament"}
"""Pages of docs/ that programs write."""
WRITTEN = 30_000
"""Words that all other pages of docs/ may have, without the records of decisions."""


def words(document: Path) -> int:
    return len(document.read_text(encoding="utf-8").split())


def test_the_written_pages_are_few_words() -> None:
    pages = {page.stem: words(page) for page in (ROOT / "docs").glob("*.md")}
    assert pages.keys() >= GENERATED
    written = {name: count for name, count in pages.items() if name not in GENERATED}
    longest = sorted(written.items(), key=lambda page: -page[1])[:5]
    assert sum(written.values()) <= WRITTEN, f"shorten some: {longest}"


@pytest.mark.parametrize(("document", "most"), [("docs/architecture.md", 1500), ("CONTRIBUTING.md", 700)])
def test_what_contributors_read_is_short(document: str, most: int) -> None:
    assert words(ROOT / document) <= most
