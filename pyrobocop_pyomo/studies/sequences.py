"""`mode_sequences` lists the sequences of modes that are allowed; a sweep solves their models."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from pyrobocop_pyomo.errors import ModelError

ModeSequence = tuple[str, ...]
Allowed = Callable[[str, str], bool]


def mode_sequences(
    modes: Iterable[str], length: int | Iterable[int], *, allowed: Allowed | None = None
) -> list[ModeSequence]:
    """All sequences of modes of a length, or of several lengths, whose successions are allowed.

    Parameters
    ----------
    modes : iterable of str
        Their names; of a dictionary, its keys.
    length : int or iterable of int
        Number of modes in a sequence, such as ``3`` or ``range(1, 4)``.
    allowed : callable, optional
        ``allowed(before, after)`` says whether one mode may follow another. By default every mode may follow every
        mode, itself included.

    Returns
    -------
    list of tuple of str
        The shortest first, otherwise in the order of ``modes``; an ordinary list, to be filtered further.

    Raises
    ------
    ModelError
        When a mode is named twice or is unknown, a length is not positive, or nothing is left.

    Examples
    --------
    >>> mode_sequences(["stick", "slip"], 2, allowed=lambda before, after: before != after)
    [('stick', 'slip'), ('slip', 'stick')]
    """
    names = list(modes)
    if len(set(names)) != len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise ModelError(f"mode '{twice}' is named twice; each mode needs a name of its own.")
    lengths = [length] if isinstance(length, int) else sorted(set(length))
    for count in lengths:
        if not isinstance(count, int) or count < 1:
            raise ModelError(f"length = {count!r}; a sequence has at least one mode.")
    followers = {name: [other for other in names if allowed is None or allowed(name, other)] for name in names}
    sequences: list[ModeSequence] = []
    grown: list[ModeSequence] = [(name,) for name in names]
    # Grown one by one, and not filtered out of the product, whose size may explode where few successions are allowed.
    for count in range(1, max(lengths, default=0) + 1):
        if count > 1:
            grown = [(*sequence, name) for sequence in grown for name in followers[sequence[-1]]]
        if count in lengths:
            sequences += grown
    if not sequences:
        raise ModelError(f"no sequence of {', '.join(map(repr, names)) or 'no modes'} has the length {length!r}.")
    return sequences
