"""A codec for Zarr v3: chunks of arrays are .txf files, of which only the superblocks that a selection touches are decoded.

    >>> array = zarr.create_array(
    ...     "land.zarr", shape=(3, 40000, 40000), chunks=(3, 1024, 1024), dtype="uint8",
    ...     serializer=TexfoldCodec(axes="cyx", psnr=38), compressors=(),
    ... )  # doctest: +SKIP

It is lossy. Chunks of one value come back exactly; others within the goal. zarr-python finds it by its entry point.
"""

from __future__ import annotations

import asyncio
import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np
from zarr.abc.codec import ArrayBytesCodec, ArrayBytesCodecPartialDecodeMixin

import texfold

__all__ = ["TexfoldCodec"]

NAME = "texfold"
AXES = ("yx", "yxc", "cyx")
GOALS = ("psnr", "bpp", "tolerance")


@dataclass(frozen=True)
class TexfoldCodec(ArrayBytesCodec, ArrayBytesCodecPartialDecodeMixin):
    """Chunks of ``uint8`` or ``uint16`` as textures.

    Parameters
    ----------
    axes
        The last axes of chunks: rows and columns (``yx``), with channels behind (``yxc``) or before them (``cyx``). Axes before
        these, and each of more than 4 channels, are images of their own.
    psnr, bpp, tolerance
        The goal of each chunk, one of them: at least so many dB (38 by default), so many bits a value of ``yx`` in memory, or at most
        this RMS error in any 4x4 block, in units of 1/255 of the range.
    codec, effort, metric
        As of :func:`texfold.encode`; ``dct``, ``normal`` and ``psnr`` by default.
    """

    axes: str = "yx"
    psnr: float | None = None
    bpp: float | None = None
    tolerance: float | None = None
    codec: str = "dct"
    effort: str = "normal"
    metric: str = "psnr"

    is_fixed_size = False

    def __post_init__(self) -> None:
        if self.axes not in AXES:
            raise ValueError(f"axes '{self.axes}'; give one of {', '.join(AXES)}")
        given = [name for name in GOALS if getattr(self, name) is not None]
        if len(given) > 1:
            raise ValueError(f"{' and '.join(given)}; give one goal")
        if not given:
            object.__setattr__(self, "psnr", 38.0)

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> TexfoldCodec:
        """The codec of a name and a configuration in an array's metadata."""
        if data.get("name") != NAME:
            raise ValueError(f"codec '{data.get('name')}'; its name must be '{NAME}'")
        return cls(**data.get("configuration", {}))

    def to_dict(self) -> dict[str, Any]:
        """All parameters: a chunk can be encoded to the same bytes again."""
        goal = next(name for name in GOALS if getattr(self, name) is not None)
        names = ("axes", "codec", goal, "effort", "metric")
        return {"name": NAME, "configuration": {name: getattr(self, name) for name in names}}

    def validate(self, *, shape: tuple[int, ...], dtype: Any, chunk_grid: Any) -> None:
        """Refuses arrays that have no such axes or other types of values."""
        native = dtype.to_native_dtype()
        if native.kind != "u" or native.itemsize > 2:
            raise ValueError(f"values of type {native}; the codec '{NAME}' takes uint8 and uint16")
        if len(shape) < len(self.axes):
            raise ValueError(f"{len(shape)} axes; the codec '{NAME}' with axes '{self.axes}' needs {len(self.axes)}")

    def compute_encoded_size(self, input_byte_length: int, chunk_spec: Any) -> int:
        """Not known before."""
        raise NotImplementedError

    # A chunk is seen as images (n, y, x, c), where c is 1 for each of more than 4 channels.

    def _channels(self, shape: tuple[int, ...]) -> int:
        count = {"yx": 1, "yxc": shape[-1], "cyx": shape[-3] if len(shape) > 2 else 1}[self.axes]
        return count if count <= 4 else 1

    def _images(self, chunk: np.ndarray) -> np.ndarray:
        if self.axes == "cyx":
            chunk = np.moveaxis(chunk, -3, -1)
        elif self.axes == "yx":
            chunk = chunk[..., None]
        if chunk.shape[-1] > 4:
            chunk = np.moveaxis(chunk, -1, -3)[..., None]
        return chunk.reshape(-1, *chunk.shape[-3:])

    def _encode(self, chunk: np.ndarray) -> bytes:
        goal = next(name for name in GOALS if getattr(self, name) is not None)
        options = {goal: getattr(self, goal), "codec": self.codec, "effort": self.effort, "metric": self.metric}
        return texfold.encode(list(self._images(chunk)), color="linear", alpha="band", threads=1, **options)

    def _decode(self, data: bytes, box: list[tuple[int, int]], shape: tuple[int, ...]) -> np.ndarray:
        """Values of a chunk of `shape` between the bounds of each axis."""
        texture = texfold.open(data)
        texture.check_whole()
        channels = self._channels(shape)
        apart = self.axes != "yx" and channels == 1
        letters = self.axes
        bounds = dict(zip(letters, box[len(box) - len(letters) :]))
        counts = dict(zip(letters, shape[len(shape) - len(letters) :]))
        (top, bottom), (left, right) = bounds["y"], bounds["x"]
        region = (left, top, right - left, bottom - top)
        lead, sizes = box[: len(box) - len(letters)], shape[: len(shape) - len(letters)]
        if apart:
            lead, sizes = [*lead, bounds["c"]], (*sizes, counts["c"])
        found = []
        for place in itertools.product(*(range(*bound) for bound in lead)):
            number = int(np.ravel_multi_index(place, sizes)) if place else 0
            image = texture.decode(number, region=region)
            found.append(image.reshape(bottom - top, right - left, channels))
        images = np.stack(found) if found else np.empty((0, bottom - top, right - left, channels), texture.dtype)
        images = images.reshape(*(high - low for low, high in lead), *images.shape[1:])
        if self.axes == "yx":
            return images[..., 0]
        if apart:
            images = images[..., 0]
            return images if self.axes == "cyx" else np.moveaxis(images, -3, -1)
        images = images[..., slice(*bounds["c"])]
        return np.moveaxis(images, -1, -3) if self.axes == "cyx" else images

    async def _encode_single(self, chunk_data: Any, chunk_spec: Any) -> Any:
        chunk = np.asarray(chunk_data.as_numpy_array())
        data = await asyncio.to_thread(self._encode, chunk)
        return chunk_spec.prototype.buffer.from_bytes(data)

    async def _decode_single(self, chunk_data: Any, chunk_spec: Any) -> Any:
        box = [(0, side) for side in chunk_spec.shape]
        return await self._decode_box(chunk_data, box, chunk_spec)

    async def _decode_box(self, chunk_data: Any, box: list[tuple[int, int]], chunk_spec: Any) -> Any:
        chunk = await asyncio.to_thread(self._decode, chunk_data.to_bytes(), box, chunk_spec.shape)
        wanted = chunk_spec.dtype.to_native_dtype()
        if chunk.dtype.itemsize != wanted.itemsize:
            raise texfold.LoadError(f"a chunk of {chunk.dtype} in an array of {wanted}; write it again")
        return chunk_spec.prototype.nd_buffer.from_numpy_array(chunk.astype(wanted, copy=False))

    async def _decode_partial_single(self, byte_getter: Any, selection: Any, chunk_spec: Any) -> Any:
        chunk_data = await byte_getter.get(chunk_spec.prototype)
        if chunk_data is None:
            return None
        selection = selection if isinstance(selection, tuple) else (selection,)
        box, inside = zip(*map(_bounds, selection, chunk_spec.shape)) if selection else ((), ())
        rest = chunk_spec.shape[len(box) :]
        box, inside = [*box, *((0, side) for side in rest)], (*inside, *(slice(None) for _ in rest))
        chunk = await self._decode_box(chunk_data, box, chunk_spec)
        return chunk[inside]


def _bounds(selection: Any, side: int) -> tuple[tuple[int, int], Any]:
    """Bounds of what an axis selects, and the selection within them."""
    if isinstance(selection, slice):
        first, end, step = selection.indices(side)
        if step > 0:
            end = max(first, end)
            return (first, end), slice(0, end - first, step)
    elif np.ndim(selection) == 0:
        return (int(selection), int(selection) + 1), 0
    elif np.size(selection) > 0 and np.asarray(selection).dtype.kind in "iu":
        first = int(np.min(selection))
        return (first, int(np.max(selection)) + 1), np.asarray(selection) - first
    return (0, side), selection
