"""Arrays in and out, by every way that users have; what files and codecs do is tested in Rust."""

import os
import pathlib
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

import texfold

FIXTURES = pathlib.Path(__file__).parents[3] / "fixtures"


def waves(rows, columns, channels, dtype=np.uint8):
    """Smooth colours and alpha that differ in every channel."""
    y, x = np.mgrid[0:rows, 0:columns]
    values = [0.5 + 0.4 * np.sin(x / (7 + 3 * channel) + y / 11) for channel in range(channels)]
    return (np.stack(values, -1) * np.iinfo(dtype).max).astype(dtype)


def noise(side):
    return np.random.default_rng(1).integers(0, 256, (side, side, 3), np.uint8)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_arrays_come_back(channels, dtype):
    image = waves(45, 70, channels, dtype)
    texture = texfold.open(texfold.encode(image, psnr=45, effort="fast"))
    found = texture.decode()
    assert texture.dtype == found.dtype == dtype
    assert found.shape == texture.shape == ((45, 70) if channels == 1 else image.shape)
    assert texfold.psnr(image, found) > 44.9
    assert 0.99 < texfold.ssim(image, found) <= 1
    # Alpha is no colour, and is not what PSNR counts.
    assert np.abs(found.reshape(image.shape) - image.astype(float)).max() < 0.05 * np.iinfo(dtype).max
    one = np.iinfo(dtype).max
    texel = np.atleast_1d(found[7, 30]) / one
    wanted = {1: [texel[0]] * 3 + [1], 2: [texel[0]] * 3 + [texel[-1]], 3: [*texel, 1], 4: texel}[channels]
    assert texture.texel(30, 7) == pytest.approx(wanted, abs=1e-4)


def test_strides_byte_order_and_read_only_do_not_matter():
    image = waves(32, 48, 3, np.uint16)
    wanted = texfold.encode(image, psnr=40)
    flipped = image[::-1, ::-1].copy()[::-1, ::-1]
    assert flipped.strides[0] < 0 and texfold.encode(flipped, psnr=40) == wanted
    assert texfold.encode(np.asfortranarray(image), psnr=40) == wanted
    assert texfold.encode(image.astype(">u2"), psnr=40) == wanted
    image.flags.writeable = False
    assert texfold.encode(image, psnr=40) == wanted
    assert texfold.encode(image[:, :, 0], psnr=40) == texfold.encode(image[:, :, :1], psnr=40)


def test_regions_levels_and_out():
    image = waves(100, 130, 3)
    texture = texfold.open(texfold.encode(image, psnr=40, mips=True, effort="fast"))
    whole = texture.decode()
    assert np.array_equal(texture.decode(region=(33, 5, 60, 90)), whole[5:95, 33:93])
    assert texture.decode(region=(3, 4, 0, 7)).shape == (7, 0, 3)
    assert texture.levels == 8
    half = texture.decode(level=1)
    assert half.shape == (50, 65, 3)
    means = whole.reshape(50, 2, 65, 2, 3).mean((1, 3))
    assert np.abs(half - means).max() < 8
    room = np.zeros((200, 130, 3), np.uint8)
    assert texture.decode(out=room[::2]) is not None
    assert np.array_equal(room[::2], whole) and not room[1::2].any()
    for out in [np.zeros((99, 130, 3), np.uint8), np.zeros((100, 130, 3), np.uint16)]:
        with pytest.raises(ValueError, match="give one of"):
            texture.decode(out=out)


def test_places_that_do_not_exist_are_named():
    texture = texfold.open(texfold.encode(waves(20, 30, 3), psnr=30))
    for options in [{"image": 1}, {"image": -1}, {"level": 1}, {"image": "color"}, {"region": (0, 0, 31, 1)}]:
        with pytest.raises(texfold.RegionError):
            texture.decode(**options)
    with pytest.raises(ValueError, match="3 numbers"):
        texture.decode(region=(0, 0, 3))
    with pytest.raises(IndexError, match="30x20"):
        texture.texel(30, 0)
    with pytest.raises(IndexError):
        texture.texel(-1, 0)


def test_sets_and_materials():
    images = [waves(40, 40, 3), waves(30, 50, 3)]
    texture = texfold.open(texfold.encode(images, psnr=36))
    assert texture.shapes == [(40, 40, 3), (30, 50, 3)]
    assert texfold.psnr(images[1], texture.decode(1)) > 33
    maps = {"color": waves(64, 64, 3), "roughness": waves(32, 32, 1)[:, :, 0], "height": waves(64, 64, 1, np.uint16)}
    texture = texfold.open(texfold.encode(maps, psnr=38))
    assert texture.maps == {"color": "color", "roughness": "roughness", "height": "height"}
    assert texture.decode("roughness").shape == (32, 32)
    assert texture.decode("height").dtype == np.uint16
    assert texfold.psnr(maps["color"], texture.decode("color")) > 33


def test_what_a_texture_is_said_to_be():
    data = texfold.encode(waves(64, 64, 3), bpp=2.0, codec="dct")
    texture = texfold.open(data)
    assert texture.codec == "dct" and texture.layers == (2, 2)
    assert "--bpp 2" in texture.settings and texture.verdict.endswith(".")
    ledger = texture.ledger()
    assert sum(part.disk for part in ledger.values()) == 8 * len(data)
    assert sum(part.memory for part in ledger.values()) == texture.compressed_bits < texture.resident_bits
    assert texture.to_bytes() == data and "dct" in repr(texture)


def test_files_by_path_and_as_bytes(tmp_path):
    golden = FIXTURES / "golden" / "dct.txf"
    texture = texfold.open(golden)
    assert np.array_equal(texture.decode(), texfold.decode(golden.read_bytes()))
    assert np.array_equal(texture.decode(), texfold.open(str(golden)).decode())
    with pytest.raises(FileNotFoundError):
        texfold.open(tmp_path / "none.txf")


