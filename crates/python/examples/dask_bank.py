"""Adds an image that no process holds whole to a bank, by the workers of a Dask cluster on this machine:

    pip install ./crates/python dask distributed
    python crates/python/examples/dask_bank.py --side 16384 --workers 2

Prints seconds and the most memory that a worker has held. ``--kill N`` ends N workers while they work: their tiles run again.
"""

import argparse
import os
import resource
import signal
import tempfile
import threading
import time

import dask.array as da
import distributed
import numpy as np
import texfold

CHUNK = 1024


def land(block_info):
    """Land as it is drawn for a chunk: hills, fields and noise that depend on the place alone."""
    (top, bottom), (left, right), _ = block_info[None]["array-location"]
    y, x = np.mgrid[top:bottom, left:right].astype(np.uint32)
    hills = 50 * np.sin(x / 611.0) * np.cos(y / 487.0) + 25 * np.sin((x + y) / 97.0)
    fields = 24.0 * (((x // 173) * 7 + (y // 211) * 13) % 5)
    noise = (((x * np.uint32(2654435761)) ^ (y * np.uint32(2246822519))) >> 28).astype(np.float64)
    planes = [90 + hills + fields + noise, 110 + hills + noise, 60 + fields / 2 + noise]
    return np.clip(np.stack(planes, axis=2), 0, 255).astype(np.uint8)


def memory():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def kill(client, count, pause, done):
    while count > 0 and not done.wait(pause):
        busy = [worker for worker, calls in client.processing().items() if calls]
        for pid in client.run(os.getpid, workers=busy[:1]).values() if busy else ():
            os.kill(pid, signal.SIGKILL)
            print(f"killed worker {pid}")
            count -= 1


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--side", type=int, default=16384, help="columns and rows")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--bpp", type=float, default=0.5)
    parser.add_argument("--kill", type=int, default=0, help="workers that are ended while they work")
    parser.add_argument("--out", default=None, help="folder of the bank; a temporary one by default")
    options = parser.parse_args()
    side = options.side
    chunks = (CHUNK, CHUNK, 3)
    image = da.map_blocks(land, chunks=da.core.normalize_chunks(chunks, (side, side, 3)), dtype=np.uint8, meta=np.zeros((0, 0, 0), np.uint8))
    out = options.out or tempfile.mkdtemp()
    # Spread over the run, at some 1.5 megatexels a second.
    pause = max(2, side * side / 1.5e6 / max(options.kill, 1))
    done = threading.Event()
    with (
        distributed.LocalCluster(n_workers=options.workers, threads_per_worker=1, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        thread = threading.Thread(target=kill, args=(client, options.kill, pause, done))
        thread.start()
        start = time.time()
        try:
            with texfold.BankWriter(out) as bank:
                added = bank.add("land", image, bpp=options.bpp, effort="fast", key=f"land {side}")
        finally:
            done.set()
            thread.join()
        seconds = time.time() - start
        most = max(client.run(memory).values())
    if not added:
        print(f"{out} has the image already")
        return
    size = sum(os.path.getsize(os.path.join(out, name)) for name in os.listdir(out))
    print(
        f"{side}x{side}, {options.workers} workers: {seconds:.1f} s, {side * side / seconds / 1e6:.2f} megatexels/s,"
        f" {size / 1e6:.1f} MB, {most:.0f} MiB a worker at most, {memory():.0f} MiB the client; {out}"
    )


if __name__ == "__main__":
    main()
