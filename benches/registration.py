"""What SIFT features and MAGSAC of OpenCV make of the pairs that the bench `registration` wrote.

    pip install opencv-python-headless
    cargo run --release -p texfold-benches --bin registration -- OUT
    python benches/registration.py OUT
    cargo run --release -p texfold-benches --bin registration -- OUT

writes OUT/oracle.csv: the name of each pair and the nine numbers of its homography, row by row, from pixels of the first
photograph to pixels of the second, (0, 0) at the upper left corner; none where fewer than 15 matches agree, as is usual.
The last command puts its figures into the table.
"""

import pathlib
import sys

import cv2
import numpy

RATIO = 0.8
LEAST = 15


def features(sift, path):
    return sift.detectAndCompute(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), None)


def homography(sift, first, second):
    (places, own), (others, theirs) = features(sift, first), features(sift, second)
    if own is None or theirs is None or len(theirs) < 2:
        return None
    pairs = cv2.BFMatcher().knnMatch(own, theirs, k=2)
    good = [pair[0] for pair in pairs if len(pair) == 2 and pair[0].distance < RATIO * pair[1].distance]
    if len(good) < LEAST:
        return None
    start = numpy.float64([places[match.queryIdx].pt for match in good])
    end = numpy.float64([others[match.trainIdx].pt for match in good])
    cv2.setRNGSeed(1)
    found, inside = cv2.findHomography(start, end, cv2.USAC_MAGSAC, 3.0, maxIters=10000, confidence=0.9999)
    if found is None or inside.sum() < LEAST:
        return None
    # OpenCV's pixel centres lie at whole numbers.
    half = numpy.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])
    return half @ found @ numpy.linalg.inv(half)


def main():
    out = pathlib.Path(sys.argv[1])
    sift = cv2.SIFT_create()
    lines = []
    for line in (out / "truth.csv").read_text().splitlines()[1:]:
        name = line.split(",")[0]
        found = homography(sift, out / f"{name}_a.png", out / f"{name}_b.png")
        numbers = "" if found is None else " ".join(repr(float(value)) for value in found.flatten())
        lines.append(f"{name},{numbers}\n")
    (out / "oracle.csv").write_text("".join(lines))


if __name__ == "__main__":
    main()
