"""Texfold: textures whose memory grows with unique content.

    >>> import numpy, texfold
    >>> image = numpy.tile(numpy.arange(64, dtype=numpy.uint8)[:, None], (1, 96))
    >>> data = texfold.encode(image, psnr=40)
    >>> texture = texfold.open(data)
    >>> texture.shape
    (64, 96)
    >>> texture.decode(region=(8, 16, 32, 4)).shape
    (4, 32)

Images are numpy arrays of rows, columns and, unless they are gray, channels: gray, gray and alpha, RGB, RGBA; ``uint8`` or ``uint16``,
of any strides and byte order. Values are as stored: those of sRGB images stay sRGB.
"""

from __future__ import annotations

import base64
import operator
import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Union

import numpy as np

from . import _texfold
from ._errors import BankError, EncodeError, LoadError, RegionError, TexfoldError
from ._files import Part, bytes_of, part_bits

__all__ = [
    "Bank", "BankError", "BankWriter", "Camera", "Capture", "EncodeError", "LightField", "LoadError", "Part",
    "RegionError", "TexfoldError", "Texture", "decode", "encode", "encode_light", "open", "open_light", "psnr", "read_capture",
    "ssim",
]  # fmt: skip

Images = Union[np.ndarray, Sequence[np.ndarray], Mapping[str, np.ndarray]]


def _pixels(array: Any, name: str = "image") -> np.ndarray:
    """`array` with three axes, contiguous, in the machine's byte order."""
    array = np.asarray(array)
    if array.dtype.kind != "u" or array.dtype.itemsize > 2:
        raise TypeError(
            f"{name} has values of type {array.dtype}; give uint8 or uint16, of floats from 0 to 1 for instance"
            " (a * 65535 + 0.5).astype('uint16')"
        )
    if array.ndim == 2:
        array = array[:, :, None]
    if array.ndim != 3:
        raise ValueError(f"{name} has {array.ndim} axes; give rows, columns and channels")
    if not 1 <= array.shape[2] <= 4:
        raise ValueError(
            f"{name} has {array.shape[2]} channels; give 1 to 4 as the last axis, or up to 64 bands as the maps of a dict"
        )
    return np.ascontiguousarray(array, array.dtype.newbyteorder("="))


def _goal(**goals: float | None) -> tuple[str, float]:
    """Name and value of the one goal that is given."""
    given = [(name, float(value)) for name, value in goals.items() if value is not None]
    if len(given) > 1:
        raise ValueError(f"{' and '.join(name for name, _ in given)}; give one goal")
    return given[0] if given else ("psnr", 34.0)


def encode(
    images: Images,
    *,
    codec: str = "auto",
    psnr: float | None = None,
    bpp: float | None = None,
    tolerance: float | None = None,
    effort: str = "normal",
    access: str | None = None,
    metric: str | None = None,
    mips: bool = False,
    color: str = "srgb",
    alpha: str = "straight",
    progress: Callable[[str, float], Any] | None = None,
    threads: int | None = None,
) -> bytes:
    """The bytes of a ``.txf`` file. They are the same for any number of threads.

    Parameters
    ----------
    images
        An image, a sequence of images, or a dict of the maps of a material by name: ``color``, ``normal``, ``roughness``,
        ``metalness``, ``occlusion``, ``orm``, ``height``, ``emissive``, ``opacity``, or another name. Straight alpha that is opaque
        everywhere is not stored.
    codec
        ``auto``, or ``dct``, ``bc``, ``vq``, ``epitome``, ``progressive``. Materials are encoded with ``dct``.
    psnr, bpp, tolerance
        The goal, one of them: the smallest file of at least so many dB (34 by default), the best within so many bits a texel in
        memory, or the smallest whose 4x4 blocks have at most this RMS error in 8-bit units.
    effort
        ``fast``, ``normal`` or ``high``.
    access
        ``block``: fewest bits, decoded before it is drawn; ``texel``: drawn straight from the compressed form.
    metric
        The error that is minimised: ``psnr`` or ``perceptual``.
    mips
        Whether to store all mip levels.
    color
        Colour space of images: ``srgb``, ``linear`` or ``normal`` (unit vectors). That of maps follows from their names.
    alpha
        A second or fourth channel is ``straight`` alpha, or a ``band`` such as near infrared, which counts as colours do.
    progress
        Called with the name of the stage and the share of the whole that is done, 0 to 1. What it raises ends the encoding.
    threads
        Threads to encode with; one a processor by default.

    Raises
    ------
    EncodeError
        Images or settings that the codec does not take, a goal that is out of reach.
    TypeError, ValueError
        Arrays of another type or shape; options that do not exist.
    """
    goal, value = _goal(psnr=psnr, bpp=bpp, tolerance=tolerance)
    if threads is not None and threads < 1:
        raise ValueError(f"{threads} threads; give at least 1")
    if isinstance(images, Mapping):
        arrays = [_pixels(array, f"map '{name}'") for name, array in images.items()]
        names = [str(name) for name in images]
    else:
        arrays = [images] if hasattr(images, "dtype") else list(images)
        arrays = [_pixels(array, f"image {number}") for number, array in enumerate(arrays)]
        names = []
    if not arrays:
        raise ValueError("no images; give at least one")
    options = {"codec": codec, "goal": goal, "value": value, "effort": effort, "access": access, "metric": metric}
    options |= {"mips": bool(mips), "color": color, "alpha": alpha, "threads": threads}
    return _texfold.encode(arrays, names, options, progress)


