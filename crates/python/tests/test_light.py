"""Light fields: arrays in, pictures out."""

import json

import numpy as np
import pytest

import texfold

SIDE = 48


def looking_at_origin(eye):
    """Matrix from a camera at `eye`, which looks at the origin, to the world."""
    back = eye / np.linalg.norm(eye)
    right = np.cross([0.0, 1.0, 0.0], back)
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, :4] = np.stack([right, np.cross(back, right), back, eye], 1)
    return matrix


def cameras(count, turn=0.0):
    angles = 2 * np.pi * np.arange(count) / count + turn
    eyes = [4 * np.array([np.cos(angle), 0.4 * np.sin(3 * angle), np.sin(angle)]) for angle in angles]
    return [texfold.Camera(SIDE, SIDE, 60.0, looking_at_origin(eye)) for eye in eyes]


def sphere(columns=24, rows=12):
    """Vertices and triangles of the unit sphere, counter-clockwise seen from outside."""
    down, around = np.meshgrid(np.linspace(0, np.pi, rows + 1), np.arange(columns) * 2 * np.pi / columns, indexing="ij")
    vertices = np.stack([np.sin(down) * np.cos(around), np.cos(down), np.sin(down) * np.sin(around)], -1).reshape(-1, 3)
    row, column = (axis.ravel() for axis in np.mgrid[0:rows, 0:columns])
    a, b = row * columns + column, row * columns + (column + 1) % columns
    quads = np.stack([a, b, b + columns, a + columns], 1)
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    corners = vertices[triangles]
    return vertices, triangles[np.linalg.norm(np.cross(*np.moveaxis(corners[:, 1:] - corners[:, :1], 1, 0)), axis=1) > 1e-9]


def photograph(camera):
    """A sphere with bands and a highlight, as the camera sees it."""
    y, x = np.mgrid[0:SIDE, 0:SIDE] + 0.5
    rays = np.stack([(x - SIDE / 2) / camera.focal, (SIDE / 2 - y) / camera.focal, -np.ones_like(x)], -1)
    rays = rays / np.linalg.norm(rays, axis=-1, keepdims=True) @ camera.to_world[:3, :3].T
    eye = camera.to_world[:3, 3]
    half = rays @ eye
    square = half**2 - (eye @ eye - 1)
    near = eye + (-half - np.sqrt(np.maximum(square, 0)))[..., None] * rays
    towards = -rays + np.array([0.5, 0.7, 0.5])
    towards /= np.linalg.norm(towards, axis=-1, keepdims=True)
    shine = np.maximum((near * towards).sum(-1), 0) ** 8
    colours = [0.4 + 0.2 * np.sin(4 * near[..., 0]), 0.4 + 0.2 * np.cos(5 * near[..., 1]), 0.3 + 0.1 * near[..., 2]]
    rgb = np.clip(np.stack(colours, -1) + 0.4 * shine[..., None], 0, 1)
    # The mesh lies a little inside: pixels at the rim do not show it.
    return np.dstack([rgb * 255, np.where(square > 0.03, 255, 0)]).astype(np.uint8)


def psnr(one, other):
    """Of pixels that both show."""
    both = (one[..., 3] > 0) & (other[..., 3] > 0)
    assert both.sum() > 500
    return -10 * np.log10(np.mean((one[both][:, :3].astype(float) - other[both][:, :3]) ** 2) / 255**2)


@pytest.fixture(scope="module")
def encoded():
    seen = cameras(24)
    stages = []
    data = texfold.encode_light(
        [photograph(camera) for camera in seen], seen, *sphere(), terms=2, progress=lambda *stage: stages.append(stage)
    )
    assert stages and all(0 <= share <= 1 for _, share in stages)
    return data


def test_a_light_field_shows_what_new_cameras_see(encoded):
    light = texfold.open_light(encoded)
    camera = cameras(24, turn=0.13)[5]
    wanted = photograph(camera)
    found = light.render(camera)
    assert found.shape == (SIDE, SIDE, 4) and found.dtype == np.uint8
    whole, mean = psnr(wanted, found), psnr(wanted, light.render(camera, terms=0))
    assert whole > 27 and whole > mean + 2, (whole, mean)
    # Upside down or mirrored it would be another picture.
    assert whole > psnr(wanted, found[::-1]) + 3 and whole > psnr(wanted, found[:, ::-1]) + 3


