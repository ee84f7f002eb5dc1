"""The comparison of shown and printed output sees what it should see, and nothing else."""

from __future__ import annotations

import pytest

from .shown_output import difference

PRINTED = "cart: 20 equations,\n  objective 13.42590 after 57 iterations in 0.20 s, violation 1.7e-09\n"


@pytest.mark.parametrize(
    "shown",
    [
        PRINTED,
        "cart: 20 equations, objective 13.4259",
        "cart: ... objective 13.4260 after 61 iterations in 3.5 s, violation 2.0e-11",
        "objective 13.42590 after\n57 iterations ...",
    ],
)
def test_what_changes_with_the_machine_may_differ(shown: str) -> None:
    assert difference(shown, PRINTED) is None


@pytest.mark.parametrize(
    ("shown", "said"),
    [
        ("cart: 21 equations", "shows 21 where its code prints 20"),
        ("objective 13.4659", "shows 13.4659 where its code prints 13.42590"),
        ("cart: 20 rows", "and its code prints"),
        ("objective unknown", "and its code prints"),
        ("violation 1.7e-09 of ...", "and its code prints"),
    ],
)
def test_other_words_and_other_numbers_are_told(shown: str, said: str) -> None:
    message = difference(shown, PRINTED)
    assert message is not None
    assert said in message
