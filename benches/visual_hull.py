"""A capture of a photographed object from calibrated photographs before a dark background: its visual hull as a mesh.

    pip install numpy pillow scipy scikit-image
    python benches/visual_hull.py DINO_SPARSE_RING OUT

reads *_par.txt as Middlebury's multi-view sets have it (https://vision.middlebury.edu/mview/data) and writes OUT/mesh.obj,
OUT/images, transforms.json and, of every fifth photograph, transforms_test.json.
"""

import json
import pathlib
import sys

import numpy
from PIL import Image
from scipy import ndimage
from skimage import measure

SIDE = 160
BACKGROUND = 0.19


def silhouette(image):
    """Pixels of the object: threshold, dilation and erosion as the set's notes have them, holes filled."""
    mask = (image.max(axis=2) / 255 > BACKGROUND)
    mask = ndimage.binary_dilation(mask, iterations=10)
    return ndimage.binary_fill_holes(ndimage.binary_erosion(mask, iterations=7))


def main(folder, out):
    (out / "images").mkdir(parents=True, exist_ok=True)
    [table] = folder.glob("*_par.txt")
    good = [name for listed in folder.glob("*_good_silhouette_images.txt") for name in listed.read_text().split()]
    bounds = numpy.array([[-0.061897, -0.018874, -0.057845], [0.010897, 0.068227, 0.015495]])
    margin = 0.02 * (bounds[1] - bounds[0])
    axes = [numpy.linspace(low, high, SIDE) for low, high in zip(bounds[0] - margin, bounds[1] + margin)]
    grid = numpy.stack(numpy.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    inside = numpy.ones(len(grid), bool)
    frames = []
    for line in table.read_text().splitlines()[1:]:
        name, *numbers = line.split()
        numbers = numpy.array(numbers, float)
        camera, turn, shift = numbers[:9].reshape(3, 3), numbers[9:18].reshape(3, 3), numbers[18:]
        image = numpy.array(Image.open(folder / name).convert("RGB"))
        mask = silhouette(image)
        if not good or name in good:
            seen = (grid @ turn.T + shift) @ camera.T
            x, y = numpy.rint(seen[:, :2] / seen[:, 2:]).astype(int).T
            height, width = mask.shape
            # What lies beyond a photograph is not known to be outside of the object.
            known = (x >= 0) & (x < width) & (y >= 0) & (y < height)
            inside[known] &= mask[y[known], x[known]]
        alpha = numpy.where(mask, 255, 0).astype(numpy.uint8)
        Image.fromarray(numpy.dstack([image, alpha])).save(out / "images" / name)
        # From the world to a camera that looks along -z with y up.
        pose = numpy.eye(4)
        pose[:3, :3] = (numpy.diag([1, -1, -1]) @ turn).T
        pose[:3, 3] = -turn.T @ shift
        frames.append({
            "file_path": f"images/{name}",
            "transform_matrix": pose.tolist(),
            "w": image.shape[1], "h": image.shape[0],
            "fl_x": camera[0, 0], "fl_y": camera[1, 1], "cx": camera[0, 2] + 0.5, "cy": camera[1, 2] + 0.5,
        })
    volume = ndimage.gaussian_filter(inside.reshape(SIDE, SIDE, SIDE).astype(float), 1.0)
    steps = [axis[1] - axis[0] for axis in axes]
    vertices, triangles, _, _ = measure.marching_cubes(volume, 0.5, spacing=steps)
    vertices += [axis[0] for axis in axes]
    lines = [f"v {x:.7f} {y:.7f} {z:.7f}" for x, y, z in vertices]
    # Counter-clockwise as seen from outside.
    lines += [f"f {a + 1} {c + 1} {b + 1}" for a, b, c in triangles]
    (out / "mesh.obj").write_text("\n".join(lines) + "\n")
    for name, chosen in [("transforms.json", lambda n: n % 5 != 2), ("transforms_test.json", lambda n: n % 5 == 2)]:
        kept = [frame for number, frame in enumerate(frames) if chosen(number)]
        (out / name).write_text(json.dumps({"frames": kept}, indent=1))
    print(f"{len(vertices)} vertices, {len(triangles)} triangles, {len(frames)} photographs")


main(pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2]))