class Texture:
    """An open ``.txf`` file: one image, a set, or the maps of a material. Threads may share it."""

    def __init__(self, texture: _texfold.Texture) -> None:
        self._texture = texture

    codec = property(lambda self: self._texture.codec, doc="Name of the codec.")
    levels = property(lambda self: self._texture.levels, doc="Mip levels that are stored.")
    layers = property(
        lambda self: self._texture.layers,
        doc="Layers that the bytes brought, and those of the whole file: of a prefix there are fewer.",
    )
    settings = property(lambda self: self._texture.notes[0], doc="Settings of the encoder.")
    verdict = property(lambda self: self._texture.notes[1], doc="What was modelled and what left out, in a sentence.")
    maps = property(
        lambda self: dict(self._texture.maps), doc="Kinds of the maps of a material by their names; else empty."
    )
    compressed_bits = property(lambda self: self._texture.memory[0], doc="Bits in memory, compressed.")
    resident_bits = property(lambda self: self._texture.memory[1], doc="Bits on a GPU, decoded as it is drawn.")

    @property
    def shapes(self) -> list[tuple[int, ...]]:
        """Shape of each image at level 0: rows, columns and, unless it is gray, channels."""
        return [_shape(*image[:3]) for image in self._texture.images]

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the first image at level 0."""
        return self.shapes[0]

    @property
    def dtype(self) -> np.dtype:
        """Type of the values of the first image."""
        return np.dtype(f"uint{self._texture.images[0][3]}")

    def decode(
        self,
        image: int | str = 0,
        *,
        level: int = 0,
        region: tuple[int, int, int, int] | None = None,
        out: np.ndarray | None = None,
    ) -> np.ndarray:
        """Texels of an image (a number, or the name of a map) at a mip level.

        Parameters
        ----------
        region
            First column, first row, columns and rows, in texels of the level; all of it by default. Of textures in blocks only those
            that the region touches are decoded.
        out
            Array to write to and to return; of the region's shape and the image's type.

        Raises
        ------
        RegionError
            An image, level or region that does not exist.
        """
        place = self._place(image, level)
        if region is not None:
            region = tuple(_number(value, "region") for value in region)
            if len(region) != 4:
                raise ValueError(f"a region of {len(region)} numbers; give column, row, columns and rows")
        values, shape = self._texture.decode(*place, region)
        values = values.reshape(_shape(*shape))
        if out is None:
            return values
        if out.shape != values.shape or out.dtype != values.dtype:
            raise ValueError(
                f"out has shape {out.shape} and type {out.dtype}; give one of {values.shape} and {values.dtype}"
            )
        out[...] = values
        return out

    def texel(self, x: int, y: int, image: int | str = 0, *, level: int = 0) -> tuple[float, float, float, float]:
        """Red, green, blue and alpha of a texel, 0 to 1.

        Raises
        ------
        RegionError
            A texel that does not exist.
        """
        image, level = self._place(image, level)
        x, y = _number(x, "x"), _number(y, "y")
        images, levels = self._texture.images, self.levels
        rows, columns = (max(1, side >> level) for side in images[min(image, len(images) - 1)][:2])
        if image >= len(images) or level >= levels or x >= columns or y >= rows:
            raise RegionError(
                f"no texel {x}, {y} of level {level} of image {image}; there are {len(images)} images, {levels} levels,"
                f" {columns}x{rows} texels"
            )
        return tuple(self._texture.texel(image, level, x, y))

    def ledger(self) -> dict[str, Part]:
        """Bits of each part, in memory and on disk; the latter add up to the file."""
        return part_bits(self._texture.ledger())

    def check_whole(self) -> None:
        """Refuses what was opened from a prefix of a file.

        Raises
        ------
        LoadError
            Fewer layers than the whole file has.
        """
        loaded, total = self.layers
        if loaded < total:
            raise LoadError(f"{loaded} of {total} layers; fetch the rest of the file")

    def to_bytes(self) -> bytes:
        """The whole file."""
        return self._texture.to_bytes()

    def _place(self, image: int | str, level: int) -> tuple[int, int]:
        if isinstance(image, str):
            names = list(self.maps)
            if image not in names:
                raise RegionError(f"no map '{image}'; there are {', '.join(names) or 'images without names'}")
            image = names.index(image)
        return _number(image, "image"), _number(level, "level")

    def __repr__(self) -> str:
        return f"<texfold.Texture {self.codec}, {len(self.shapes)} images, first {self.shape} {self.dtype}>"


class Bank:
    """A bank: a folder of large images in tiles, as the program's command ``bank`` writes it. Opening one reads its list alone.

    Raises
    ------
    LoadError
        A folder that holds no bank, or a damaged one.
    """

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        self._bank = _texfold.Bank(folder)

    @property
    def names(self) -> list[str]:
        """Names of the images, in the order in which they were added."""
        return [image[0] for image in self._bank.images]

    def shape(self, image: int | str = 0, *, level: int = 0) -> tuple[int, ...]:
        """Rows, columns and, unless it is gray, channels of an image at a level."""
        _, rows, columns, channels, levels = self._bank.images[self._number(image)]
        if not 0 <= level < levels:
            raise RegionError(f"level {level} of {levels}; ask for one below that number")
        return _shape(max(1, rows >> level), max(1, columns >> level), channels)

    def levels(self, image: int | str = 0) -> int:
        """Mip levels of an image."""
        return self._bank.images[self._number(image)][4]

    def georeference(self, image: int | str = 0) -> bytes | None:
        """A TIFF file of one texel with the GeoTIFF tags of an image, in pixels of level 0; none where it has none."""
        return base64.b64decode(self._bank.georeference(self._number(image))) or None

    def read(
        self, image: int | str = 0, *, level: int = 0, region: tuple[int, int, int, int] | None = None
    ) -> np.ndarray:
        """Texels of an image (a number or a name) at a mip level, from the tiles that the region touches.

        Parameters
        ----------
        region
            First column, first row, columns and rows, in texels of the level; all of it by default.

        Raises
        ------
        RegionError
            An image, level or region that does not exist.
        LoadError
            A tile that cannot be read.
        """
        number = self._number(image)
        rows, columns, *_ = self.shape(number, level=level)
        left, top, width, height = (0, 0, columns, rows) if region is None else (_number(value, "region") for value in region)
        if left + width > columns or top + height > rows or width < 1 or height < 1:
            raise RegionError(f"the region leaves the level's {columns}x{rows} texels; cut it to them")
        out = None
        for (x, y), shape, values in self._bank.parts(number, level, (left, top, width, height)):
            if out is None:
                out = np.zeros((height, width, shape[2]), values.dtype)
            out[y : y + shape[0], x : x + shape[1]] = values.reshape(shape)
        if out is None:
            raise LoadError("no tile of the image lies in the region; create the bank again")
        return out.reshape(_shape(*out.shape))

    def _number(self, image: int | str) -> int:
        names = self.names
        if isinstance(image, str):
            if image not in names:
                raise RegionError(f"no image '{image}'; there are {', '.join(names[:9]) or 'none'}")
            return names.index(image)
        if not 0 <= operator.index(image) < len(names):
            raise RegionError(f"image {image} of {len(names)}; ask for one below that number")
        return operator.index(image)

    def __repr__(self) -> str:
        return f"<texfold.Bank of {len(self.names)} images>"


def open(
    file: str | os.PathLike[str] | bytes | bytearray | memoryview,
    *,
    max_texels: int | None = None,
    max_bytes: int | None = None,
) -> Texture:
    """A texture from the path of a ``.txf`` file or its bytes. A prefix of a file that comes in layers opens, too.

    Parameters
    ----------
    max_texels, max_bytes
        Most texels of all images and levels (2**32 by default), and bytes of memory (2**33), of a file that may be hostile.

    Raises
    ------
    LoadError
        Bytes that are no such file, are damaged or need more than that.
    OSError
        A path that cannot be read.
    """
    return Texture(_texfold.open(bytes_of(file), max_texels, max_bytes))


def decode(data: bytes, **options: Any) -> np.ndarray:
    """Texels of the bytes of a ``.txf`` file; options as of :meth:`Texture.decode`.

    Raises
    ------
    LoadError
        As :func:`open`, and where the file is cut: that opens a prefix as a coarser texture.
    """
    texture = open(data)
    texture.check_whole()
    return texture.decode(**options)


def psnr(one: np.ndarray, other: np.ndarray) -> float:
    """PSNR in dB of the colours of two images of one shape, where alpha of the first, if any, is not 0."""
    return _texfold.psnr(*_pair(one, other))


def ssim(one: np.ndarray, other: np.ndarray) -> float:
    """SSIM of the colours of two images of one shape (Wang et al. 2004, windows of 11x11), mean over the channels;
    where alpha of the first is 0 they count as equal.
    """
    return _texfold.ssim(*_pair(one, other))


def _pair(one: np.ndarray, other: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    one, other = _pixels(one), _pixels(other)
    if one.shape != other.shape or one.dtype != other.dtype:
        raise ValueError(f"images of shapes {one.shape} and {other.shape}, {one.dtype} and {other.dtype}; give two alike")
    return one, other


def _shape(rows: int, columns: int, channels: int) -> tuple[int, ...]:
    return (rows, columns) if channels == 1 else (rows, columns, channels)


def _number(value: int, name: str) -> int:
    value = operator.index(value)
    if not 0 <= value < 2**32:
        raise RegionError(f"{name} {value}; give a number from 0 on")
    return value


from .light import Camera, Capture, LightField, encode_light, open_light, read_capture  # noqa: E402
from .writing import BankWriter  # noqa: E402
