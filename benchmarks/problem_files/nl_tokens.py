"""The two spellings of ``.nl`` files, as text (``g``) and binary (``b``), read item by item."""

from __future__ import annotations

import struct
from typing import Protocol

from pyrobocop_pyomo.errors import ModelError

HEADER_LINES = 10


class NlTokens(Protocol):
    """Items of a file behind its header, one after the other."""

    def letter(self) -> str:
        """The letter that says what follows; empty at the end."""
        ...

    def integer(self) -> int:
        """A whole number."""
        ...

    def short(self) -> int:
        """A whole number that is stored in two bytes."""
        ...

    def number(self) -> float:
        """A number."""
        ...

    def word(self) -> str:
        """A name."""
        ...

    def place(self) -> str:
        """Where the item is that was read last, for messages."""
        ...


def open_nl(content: bytes, path: object) -> tuple[list[list[int]], NlTokens]:
    """The counts in the lines of the header, and what follows.

    Raises
    ------
    ModelError
        When it is no ``.nl`` file.
    """
    *lines, body = content.split(b"\n", HEADER_LINES)
    if len(lines) < HEADER_LINES or lines[0][:1] not in (b"g", b"b"):
        raise ModelError(f"{path}: is no .nl file. Its first line begins with 'g' (text) or 'b' (binary).")
    try:
        header = [[int(word) for word in line.split(b"#")[0].split()] for line in lines[1:]]
    except ValueError as error:
        raise ModelError(f"{path}: the header holds something else than counts ({error}).") from None
    if lines[0][:1] == b"g":
        return header, _TextTokens(body.decode("utf-8", "replace"))
    arithmetic = header[4][2] if len(header[4]) > 2 else 0  # 1: IEEE little-endian, 2: big-endian
    return header, _BinaryTokens(body, ">" if arithmetic == 2 else "<")


class _TextTokens:
    def __init__(self, body: str) -> None:
        self._tokens: list[str] = []
        self._lines: list[int] = []
        for number, line in enumerate(body.splitlines(), start=HEADER_LINES + 1):
            tokens = line.split("#", 1)[0].split()
            self._tokens += tokens
            self._lines += [number] * len(tokens)
        self._next = self._read = 0

    def letter(self) -> str:
        if self._next == len(self._tokens):
            return ""
        token = self._tokens[self._next]
        self._read = self._next
        if len(token) > 1:
            self._tokens[self._next] = token[1:]  # the first argument stands behind it without a space
        else:
            self._next += 1
        return token[0]

    def word(self) -> str:
        token = self._tokens[self._next]
        self._read = self._next
        self._next += 1
        return token

    def integer(self) -> int:
        return int(self.word())

    short = integer

    def number(self) -> float:
        return float(self.word())

    def place(self) -> str:
        return f"line {self._lines[self._read]}" if self._lines else "the end"


class _BinaryTokens:
    def __init__(self, body: bytes, order: str) -> None:
        self._body, self._next = body, 0
        self._short, self._integer, self._number = (struct.Struct(order + kind) for kind in "hid")

    def _unpack(self, layout: struct.Struct) -> float:
        (value,) = layout.unpack_from(self._body, self._next)
        self._next += layout.size
        return value

    def letter(self) -> str:
        self._next += 1
        return chr(self._body[self._next - 1]) if self._next <= len(self._body) else ""

    def word(self) -> str:
        length = self.integer()
        self._next += length
        return self._body[self._next - length : self._next].decode("utf-8", "replace")

    def integer(self) -> int:
        return int(self._unpack(self._integer))

    def short(self) -> int:
        return int(self._unpack(self._short))

    def number(self) -> float:
        return self._unpack(self._number)

    def place(self) -> str:
        return f"byte {self._next} behind the header"
