"""Output that a page shows, compared with what the page's code prints.

Words are the same. Line breaks and widths of columns do not matter, and three dots stand for anything. Numbers of four
digits or more agree to a part in a thousand, and a whole number before a word is the same: "20 equations". Others are
rounded values, residuals, seconds and iterations, which depend on the machine: there has to be a number, no more.
"""

import re
from math import isclose

NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w])")
COUNT_OF_WORK = "iteration"


def difference(shown: str, printed: str) -> str | None:
    """What of the shown text is not printed, as a message; None where all of it is."""
    shown, printed = " ".join(shown.split()), " ".join(printed.split())
    numbers = list(NUMBER.finditer(shown))
    pattern, end = "", 0
    for number in numbers:
        pattern += _words(shown[end : number.start()]) + f"({NUMBER.pattern})"
        end = number.end()
    found = re.search(pattern + _words(shown[end:]), printed)
    if found is None:
        return f"the page shows\n{shown}\nand its code prints\n{printed}"
    for number, now in zip(numbers, found.groups(), strict=True):
        if not _agree(number[0], now, shown[number.end() :]):
            return f"the page shows {number[0]} where its code prints {now}: {found[0]}"
    return None


def _words(text: str) -> str:
    return ".*?".join(re.escape(part) for part in text.split("..."))


def _agree(shown: str, now: str, behind: str) -> bool:
    digits = re.sub(r"e.*|\D", "", shown).lstrip("0")
    if shown.isdigit() and re.match(r" [a-z]", behind) and not behind[1:].startswith(COUNT_OF_WORK):
        return shown == now
    return len(digits) < 4 or isclose(float(shown), float(now), rel_tol=1e-3)
