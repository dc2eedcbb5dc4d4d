"""Banks that images are added to, by this process or by the workers of a Dask cluster.

    >>> import numpy, tempfile, texfold
    >>> land = numpy.tile(numpy.arange(200, dtype=numpy.uint8), (1300, 1))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with texfold.BankWriter(folder) as bank:
    ...         bank.add("land", land, psnr=40)
    ...     texfold.Bank(folder).shape("land")
    True
    (1300, 200)
"""

from __future__ import annotations

import base64
import contextlib
import functools
import hashlib
import json
import os
import secrets
import shutil
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from . import _goal, _pixels, _texfold
from ._errors import BankError, EncodeError

#: Calls a function with each of several tuples of arguments, and gives what it returned, in their order.
Run = Callable[[Callable[..., Any], Sequence[tuple]], list]


class BankWriter:
    """A bank in a folder that images are added to; it is begun where there is none. One process at a time has it: use it in
    a ``with`` statement, or close it. An image is there whole or not at all, however the process ends; added again by block, it goes on where
    that ended.

    Raises
    ------
    BankError
        Another process adds images; a folder that cannot be written.
    LoadError
        A damaged bank.
    """

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        self._folder = os.fspath(folder)
        self._writer = _texfold.BankWriter(folder)

    def __enter__(self) -> BankWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Lets others add images."""
        self._writer.close()

    def add(
        self,
        name: str,
        image: Any,
        *,
        codec: str = "dct",
        psnr: float | None = None,
        bpp: float | None = None,
        tolerance: float | None = None,
        effort: str = "normal",
        metric: str | None = None,
        mips: bool = True,
        color: str = "srgb",
        alpha: str = "straight",
        category: str | None = None,
        georeference: bytes = b"",
        key: str | None = None,
        replace: bool = False,
    ) -> bool:
        """Adds an image, in tiles of 1024 texels a side. Its files are those of ``texfold bank add``.

        Parameters
        ----------
        name
            Its name, unlike those of others; that of a file without folder and extension.
        image
            A numpy array of rows, columns and, unless it is gray, channels; ``uint8`` or ``uint16``; at most 32768 a side. Or a Dask array: workers read and
            encode its tiles, and write them to the folder, which they must reach. The array is computed three to five times; what computes it
            must give the same each time.
        codec
            ``dct``: by block; tiles share the step with which the image as a whole meets its goal. ``progressive``: by texel; each tile meets the
            goal, with a codebook of its category that tiles share and add to, one after another: this process encodes them, one tile of a Dask
            array at a time, which is computed twice.
        psnr, bpp, tolerance, effort, metric, mips, color, alpha
            As of :func:`texfold.encode`.
        category
            Category that all of its tiles join; by their colours without one.
        georeference
            A TIFF file of one texel with GeoTIFF tags, as :meth:`Bank.georeference` gives it.
        key
            Text that says what the image and the settings are; the same name and key again is no work, or goes on where the process that
            added it has ended (what is done lies in a folder ``.texfold-job-…`` of the bank until the image is whole). By default a hash of the
            values and settings, of a Dask array of its name, which is to be the same in both processes.
        replace
            Whether it takes the place of an image of its name with another key.

        Returns
        -------
        bool
            False where it was there already.

        Raises
        ------
        BankError
            An image of that name is there; a name that is none; a side that is too long; a folder that cannot be written.
        EncodeError
            Images or settings that the codec does not take.
        FileNotFoundError
            Workers that write to another folder of that path.
        """
        goal, value = _goal(psnr=psnr, bpp=bpp, tolerance=tolerance)
        if codec not in ("dct", "progressive"):
            raise ValueError(f"codec {codec!r}; give one of dct, progressive")
        options = {"codec": codec, "goal": goal, "value": value, "effort": effort, "access": None, "metric": metric}
        options |= {"mips": bool(mips), "color": color, "alpha": alpha, "threads": None}
        image = image if _is_dask(image) else np.asarray(image)
        tiles, run = _tiles(image)
        if key is None:
            key = _key(image, options, category, georeference)
        new = (name, key, category, base64.b64encode(georeference).decode(), bool(replace))
        if not self._writer.is_new(new):
            return False
        if codec == "progressive":
            rows, columns = image.shape[:2]
            self._writer.add_texels(new, (columns, rows), functools.partial(_around, image), options)
            return True
        with _Job(self._folder, name, repr((key, image.shape, str(image.dtype), sorted(options.items(), key=str)))) as job:
            arrays = [array for _, array in tiles]
            colours, peak, found = job.kept(lambda: _step(arrays, options, run, job))
            first, categories = self._writer.categories(new, colours)
            # The search has made them, unless no step meets the goal.
            made = job.made(arrays, options, peak, tuple(found), run)
            for number in range(len(tiles)):
                os.replace(job.tile(number, tuple(found)), os.path.join(self._folder, _texfold.tile_name(first + number)))
            places = [(*place, category) for (place, _), category in zip(tiles, categories)]
            rows, columns = image.shape[:2]
            self._writer.list(new, (columns, rows), first, list(zip(places, [sums for sums, _ in made])), found[1])
        return True


class _Job:
    """Step and tiles at each step of an image that is being added: a folder in that of the bank, from which the same image goes on
    where a process has ended. One of another key, shape or goal is begun anew.
    """

    def __init__(self, folder: str, name: str, key: str) -> None:
        digest = lambda text: hashlib.blake2b(text.encode(), digest_size=12).hexdigest()  # noqa: E731
        of_name = f".texfold-job-{digest(name)}-"
        self._folder = os.path.join(folder, of_name + digest(key))
        for entry in os.scandir(folder):
            if entry.name.startswith(of_name) and entry.path != self._folder:
                shutil.rmtree(entry.path, ignore_errors=True)
        os.makedirs(self._folder, exist_ok=True)

    def kept(self, find: Callable[[], Any]) -> Any:
        """Result of `find`, kept from before where there is one."""
        path = os.path.join(self._folder, "step.json")
        with contextlib.suppress(OSError, ValueError), open(path, encoding="utf-8") as file:
            return json.load(file)
        found = find()
        _write_whole(path, json.dumps(found).encode())
        return found

    def made(self, arrays: list, options: dict, peak: float, found: tuple[int, bool], run: Run) -> list[tuple[_texfold.TileSums, tuple]]:
        """Sums and errors of all tiles at a step; those that are not there are made."""
        paths = [self.tile(number, found) for number in range(len(arrays))]
        run(_write, [(array, options, peak, found, path) for array, path in zip(arrays, paths) if _figures(path) is None])
        made = [_figures(path) for path in paths]
        if None in made:
            missing = paths[made.index(None)]
            raise FileNotFoundError(f"{missing}: a worker has written this tile, and it is not here; workers must reach the bank's folder")
        return made

    def tile(self, number: int, found: tuple[int, bool]) -> str:
        """Path of the file of a tile at a step, which meets the goal or does not."""
        step, is_met = found
        return os.path.join(self._folder, f"{number}-{step}{'' if is_met else '-missed'}.txf")

    def __enter__(self) -> _Job:
        return self

    def __exit__(self, kind: type | None, *_: object) -> None:
        # A refusal would come again.
        if kind is None or issubclass(kind, (BankError, EncodeError)) or not os.listdir(self._folder):
            shutil.rmtree(self._folder, ignore_errors=True)


def _sums_of(path: str) -> str:
    return path.removesuffix(".txf") + ".sums"


def _figures(path: str) -> tuple[_texfold.TileSums, tuple] | None:
    """Sums and errors of a tile that is written; else none."""
    with contextlib.suppress(OSError, ValueError), open(_sums_of(path), encoding="utf-8") as file:
        sums, errors = json.load(file)
        return (_texfold.TileSums(sums), tuple(errors)) if os.path.exists(path) else None
    return None


def _is_dask(image: Any) -> bool:
    return type(image).__module__.partition(".")[0] == "dask"


def _tiles(image: Any) -> tuple[list[tuple[tuple[int, int, int, int], Any]], Run]:
    """Places and arrays of the tiles of an image, and what runs functions of them."""
    is_dask = _is_dask(image)
    if any(side != side for side in image.shape):
        raise ValueError("an array of unknown shape; compute its chunk sizes")
    # Of a Dask array type and shape alone.
    _pixels(np.empty((0,) * min(image.ndim, 2) + image.shape[2:], image.dtype) if is_dask else image)
    if min(image.shape) < 1:
        raise ValueError(f"an image of shape {image.shape}; give at least one texel")
    rows, columns = (_texfold.tile_cuts(length) for length in image.shape[:2])
    places = [(x, y, width, height) for y, height in rows for x, width in columns]
    if not is_dask:
        cut = lambda x, y, width, height: image[y : y + height, x : x + width]  # noqa: E731
        return [(place, cut(*place)) for place in places], lambda work, calls: [work(*call) for call in calls]
    from dask import compute, delayed

    chunks = (tuple(count for _, count in rows), tuple(count for _, count in columns), *((side,) for side in image.shape[2:]))
    blocks = image.rechunk(chunks).to_delayed().ravel()
    return list(zip(places, blocks)), lambda work, calls: list(compute(*(delayed(work)(*call) for call in calls)))


def _around(image: Any, x: int, y: int, width: int, height: int, more: int) -> np.ndarray:
    """Texels of a rectangle of an image, and so many more on each side; beyond the image those of its edge."""
    rows, columns = image.shape[:2]
    top, left = max(y - more, 0), max(x - more, 0)
    part = _pixels(image[top : y + height + more, left : x + width + more])
    beyond = ((top - y + more, max(y + height + more - rows, 0)), (left - x + more, max(x + width + more - columns, 0)), (0, 0))
    return np.pad(part, beyond, mode="edge")


def _key(image: Any, options: dict, category: str | None, georeference: bytes) -> str:
    hasher = hashlib.blake2b(repr((sorted(options.items(), key=str), category, georeference)).encode(), digest_size=32)
    if isinstance(image, np.ndarray):
        hasher.update(repr((image.shape, image.dtype.str)).encode())
        for row in image:
            hasher.update(np.ascontiguousarray(row))
    else:
        hasher.update(str(image.name).encode())
    return hasher.hexdigest()


def _step(arrays: list, options: dict, run: Run, job: _Job) -> tuple[list, float, tuple[int, bool]]:
    """Colours of each tile, the peak of all, and the step at which they meet the goal, and whether they do."""
    stride = _texfold.tile_stride(len(arrays))
    color, alpha = options["color"], options["alpha"]
    seen = run(_seen, [(array, color, alpha, number % stride == 0) for number, array in enumerate(arrays)])
    peak = max(peak for _, peak, _ in seen)
    samples = [sample for _, _, sample in seen if sample is not None]
    errors = lambda step: [errors for _, errors in job.made(arrays, options, peak, (step, True), run)]  # noqa: E731
    return [colours for colours, _, _ in seen], peak, _texfold.tile_step(samples, options, peak, errors)


def _seen(tile: np.ndarray, color: str, alpha: str, is_sampled: bool) -> tuple[list[float], float, np.ndarray | None]:
    pixels = _pixels(tile)
    rows, columns = (_texfold.tile_sampled(length) for length in pixels.shape[:2])
    sample = pixels[np.ix_(rows, columns)] if is_sampled else None
    return *_texfold.tile_seen(pixels, color, alpha), sample


def _write(tile: np.ndarray, options: dict, peak: float, found: tuple[int, bool], path: str) -> None:
    data, sums, errors = _texfold.tile_bytes(_pixels(tile), options, peak, found)
    _write_whole(path, data)
    # Last: where they are, the tile is.
    _write_whole(_sums_of(path), json.dumps((sums.text(), errors)).encode())


def _write_whole(path: str, data: bytes) -> None:
    """Whole or not at all; a worker that is killed leaves a file of another name."""
    folder, name = os.path.split(path)
    part = os.path.join(folder, f".texfold-tmp-{os.getpid()}-{secrets.token_hex(8)}-{name}")
    try:
        with open(part, "xb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(part, path)
    except BaseException:
        if os.path.exists(part):
            os.unlink(part)
        raise
