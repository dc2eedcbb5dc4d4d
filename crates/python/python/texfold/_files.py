"""Parts of files, for textures and light fields."""

from __future__ import annotations

import os
from typing import NamedTuple


class Part(NamedTuple):
    """Bits of a part of a texture."""

    memory: int
    """Bits in memory, compressed."""
    disk: int
    """Bits of the file."""


def part_bits(ledger: dict[str, tuple[int, int]]) -> dict[str, Part]:
    """The parts of a ledger by their names."""
    return {name: Part(*bits) for name, bits in ledger.items()}


def bytes_of(file: str | os.PathLike[str] | bytes | bytearray | memoryview) -> bytes:
    """The bytes of a file, or those that are given."""
    if not isinstance(file, (bytes, bytearray, memoryview)):
        with open(file, "rb") as reader:
            return reader.read()
    return bytes(file)
