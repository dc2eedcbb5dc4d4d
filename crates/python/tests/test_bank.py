"""Banks as the command `bank` writes them: regions across tiles."""

import json

import numpy as np
import pytest

import texfold


@pytest.fixture
def bank(tmp_path):
    """Two images, one of four tiles with two mip levels, and their texels."""
    y, x = np.mgrid[0:96, 0:160]
    image = np.stack([(128 + 100 * np.sin(x / 9 + y / 7 + channel)).astype(np.uint8) for channel in range(3)], -1)
    tiles, kept = [], np.zeros_like(image)
    for top, left in [(0, 0), (0, 64), (64, 0), (64, 64)]:
        part = image[top : top + 64, left : left + (64 if left == 0 else 96)]
        data = texfold.encode(part, psnr=42, mips=True, codec="dct")
        tiles.append(tile(tmp_path, len(tiles), left, top, part.shape, data))
        kept[top : top + part.shape[0], left : left + part.shape[1]] = texfold.decode(data)
    gray = image[:40, :50, 0].astype(np.uint16) * 257
    data = texfold.encode(gray, psnr=42, codec="dct")
    images = [
        entry("land", image.shape, 2, tiles, "R0VP"),
        entry("height", (*gray.shape, 1), 1, [tile(tmp_path, 4, 0, 0, gray.shape, data)], ""),
    ]
    category = {"name": None, "colours": [0.0] * 64, "tiles": 5, "file": None, "rows": 0}
    manifest = {"version": 2, "next": 5, "categories": [category], "images": images}
    (tmp_path / "bank.json").write_text(json.dumps(manifest))
    return tmp_path, kept, texfold.decode(data)


def tile(folder, number, x, y, shape, data):
    name = f"image-{number:06}.txf"
    (folder / name).write_bytes(data)
    place = {"file": name, "x": x, "y": y, "width": shape[1], "height": shape[0]}
    return place | {"category": 0, "grown_rows": 0, "own_cells": 0, "blocks": [0, 0, 0]}


def entry(name, shape, levels, tiles, georeference):
    sides = {"width": shape[1], "height": shape[0], "channels": shape[2], "levels": levels}
    return {"name": name, "key": name, "georeference": georeference, "tiles": tiles, "row": {}} | sides


def test_regions_across_tiles_are_those_of_the_whole(bank):
    folder, kept, gray = bank
    found = texfold.Bank(folder)
    assert found.names == ["land", "height"] and "2 images" in repr(found)
    assert found.shape("land") == (96, 160, 3) and found.shape(level=1) == (48, 80, 3) and found.levels() == 2
    assert found.georeference() == b"GEO" and found.georeference("height") is None
    assert np.array_equal(found.read(), kept)
    assert np.array_equal(found.read("land", region=(50, 60, 80, 20)), kept[60:80, 50:130])
    half = kept.reshape(48, 2, 80, 2, 3).mean((1, 3))
    assert np.abs(found.read(level=1) - half).max() < 12
    height = found.read("height", region=(1, 2, 3, 4))
    assert height.dtype == np.uint16 and np.array_equal(height, gray[2:6, 1:4])


def test_what_a_bank_does_not_have_is_named(bank, tmp_path_factory):
    folder, *_ = bank
    found = texfold.Bank(folder)
    wrong = [{"image": 2}, {"image": -1}, {"image": "sea"}, {"level": 2}, {"region": (150, 0, 11, 1)}, {"region": (0, 0, 0, 1)}]
    for options in wrong:
        with pytest.raises(texfold.RegionError):
            found.read(**options)
    (folder / "image-000001.txf").write_bytes(b"torn")
    assert found.read(region=(0, 0, 64, 64)).shape == (64, 64, 3)
    with pytest.raises(texfold.LoadError, match="image-000001"):
        found.read()
    with pytest.raises(texfold.LoadError, match="bank.json"):
        texfold.Bank(tmp_path_factory.mktemp("none"))
