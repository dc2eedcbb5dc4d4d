"""Banks that images are added to: by one process, and by the workers of a cluster, of which some are killed."""

import json
import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
import texfold

dask = pytest.importorskip("dask")
da = pytest.importorskip("dask.array")


def land(rows, columns, channels=3, dtype=np.uint8):
    """Waves of a few scales, with noise that depends on the place alone."""
    y, x = np.mgrid[:rows, :columns].astype(np.uint32)
    noise = ((x * 2654435761) ^ (y * 2246822519)) >> 27
    waves = 100 + 60 * np.sin(x / 37.0) * np.cos(y / 23.0)
    planes = [waves + noise + 9 * channel for channel in range(channels)]
    return (np.stack(planes, axis=2) * (257 if dtype == np.uint16 else 1)).astype(dtype)


def files(folder):
    """Files of a bank by name, but the lock."""
    return {name: (folder / name).read_bytes() for name in sorted(os.listdir(folder)) if name != "bank.lock"}


def add(folder, name, image, **options):
    with texfold.BankWriter(folder) as bank:
        return bank.add(name, image, **{"effort": "fast", "key": "1", **options})


@pytest.mark.parametrize("channels, dtype", [(1, np.uint8), (3, np.uint8), (4, np.uint8), (3, np.uint16)])
def test_what_is_added_is_read_and_meets_the_goal(tmp_path, channels, dtype):
    image = land(1300, 300, channels, dtype)
    assert add(tmp_path, "land", image[:, :, 0] if channels == 1 else image)
    bank = texfold.Bank(tmp_path)
    found = bank.read("land").reshape(image.shape)
    assert found.dtype == dtype and bank.levels("land") > 1
    assert 33.9 < texfold.psnr(image, found) < 34.6
    row = json.loads((tmp_path / "bank.json").read_bytes())["images"][0]["row"]
    assert row["goal_met"] and abs(row["psnr"] - texfold.psnr(image, found)) < 0.05


def test_a_cluster_writes_what_one_process_writes(tmp_path):
    image = land(2400, 1400)
    for folder, array in [("one", image), ("threads", da.from_array(image, chunks=(700, 333, 3)))]:
        assert add(tmp_path / folder, "land", array, bpp=0.5)
    assert len(files(tmp_path / "one")) == 7, "3x2 tiles and the list"
    assert files(tmp_path / "one") == files(tmp_path / "threads")


