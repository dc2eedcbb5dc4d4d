"""The native part: arrays of three axes, contiguous."""

import os
from collections.abc import Callable
from typing import Any

import numpy as np

class Texture:
    codec: str
    images: list[tuple[int, int, int, int]]
    maps: list[tuple[str, str]]
    levels: int
    layers: tuple[int, int]
    notes: tuple[str, str]
    memory: tuple[int, int]
    def ledger(self) -> dict[str, tuple[int, int]]: ...
    def texel(self, image: int, level: int, x: int, y: int) -> list[float]: ...
    def decode(
        self, image: int, level: int, region: tuple[int, int, int, int] | None
    ) -> tuple[np.ndarray, tuple[int, int, int]]: ...
    def blocks(self) -> list[Blocks]: ...
    def to_bytes(self) -> bytes: ...

class Blocks:
    shape: tuple[int, int]
    bits: int
    place: tuple[int, int, int]
    words: np.ndarray
    streams: bytes
    shader: str
    def program(
        self, region: tuple[int, tuple[int, int, int, int]] | None, place: tuple[int, int], max_scratch: int
    ) -> tuple[bytes, bytes, tuple[int, int], int, list[tuple[str, bool, int, int, int, tuple[int, int, int]]]]: ...

class Bank:
    images: list[tuple[str, int, int, int, int]]
    def __new__(cls, folder: str | os.PathLike[str]) -> Bank: ...
    def georeference(self, image: int) -> str: ...
    def parts(
        self, image: int, level: int, region: tuple[int, int, int, int]
    ) -> list[tuple[tuple[int, int], tuple[int, int, int], np.ndarray]]: ...

def open(data: bytes, max_texels: int | None, max_bytes: int | None) -> Texture: ...
def encode(
    images: list[np.ndarray], names: list[str], options: dict[str, Any], progress: Callable[[str, float], Any] | None
) -> bytes: ...
def psnr(one: np.ndarray, other: np.ndarray) -> float: ...
def ssim(one: np.ndarray, other: np.ndarray) -> float: ...
