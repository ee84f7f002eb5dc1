"""Fenced code blocks of a Markdown page."""

import re
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]

# The language of a directive is its name in braces, with what follows.
FENCE = re.compile(r"^(?P<fence>```+)(?P<language>[^\n`]*)\n(?P<text>.*?)^(?P=fence)$", re.MULTILINE | re.DOTALL)


@dataclass(frozen=True)
class CodeBlock:
    """One block, with the heading above it."""

    page: Path
    line: int
    language: str
    text: str
    heading: str


def code_blocks(page: Path, *languages: str) -> list[CodeBlock]:
    content = page.read_text(encoding="utf-8")
    found = []
    for match in FENCE.finditer(content):
        if match["language"] in languages:
            before = content[: match.start()]
            # A comment in a shell or Python block above also starts with '#': look outside of the blocks only.
            headings = re.findall(r"^#+ (.+)$", FENCE.sub("", before), re.MULTILINE)
            line = before.count("\n") + 2
            found.append(CodeBlock(page, line, match["language"], match["text"], headings[-1] if headings else ""))
    return found


def pages() -> list[Path]:
    documents = sorted(path for path in (ROOT / "docs").rglob("*.md") if "_build" not in path.parts)
    return [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *documents]
