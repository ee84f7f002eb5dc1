"""No folder grows into a package of its own."""

from __future__ import annotations

from collections import Counter

from .sources import ROOT, trees

LARGEST_SHARE = 0.12


def test_no_folder_holds_more_than_its_share_of_the_lines() -> None:
    """Then it holds more than one subject: divide it."""
    lines: Counter[str] = Counter()
    for path in trees():
        lines[path.parts[0]] += len((ROOT / path).read_text(encoding="utf-8").splitlines())
    shares = {folder: count / lines.total() for folder, count in lines.most_common()}
    too_large = {folder: f"{share:.1%}" for folder, share in shares.items() if share > LARGEST_SHARE}
    assert not too_large, f"more than {LARGEST_SHARE:.0%} of {lines.total()} lines: {too_large}"