def strokes(rows, columns, seed):
    """Strokes that recur: an array, turned, of cells of 32 texels."""
    y, x = np.mgrid[:rows, :columns]
    kind, a, b = (x // 32 * 7 + y // 32 * 13 + seed * 5) % 4, x % 32, y % 32
    a, b = np.select([kind == 0, kind == 1], [a, 31 - b], b), np.select([kind == 0, kind == 1], [b, a], 31 - a)
    stroke = (a * a // 9 + 3 * b + a * b // 17) % 23 < 9
    return np.repeat((60 + (x + y) // 10 + 50 * stroke).astype(np.uint8)[:, :, None], 3, 2)


def test_images_by_texel_share_a_codebook(tmp_path):
    for name, seed in [("a", 0), ("b", 1)]:
        image = strokes(192, 1320, seed)
        for folder, array in [("one", image), ("dask", da.from_array(image, chunks=(100, 333, 3)))]:
            assert add(tmp_path / folder, name, array, codec="progressive", bpp=0.5, effort="normal", mips=False, category="s")
    assert files(tmp_path / "one") == files(tmp_path / "dask")
    images = json.loads((tmp_path / "one" / "bank.json").read_bytes())["images"]
    (first, _), (second, _) = (image["tiles"] for image in images)
    assert first["grown_rows"] > 0 and second["blocks"][0] > 0, "the second uses what the first brought"
    # What surrounds a tile is of the image: no step where tiles meet.
    bank = texfold.Bank(tmp_path / "one")
    assert bank.shape("b") == (192, 1320, 3) and texfold.psnr(image, bank.read("b")) > 25
    error = np.abs(bank.read("b").astype(int) - image)
    assert error[:, 1016:1032].mean() < 1.5 * error.mean()


def test_workers_that_do_not_reach_the_folder_are_named(tmp_path, monkeypatch):
    monkeypatch.setattr(texfold.writing, "_write", lambda *_: None)
    with pytest.raises(FileNotFoundError, match="workers must reach"):
        add(tmp_path, "land", land(64, 64))
    monkeypatch.undo()
    assert add(tmp_path, "land", land(64, 64))


def test_a_tile_that_fails_by_texel_leaves_the_bank_as_it_was(tmp_path):
    add(tmp_path, "land", land(64, 64))
    before = files(tmp_path)
    broken = da.map_blocks(fail_at_the_second, da.from_array(land(64, 1300), chunks=(64, 1100, 3)), meta=np.zeros((0, 0, 0), np.uint8))
    with texfold.BankWriter(tmp_path) as bank:
        with pytest.raises(OSError, match="the store failed"):
            bank.add("bad", broken, codec="progressive", effort="fast")
        with pytest.raises(ValueError, match="dct, progressive"):
            bank.add("bad", land(64, 64), codec="vq")
        assert bank.add("good", land(64, 64), codec="progressive", effort="fast")
    found = files(tmp_path)
    assert all(found[name] == data for name, data in before.items() if name != "bank.json")
    assert texfold.Bank(tmp_path).names == ["land", "good"]


def fail_at_the_second(block):
    if block.shape[1] == 200:
        raise OSError("the store failed")
    return block


@pytest.mark.filterwarnings("ignore:Sending large graph")
def test_tiles_of_killed_workers_run_again(tmp_path):
    distributed = pytest.importorskip("distributed")
    image = land(2400, 1400)
    assert add(tmp_path / "one", "land", image)
    options = {"n_workers": 2, "threads_per_worker": 1, "processes": True, "dashboard_address": None}
    with distributed.LocalCluster(**options) as cluster, distributed.Client(cluster) as client:
        client.run(lambda: None)
        killed = []

        def kill():
            """Ends a worker while it has tiles, three times."""
            while len(killed) < 3 and not done:
                time.sleep(0.4)
                busy = [worker for worker, calls in client.processing().items() if calls]
                process = client.run(os.getpid, workers=busy[:1]) if busy else {}
                for pid in process.values():
                    os.kill(pid, signal.SIGKILL)
                    killed.append(pid)

        done = []
        thread = threading.Thread(target=kill)
        thread.start()
        try:
            assert add(tmp_path / "cluster", "land", da.from_array(image, chunks=(1000, 1000, 3)))
        finally:
            done.append(True)
            thread.join()
    assert killed, "no worker was killed"
    assert files(tmp_path / "one") == files(tmp_path / "cluster")


#: Adds an image in a process that is killed at its third tile at the first step.
ADD = """
import os, signal, sys, texfold
sys.path.insert(0, sys.argv[2])
from test_writing import add, land
encode, calls = texfold.writing._texfold.tile_bytes, []
def third(*given):
    calls.append(1)
    if len(calls) == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return encode(*given)
texfold.writing._texfold.tile_bytes = third
add(sys.argv[1], "land", land(2400, 300))
"""


def test_what_a_killed_process_has_written_is_not_written_again(tmp_path, monkeypatch):
    image = land(2400, 300)
    assert add(tmp_path / "one", "land", image)
    folder = tmp_path / "killed"
    process = subprocess.run([sys.executable, "-c", ADD, str(folder), os.path.dirname(__file__)], check=False)
    assert process.returncode == -signal.SIGKILL and not (folder / "bank.json").exists()
    sums = sorted(folder.glob(".texfold-job-*/*.sums"))
    assert len(sums) == 2
    # Cut short by hand, as no process leaves it.
    sums[0].write_text("")
    calls, encode = [], texfold.writing._texfold.tile_bytes
    monkeypatch.setattr(texfold.writing._texfold, "tile_bytes", lambda *given: calls.append(1) or encode(*given))
    assert add(folder, "land", image)
    resumed = len(calls)
    assert add(tmp_path / "new", "land", image)
    assert len(calls) == 2 * resumed + 1 and len(calls) % 3 == 2, "of three tiles at the first step one was whole"
    assert files(folder) == files(tmp_path / "one") == files(tmp_path / "new")


@pytest.mark.parametrize("other", [{"key": "2"}, {"psnr": 38}])
def test_another_image_or_goal_takes_the_place_of_what_is_half_done(tmp_path, other):
    image = land(2000, 300)

    def fail(block):
        if list(tmp_path.glob("half/.texfold-job-*/*.sums")):
            raise OSError("the store failed")
        return block

    broken = da.map_blocks(fail, da.from_array(image, chunks=(1000, 300, 3)), meta=np.zeros((0, 0, 0), np.uint8))
    with dask.config.set(scheduler="synchronous"), pytest.raises(OSError, match="the store failed"):
        add(tmp_path / "half", "land", broken)
    for folder in ["half", "new"]:
        assert add(tmp_path / folder, "land", image[::-1], **other)
    assert files(tmp_path / "half") == files(tmp_path / "new")


def test_the_same_again_is_no_work_and_another_is_refused_or_replaces_it(tmp_path):
    image = land(300, 200)
    assert add(tmp_path, "land", image, key=None)
    before = files(tmp_path)
    assert not add(tmp_path, "land", image, key=None)
    with pytest.raises(texfold.BankError, match="already"):
        add(tmp_path, "land", image[::-1], key=None)
    with pytest.raises(texfold.BankError, match="cannot be the name"):
        add(tmp_path, "../land", image)
    assert files(tmp_path) == before
    assert add(tmp_path, "land", image[::-1], key=None, replace=True)
    assert texfold.psnr(texfold.Bank(tmp_path).read(), image[::-1]) > 33
    assert add(tmp_path, "again", image, category="named")
    assert texfold.Bank(tmp_path).names == ["land", "again"]


def test_bad_images_are_named_and_leave_the_bank_as_it_was(tmp_path):
    add(tmp_path, "land", land(64, 64))
    before = files(tmp_path)
    for image, error in [
        (land(64, 64).astype(float), TypeError),
        (np.zeros((64, 64, 5), np.uint8), ValueError),
        (np.zeros((0, 64), np.uint8), ValueError),
        (da.zeros((64, 64, 3), dtype=np.float32), TypeError),
    ]:
        with pytest.raises(error):
            add(tmp_path, "bad", image)

    def fail(block):
        raise OSError("the store failed")

    broken = da.map_blocks(fail, da.zeros((64, 64, 3), dtype=np.uint8), dtype=np.uint8, meta=np.zeros((0, 0, 0), np.uint8))
    with pytest.raises(OSError, match="the store failed"):
        add(tmp_path, "bad", broken)
    # What would be listed and not be read is refused: before it is encoded, or before it is listed.
    for image in [np.zeros((1, 32769), np.uint8), da.zeros((76000, 76000, 3), dtype=np.uint8)]:
        with pytest.raises(texfold.BankError, match="a side has at most 32768"):
            add(tmp_path, "bad", image)
    with pytest.raises(texfold.BankError, match="georeference"):
        add(tmp_path, "bad", land(64, 64), georeference=b"II" + bytes(1 << 24))
    with pytest.raises(ValueError, match="1 axes"):
        add(tmp_path, "bad", da.zeros(64, dtype=np.uint8))
    with texfold.BankWriter(tmp_path) as bank:
        with pytest.raises(texfold.BankError, match="another process"):
            texfold.BankWriter(tmp_path)
        with pytest.raises(ValueError, match="give one goal"):
            bank.add("bad", land(64, 64), psnr=30, bpp=1)
    with pytest.raises(ValueError, match="closed"):
        bank.add("bad", land(64, 64))
    # Reversed and read-only arrays are images as others are.
    frozen = land(64, 64)[::-1, ::-1]
    frozen.flags.writeable = False
    texfold.BankWriter(tmp_path).close()
    assert files(tmp_path) == before and add(tmp_path, "frozen", frozen)
    assert texfold.Bank(tmp_path).names == ["land", "frozen"]