def test_what_a_light_field_is_made_of(encoded):
    light = texfold.open_light(encoded)
    vertices, triangles = sphere()
    assert light.terms == 2 and len(light.triangles) == len(triangles)
    # In an order of the codec's own.
    middles = [np.sort(of[by].mean(1) @ [1, 0.3, 0.17]) for of, by in [(light.vertices, light.triangles), (vertices, triangles)]]
    assert np.allclose(*middles, atol=1e-4)
    assert sum(part.disk for part in light.ledger().values()) == 8 * len(encoded)
    assert light.to_bytes() == encoded
    assert 0 < light.compressed_bits <= light.resident_bits
    assert "terms" in repr(light) and light.settings and light.verdict


def test_files_of_the_other_kind_are_refused(encoded):
    with pytest.raises(texfold.LoadError):
        texfold.open(encoded)
    with pytest.raises(texfold.LoadError):
        texfold.open_light(texfold.encode(np.zeros((8, 8), np.uint8)))
    with pytest.raises(texfold.LoadError):
        texfold.open_light(encoded[:100])


def test_folders_of_captures_are_read(tmp_path):
    seen = [camera._replace(centre=(25.0, 23.5)) for camera in cameras(3)]
    images = [photograph(camera) for camera in seen]
    vertices, triangles = sphere()
    # TGA of 32 bits, rows from above.
    head = bytes([0, 0, 2, *[0] * 9]) + np.array([SIDE, SIDE], "<u2").tobytes() + bytes([32, 0x28])
    frames = []
    for number, (image, camera) in enumerate(zip(images, seen)):
        (tmp_path / f"{number}.tga").write_bytes(head + image[..., [2, 1, 0, 3]].tobytes())
        frames.append({"file_path": f"{number}.tga", "transform_matrix": camera.to_world.tolist()})
    lens = {"fl_x": 60.0, "cx": 25.0, "cy": 23.5}
    (tmp_path / "transforms.json").write_text(json.dumps(lens | {"frames": frames}))
    with pytest.raises(texfold.LoadError, match=r"there is no mesh\.obj"):
        texfold.read_capture(tmp_path)
    lines = ["v {} {} {}".format(*vertex) for vertex in vertices] + ["f {} {} {}".format(*corners) for corners in triangles + 1]
    (tmp_path / "mesh.obj").write_text("\n".join(lines) + "\n")
    found = texfold.read_capture(tmp_path)
    assert all(np.array_equal(one, other) for one, other in zip(found.photographs, images)) and len(found.photographs) == 3
    assert np.allclose(found.vertices[found.triangles], vertices[triangles], atol=1e-5)
    assert texfold.encode_light(*found) == texfold.encode_light(images, seen, found.vertices, found.triangles)
    assert len(texfold.read_capture(tmp_path, most_triangles=100).triangles) <= 100
    (tmp_path / "1.tga").write_bytes(b"torn")
    with pytest.raises(texfold.LoadError, match=r"1\.tga"):
        texfold.read_capture(tmp_path)


def test_captures_that_do_not_fit_are_refused():
    seen = cameras(2)
    images = [photograph(camera) for camera in seen]
    vertices, triangles = sphere()
    for change, error in [
        ({"cameras": seen[:1]}, ValueError),
        ({"photographs": [image[:9] for image in images]}, ValueError),
        ({"photographs": [image.astype(float) for image in images]}, TypeError),
        ({"cameras": [camera._replace(focal=0.0) for camera in seen]}, ValueError),
        ({"cameras": [camera._replace(to_world=np.zeros((3, 4))) for camera in seen]}, ValueError),
        ({"vertices": vertices[:, :2]}, ValueError),
        ({"triangles": triangles - 1}, TypeError),
        ({"triangles": triangles + 1}, texfold.EncodeError),
        ({"vertices": vertices * np.nan}, texfold.EncodeError),
        ({"photographs": [], "cameras": []}, texfold.EncodeError),
        ({"terms": 1000}, texfold.EncodeError),
        ({"access": "quick"}, ValueError),
    ]:
        given = {"photographs": images, "cameras": seen, "vertices": vertices, "triangles": triangles} | change
        with pytest.raises(error):
            texfold.encode_light(**given)