def test_bytes_that_are_no_file_are_refused():
    data = bytearray(texfold.encode(waves(64, 64, 3), psnr=36))
    for bad in [b"", b"PNG", bytes(data[:40]), bytes(data[:-9] + b"x" * 9)]:
        try:
            # A prefix with the first layer is a texture, a coarser one.
            assert texfold.open(bad).layers == (1, 2)
        except texfold.LoadError:
            pass
    with pytest.raises(texfold.LoadError, match="not a .txf file"):
        texfold.open(b"no such file, and of some length")
    with pytest.raises(texfold.LoadError, match="raise the limit"):
        texfold.open(bytes(data), max_texels=100)
    with pytest.raises(ValueError):
        texfold.open(bytes(data), max_bytes=100)


def test_a_prefix_opens_as_a_coarser_texture_and_is_not_decoded_for_the_whole():
    data = texfold.encode(waves(64, 64, 3), psnr=40)
    texture = texfold.open(data[:-20])
    assert texture.layers == (1, 2) and texture.decode().shape == (64, 64, 3)
    with pytest.raises(texfold.LoadError, match="1 of 2 layers"):
        texfold.decode(data[:-20])


def test_bands_are_channels_that_stay():
    image = np.full((32, 32, 4), 255, np.uint8)
    image[:, :, :3] = waves(32, 32, 3)
    assert texfold.open(texfold.encode(image, psnr=40)).shape == (32, 32, 3)
    texture = texfold.open(texfold.encode(image, psnr=40, alpha="band"))
    assert texture.shape == (32, 32, 4) and (texture.decode()[..., 3] > 250).all()
    assert texfold.open(texfold.encode(image[..., :3], psnr=40, alpha="band")).shape == (32, 32, 3)


def test_arrays_that_are_no_images_are_refused():
    for array in [np.zeros((4, 4)), np.zeros((4, 4), bool), np.zeros((4, 4), np.int32), np.full((4, 4), np.nan)]:
        with pytest.raises(TypeError, match="give uint8 or uint16"):
            texfold.encode(array)
    for shape in [(4,), (4, 4, 5), (4, 4, 0), (0, 4, 3), (4, 0), (2, 4, 4, 3)]:
        with pytest.raises(ValueError):
            texfold.encode(np.zeros(shape, np.uint8))
    with pytest.raises(ValueError, match="no images"):
        texfold.encode([])
    with pytest.raises(texfold.EncodeError, match="name"):
        texfold.encode({"../color": waves(8, 8, 3)})
    with pytest.raises(ValueError, match="two alike"):
        texfold.psnr(waves(8, 8, 3), waves(8, 9, 3))


@pytest.mark.parametrize(
    "options",
    [
        {"psnr": 30, "bpp": 2}, {"psnr": float("nan")}, {"bpp": -1}, {"codec": "gif"}, {"effort": "extreme"},
        {"access": "page"}, {"metric": "ssim"}, {"color": "cmyk"}, {"threads": 0}, {"codec": "lightfield"},
    ],
)  # fmt: skip
def test_options_that_do_not_exist_are_named(options):
    with pytest.raises(ValueError):
        texfold.encode(waves(16, 16, 3), **options)


def test_files_are_the_same_for_any_number_of_threads():
    image = noise(128)
    assert texfold.encode(image, psnr=30, threads=1) == texfold.encode(image, psnr=30, threads=3)


def test_progress_rises_to_the_whole_and_its_errors_come_out():
    shares = []
    texfold.encode(waves(64, 64, 3), psnr=36, progress=lambda stage, share: shares.append((stage, share)))
    assert shares[-1][1] == 1 and [share for _, share in shares] == sorted(share for _, share in shares)
    assert all(isinstance(stage, str) for stage, _ in shares)

    def stop(stage, share):
        raise LookupError(stage)

    with pytest.raises(LookupError):
        texfold.encode(noise(256), psnr=30, codec="epitome", progress=stop)


def test_other_threads_run_while_it_encodes_and_ten_share_a_texture():
    counted, done = [0], threading.Event()

    def count():
        while not done.is_set():
            counted[0] += 1
            time.sleep(0.001)

    counter = threading.Thread(target=count)
    counter.start()
    began = time.perf_counter()
    texture = texfold.open(texfold.encode(noise(256), psnr=30, codec="vq", effort="fast", threads=1))
    seconds = time.perf_counter() - began
    done.set()
    counter.join()
    # With the lock held it would count once at the start and once at the end.
    assert counted[0] > 20 * seconds
    wanted, found = texture.decode(), []
    threads = [threading.Thread(target=lambda: found.append(texture.decode())) for _ in range(10)]
    [thread.start() for thread in threads], [thread.join() for thread in threads]
    assert len(found) == 10 and all(np.array_equal(wanted, one) for one in found)


@pytest.mark.skipif(os.name == "nt", reason="signals of consoles")
def test_ctrl_c_stops_it():
    program = (
        "import numpy, signal, texfold\n"
        # What is started in the background ignores it.
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "image = numpy.random.default_rng(1).integers(0, 256, (1024, 1024, 3), numpy.uint8)\n"
        "print('begun', flush=True)\n"
        "texfold.encode(image, psnr=40, codec='epitome', effort='high')\n"
    )
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as run:
        run.stdout.readline()
        time.sleep(1)
        run.send_signal(signal.SIGINT)
        _, errors = run.communicate(timeout=60)
    assert b"KeyboardInterrupt" in errors and run.returncode != 0
