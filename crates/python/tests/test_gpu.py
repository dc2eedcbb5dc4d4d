"""Textures decoded by a GPU, or by software Vulkan, through wgpu-py: equal to the CPU, bit by bit."""

import numpy as np
import pytest

import texfold

wgpu = pytest.importorskip("wgpu")
from texfold import gpu  # noqa: E402


@pytest.fixture(scope="module")
def device():
    adapters = wgpu.gpu.enumerate_adapters_sync()
    if not adapters:
        pytest.skip("no adapter")
    return adapters[0].request_device_sync()


@pytest.fixture(scope="module")
def decoder(device):
    return gpu.Decoder(device)


def land(rows, columns, channels, dtype=np.uint8):
    y, x, c = np.ogrid[:rows, :columns, :channels]
    values = 0.5 + 0.3 * np.sin(x / 7 + c) * np.cos(y / 11) + 0.2 * np.sin((x * y) % 97)
    return (np.clip(values, 0, 1) * np.iinfo(dtype).max).astype(dtype)


def read(device, target, level, dtype):
    columns, rows = (max(1, side >> level) for side in target.size[:2])
    texel = 4 * np.dtype(dtype).itemsize
    stride = -(-columns * texel // 256) * 256
    data = device.queue.read_texture(
        {"texture": target, "mip_level": level, "origin": (0, 0, 0)},
        {"bytes_per_row": stride, "rows_per_image": rows},
        (columns, rows, 1),
    )
    lines = np.frombuffer(data, np.uint8).reshape(rows, -1)[:, : columns * texel]
    return np.ascontiguousarray(lines).view(dtype).reshape(rows, columns, 4)


@pytest.mark.parametrize("channels, dtype", [(1, np.uint8), (3, np.uint8), (4, np.uint8), (3, np.uint16)])
def test_levels_equal_those_of_the_cpu(device, decoder, channels, dtype):
    data = texfold.encode(land(117, 203, channels, dtype), codec="dct", bpp=2.0, effort="fast", mips=True)
    texture = texfold.open(data)
    target = decoder.decode(texture)
    assert target.mip_level_count == texture.levels > 4
    for level in range(texture.levels):
        wanted = texture.decode(level=level)
        wanted = wanted[:, :, None] if wanted.ndim == 2 else wanted
        found = read(device, target, level, dtype)
        assert np.array_equal(found[:, :, : wanted.shape[2]], wanted), level
        if channels < 4:
            assert (found[:, :, 3] == np.iinfo(dtype).max).all()


def test_maps_of_a_material_and_regions(device, decoder):
    maps = {"color": land(96, 64, 3), "roughness": land(48, 32, 1)[:, :, 0]}
    texture = texfold.open(texfold.encode(maps, psnr=38, effort="fast"))
    for name, array in maps.items():
        target = decoder.decode(texture, name)
        assert target.size[:2] == (array.shape[1], array.shape[0])
        found = read(device, target, 0, np.uint8)
        assert np.array_equal(found[:, :, 0], texture.decode(name).reshape(*array.shape[:2], -1)[:, :, 0])

    (stage,) = gpu.blocks(texture, "color")
    usage = wgpu.TextureUsage.STORAGE_BINDING | wgpu.TextureUsage.COPY_SRC
    target = device.create_texture(size=(40, 24, 1), format="rgba8unorm", usage=usage)
    decoder.run(stage, stage.program(region=(10, 20, 30, 16), place=(5, 7)), target)
    found = read(device, target, 0, np.uint8)
    assert np.array_equal(found[7:23, 5:35, :3], texture.decode("color", region=(10, 20, 30, 16)))
    assert (found[:7] == 0).all() and (found[:, :5] == 0).all() and (found[23:] == 0).all()


def test_what_cannot_be_decoded_is_refused(decoder):
    texture = texfold.open(texfold.encode(land(32, 32, 3), codec="bc", bpp=4.0))
    with pytest.raises(ValueError, match="codec bc has no blocks"):
        decoder.decode(texture)
    texture = texfold.open(texfold.encode(land(32, 32, 3), codec="dct", bpp=2.0))
    with pytest.raises(texfold.RegionError):
        gpu.blocks(texture)[0].program(region=(0, 0, 33, 1))
    with pytest.raises(texfold.RegionError):
        gpu.blocks(texture)[0].program(region=(0, 0, 8, 8), level=7)
    with pytest.raises(texfold.RegionError):
        decoder.decode(texture, 1)
