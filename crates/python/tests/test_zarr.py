"""Chunks of Zarr as textures: what is selected is what the whole has there, and no more than that is decoded."""

import json

import numpy as np
import pytest

import texfold

zarr = pytest.importorskip("zarr", "3.1")
from texfold.zarr import TexfoldCodec  # noqa: E402


def waves(shape, axes, dtype=np.uint8):
    """Smooth values that differ in every channel and image."""
    grid = dict(zip(axes, np.ogrid[tuple(map(slice, shape))][len(shape) - len(axes) :]))
    lead = sum(np.ogrid[tuple(map(slice, shape))][: len(shape) - len(axes)])
    values = 0.5 + 0.4 * np.sin(grid["x"] / 9 + grid.get("c", 0)) * np.cos(grid["y"] / 13 + lead)
    return (np.broadcast_to(values, shape) * np.iinfo(dtype).max).astype(dtype)


def written(store, array, axes, chunks, **options):
    codec = TexfoldCodec(axes=axes, effort="fast", **options.pop("codec", {"psnr": 44}))
    out = zarr.create_array(
        store, shape=array.shape, chunks=chunks, dtype=array.dtype, serializer=codec, compressors=(), **options
    )
    out[...] = array
    return zarr.open_array(store, mode="r+")


CASES = [
    ("yx", (64, 96), (32, 48), np.uint8),
    ("yx", (3, 64, 96), (2, 64, 48), np.uint16),
    ("yxc", (64, 96, 3), (32, 96, 3), np.uint8),
    ("yxc", (2, 40, 40, 4), (1, 40, 40, 4), np.uint16),
    ("yxc", (40, 40, 2), (40, 40, 2), np.uint8),
    ("yxc", (40, 40, 6), (40, 40, 5), np.uint8),
    ("cyx", (3, 64, 64), (3, 32, 32), np.uint16),
    ("cyx", (2, 8, 48, 48), (2, 8, 48, 24), np.uint8),
]


@pytest.mark.parametrize("axes, shape, chunks, dtype", CASES)
def test_selections_are_those_of_the_whole(axes, shape, chunks, dtype):
    array = waves(shape, axes, dtype)
    out = written({}, array, axes, chunks)
    whole = out[...]
    error = (whole.astype(float) - array) / np.iinfo(dtype).max
    # Channels beyond the array, which pad its last chunk, cost some.
    assert 10 * np.log10(1 / np.mean(error**2)) > 40
    rng = np.random.default_rng(3)
    for _ in range(6):
        ends = [np.sort(rng.integers(0, side + 1, 2)) for side in shape]
        part = tuple(slice(int(low), int(high), int(rng.integers(1, 4))) for low, high in ends)
        assert np.array_equal(out[part], whole[part])
        one = tuple(int(rng.integers(0, side)) for side in shape)
        assert out[one] == whole[one] and np.array_equal(out[one[:1]], whole[one[:1]])
        lists = tuple(np.sort(rng.choice(side, min(side, 3), False)) for side in shape)
        assert np.array_equal(out.oindex[lists], whole[np.ix_(*lists)])
        points = tuple(rng.integers(0, side, 5) for side in shape)
        assert np.array_equal(out.vindex[points], whole[points])


def test_only_what_is_selected_is_decoded(monkeypatch):
    out = written({}, waves((2, 256, 256), "yx"), "yx", (2, 256, 256))
    regions, decode = [], texfold.Texture.decode

    def counted(self, *args, **options):
        regions.append((args, options["region"]))
        return decode(self, *args, **options)

    monkeypatch.setattr(texfold.Texture, "decode", counted)
    assert out[1, 70:80, 33:200:2].shape == (10, 84)
    assert regions == [((1,), (33, 70, 167, 10))]


def test_shards_missing_chunks_and_single_values():
    array = waves((128, 128), "yx")
    array[64:, 64:] = 7
    out = written({}, array, "yx", (32, 32), shards=(64, 128), fill_value=7)
    assert np.array_equal(out[64:, 64:], array[64:, 64:]) and np.array_equal(out[40:50, 20:90], out[...][40:50, 20:90])
    out[3, 5] = 200
    assert abs(int(out[3, 5]) - 200) < 60
    assert np.abs(out[...].astype(int) - array)[32:].max() < 12


def test_metadata_have_all_parameters_and_chunks_are_the_same_again():
    stores = [{}, {}]
    for store in stores:
        written(store, waves((64, 64), "yx"), "yx", (32, 64), codec={"bpp": 2.0})
    first, second = ({key: value.to_bytes() for key, value in store.items()} for store in stores)
    assert first == second and len(first) == 3
    metadata = json.loads(first["zarr.json"])
    configuration = {"axes": "yx", "codec": "dct", "bpp": 2.0, "effort": "fast", "metric": "psnr"}
    assert metadata["codecs"] == [{"name": "texfold", "configuration": configuration}]
    assert texfold.open(first["c/0/0"]).codec == "dct"


def test_what_the_codec_does_not_take_is_named():
    for options in [{"axes": "xy"}, {"psnr": 30, "bpp": 1}]:
        with pytest.raises(ValueError, match="give one"):
            TexfoldCodec(**options)
    for dtype, axes, shape, message in [
        ("float32", "yx", (8, 8), "takes uint8"), ("int16", "yx", (8, 8), "takes uint8"), ("uint8", "cyx", (8, 8), "needs 3"),
    ]:  # fmt: skip
        with pytest.raises(ValueError, match=message):
            zarr.create_array({}, shape=shape, dtype=dtype, serializer=TexfoldCodec(axes=axes), compressors=())


def test_damaged_chunks_are_refused():
    store = {}
    out = written(store, waves((32, 32), "yx"), "yx", (32, 32))
    key = next(key for key in store if key.startswith("c"))
    store[key] = type(store[key]).from_bytes(store[key].to_bytes()[:-20])
    with pytest.raises(texfold.LoadError):
        out[...]


def test_dask_and_xarray_read_and_write(tmp_path):
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("dask.array")
    land = xarray.DataArray(waves((3, 96, 128), "cyx"), dims=("band", "y", "x"), name="land")
    encoding = {"serializer": TexfoldCodec(axes="cyx", psnr=44), "compressors": (), "chunks": (3, 32, 64)}
    land.to_dataset().chunk(band=3, y=32, x=64).to_zarr(tmp_path / "land", encoding={"land": encoding}, zarr_format=3)
    found = xarray.open_zarr(tmp_path / "land").land
    assert found.chunks is not None and abs(found.astype(float) - land).max().compute() < 16
