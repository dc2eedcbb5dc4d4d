"""Light fields: an object as photographs show it, drawn from any side."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Union

import numpy as np

from . import _texfold
from ._files import bytes_of, part_bits


class Camera(NamedTuple):
    """A pinhole camera; undistort photographs of other lenses first (``cv2.undistort``)."""

    width: int
    """Columns of the image."""
    height: int
    """Rows of the image."""
    focal: Union[float, Sequence[float]]
    """Focal length in pixels, or those across and down."""
    to_world: Any
    """Matrix of 4x4 from the camera's space to the mesh's, a rigid motion. The camera looks along -z, y up, as in OpenGL, NeRF and
    nerfstudio; of OpenCV's and COLMAP's matrices the second and third column change their sign."""
    centre: Union[Sequence[float], None] = None
    """Point where the axis meets the image, in pixels from the upper left corner; the middle by default."""

    def _eye(self) -> _texfold.Eye:
        focal = np.broadcast_to(np.asarray(self.focal, np.float32), (2,))
        centre = np.asarray((self.width / 2, self.height / 2) if self.centre is None else self.centre, np.float32)
        matrix = np.asarray(self.to_world, np.float32)
        if matrix.shape != (4, 4) or centre.shape != (2,):
            raise ValueError(f"a matrix of shape {matrix.shape} and a centre of {centre.shape}; give (4, 4) and (2,)")
        return (int(self.width), int(self.height)), focal.tolist(), centre.tolist(), matrix.ravel().tolist()


class Capture(NamedTuple):
    """Photographs of an object, their cameras, and its mesh: the arguments of :func:`encode_light`."""

    photographs: list[np.ndarray]
    """``uint8`` arrays of rows, columns and RGBA."""
    cameras: list[Camera]
    """One for each photograph, in the space of the mesh."""
    vertices: np.ndarray
    """Coordinates, of shape (n, 3)."""
    triangles: np.ndarray
    """Numbers of vertices, of shape (m, 3)."""


def read_capture(
    folder: str | os.PathLike[str],
    *,
    mesh: str | os.PathLike[str] | None = None,
    most_triangles: int | None = None,
) -> Capture:
    """A folder of photographs, cameras and a mesh: a model of COLMAP (text or binary), ``transforms.json`` (NeRF, nerfstudio, instant-ngp), a scene
    of OpenMVS, Metashape's XML or Middlebury's ``_par.txt``, found by its files. Photographs (PNG, JPEG, TIFF, BMP, TGA, PNM) of lenses that distort
    are undistorted.

        data = texfold.encode_light(*texfold.read_capture("garden", most_triangles=20_000))

    Parameters
    ----------
    mesh
        OBJ, PLY, glTF or GLB in the cameras' space; by default that of the folder.
    most_triangles
        The mesh simplified to at most so many.

    Raises
    ------
    LoadError
        Files that are missing, damaged or do not fit one another; the message names the file and says what to do.
    """
    views, vertices, triangles = _texfold.read_capture(folder, mesh, most_triangles)
    cameras = [
        Camera(*size, tuple(focal), np.array(matrix, np.float32).reshape(4, 4), tuple(centre))
        for _, (size, focal, centre, matrix) in views
    ]
    pixels = zip(views, cameras)
    photographs = [np.frombuffer(data, np.uint8).reshape(camera.height, camera.width, 4) for (data, _), camera in pixels]
    return Capture(
        photographs, cameras, np.array(vertices, np.float32).reshape(-1, 3), np.array(triangles, np.uint32).reshape(-1, 3)
    )


def encode_light(
    photographs: Sequence[np.ndarray],
    cameras: Sequence[Camera],
    vertices: np.ndarray,
    triangles: np.ndarray,
    *,
    terms: int = 1,
    psnr: float | None = None,
    access: str = "block",
    progress: Callable[[str, float], Any] | None = None,
    threads: int | None = None,
) -> bytes:
    """The bytes of a ``.txf`` file with a light field on a mesh, the same for any number of threads.

    Parameters
    ----------
    photographs
        ``uint8`` arrays of rows, columns and RGB or RGBA. Pixels with alpha 0 do not show the object: mask what the mesh does not cover.
    cameras
        One for each photograph, in the space of the mesh.
    vertices, triangles
        Floats of shape (n, 3), and numbers of vertices of shape (m, 3), counter-clockwise seen from outside.
    terms
        Terms beside the mean of all directions, 0 to 8: more show sharper highlights.
    psnr
        As few of these terms as reach so many dB against the photographs.
    access
        ``block``: fewest bits, decoded before it is drawn; ``texel``: drawn straight from the compressed form.
    progress, threads
        As of :func:`texfold.encode`.

    Raises
    ------
    EncodeError
        A capture or settings that the codec does not take: no photograph, a mesh without triangles.
    TypeError, ValueError
        Arrays of another type or shape; cameras that do not fit.
    """
    if len(photographs) != len(cameras):
        raise ValueError(f"{len(photographs)} photographs and {len(cameras)} cameras; give one for each")
    if threads is not None and threads < 1:
        raise ValueError(f"{threads} threads; give at least 1")
    views = []
    for number, (image, camera) in enumerate(zip(photographs, cameras)):
        image = np.asarray(image)
        if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] not in (3, 4):
            raise TypeError(f"photograph {number} is {image.dtype} of shape {image.shape}; give uint8 in RGB or RGBA")
        if image.shape[:2] != (camera.height, camera.width):
            raise ValueError(f"photograph {number} has {image.shape[:2]} rows and columns, its camera {camera[1::-1]}")
        if image.shape[2] == 3:
            image = np.dstack([image, np.full(image.shape[:2], 255, np.uint8)])
        views.append((np.ascontiguousarray(image), camera._eye()))
    mesh = _rows(vertices, np.float32, "vertices"), _rows(triangles, np.uint32, "triangles")
    options = {"terms": terms, "psnr": psnr, "access": access, "threads": threads}
    return _texfold.encode_light(views, mesh, options, progress)


def _rows(array: Any, dtype: Any, name: str) -> np.ndarray:
    array = np.asarray(array)
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"{name} of shape {array.shape}; give (n, 3)")
    if dtype == np.uint32 and (array.dtype.kind not in "iu" or (array.size and array.min() < 0)):
        raise TypeError(f"{name} that are not whole numbers from 0 on")
    return np.ascontiguousarray(array, dtype)


class LightField:
    """An open light field. Threads may share it."""

    def __init__(self, light: _texfold.LightField) -> None:
        self._light = light

    terms = property(lambda self: self._light.terms[0], doc="Terms beside the mean that the bytes brought.")
    settings = property(lambda self: self._light.notes[0], doc="Settings of the encoder.")
    verdict = property(lambda self: self._light.notes[1], doc="What was modelled and what left out, in a sentence.")
    compressed_bits = property(lambda self: self._light.memory[0], doc="Bits in memory, compressed.")
    resident_bits = property(lambda self: self._light.memory[1], doc="Bits on a GPU, decoded as it is drawn.")
    vertices = property(lambda self: self._light.mesh()[0].reshape(-1, 3), doc="Coordinates, of shape (n, 3).")
    triangles = property(lambda self: self._light.mesh()[1].reshape(-1, 3), doc="Numbers of vertices, of shape (m, 3).")

    def render(self, camera: Camera, *, terms: int | None = None) -> np.ndarray:
        """The picture of a camera, drawn by the CPU: ``uint8`` of rows, columns and RGBA, alpha 0 where it sees no mesh.

        Parameters
        ----------
        terms
            Most terms beside the mean to draw with; all by default.
        """
        return self._light.render(camera._eye(), terms).reshape(camera.height, camera.width, 4)

    def ledger(self) -> dict[str, Any]:
        """Bits of each part, in memory and on disk; the latter add up to the file."""
        return part_bits(self._light.ledger())

    def to_bytes(self) -> bytes:
        """The whole file."""
        return self._light.to_bytes()

    def __repr__(self) -> str:
        return f"<texfold.LightField of {self.terms} terms on {len(self.triangles)} triangles>"


def open_light(
    file: str | os.PathLike[str] | bytes | bytearray | memoryview,
    *,
    max_texels: int | None = None,
    max_bytes: int | None = None,
) -> LightField:
    """A light field from the path of a ``.txf`` file or its bytes; limits and errors as of :func:`texfold.open`."""
    return LightField(_texfold.open_light(bytes_of(file), max_texels, max_bytes))
