// Intra prediction of blocks: the counterpart of crates/dct/src/intra.rs. Samples next to a block are those above it and those to its left, from the
// corner on.

import { SIDE } from "./dct.js";

/** Shift of each direction along the side that it comes from, in 1/32 of a sample for each sample away from it. */
const ANGLES = [26, 13, 5, 0, -5, -13, -26];
const REFERENCES = 2 * SIDE + 1;

const above = new Int32Array(REFERENCES), left = new Int32Array(REFERENCES);
const known = new Int32Array(REFERENCES + SIDE), lines = new Int32Array(SIDE * SIDE);

/** Fills the samples next to the block at `own`; false where no block beside it is decoded. */
function readReferences(samples: Int32Array, own: number, stride: number, hasLeft: boolean, hasAbove: boolean, hasRight: boolean): boolean {
  const first = own - stride, count = hasRight ? 2 * SIDE : SIDE;
  for (let at = 0; at < REFERENCES - 1; at++) {
    above[at + 1] = hasAbove ? samples[first + Math.min(at, count - 1)]! : 0;
    left[at + 1] = hasLeft ? samples[own - 1 + Math.min(at, SIDE - 1) * stride]! : 0;
  }
  // What is missing is as the nearest sample that is there.
  if (!hasAbove) {
    above.fill(left[1]!);
  }
  if (!hasLeft) {
    left.fill(above[1]!);
  }
  above[0] = left[0] = hasLeft ? (hasAbove ? samples[first - 1]! : left[1]!) : above[1]!;
  return hasLeft || hasAbove;
}

/** Sets `lines` to the samples by the planar mode, row by row. */
function planar(): void {
  const right = above[SIDE + 1]!, below = left[SIDE + 1]!;
  for (let y = 0; y < SIDE; y++) {
    for (let x = 0; x < SIDE; x++) {
      const across = Math.imul(left[y + 1]!, SIDE - 1 - x) + Math.imul(right, x + 1);
      const down = Math.imul(above[x + 1]!, SIDE - 1 - y) + Math.imul(below, y + 1);
      lines[SIDE * y + x] = ((across | 0) + (down | 0) + SIDE) >> 4;
    }
  }
}

/** Sets `lines` to the samples by a direction, line by line away from `main`. */
function directed(main: Int32Array, other: Int32Array, angle: number): void {
  known.set(main, SIDE);
  for (let before = 1; angle < 0 && before < SIDE; before++) {
    known[SIDE - before] = other[Math.trunc((32 * before - Math.trunc(angle / 2)) / -angle)]!;
  }
  for (let away = 1; away <= SIDE; away++) {
    const part = (away * angle) & 31, first = SIDE + 1 + ((away * angle) >> 5);
    for (let along = 0; along < SIDE; along++) {
      const sum = Math.imul(known[first + along]!, 32 - part) + Math.imul(known[first + along + 1]!, part);
      lines[SIDE * (away - 1) + along] = ((sum | 0) + 16) >> 5;
    }
  }
}

/** Adds the prediction of a mode other than none to the block at `own`, less its mean; rows are `stride` apart. */
export function addPrediction(samples: Int32Array, own: number, stride: number, mode: number, hasLeft: boolean, hasAbove: boolean, hasRight: boolean): void {
  if (!readReferences(samples, own, stride, hasLeft, hasAbove, hasRight)) {
    return;
  }
  const direction = mode - 2, isFromLeft = direction >= 0 && direction < ANGLES.length;
  if (mode === 1) {
    planar();
  } else if (isFromLeft) {
    directed(left, above, ANGLES[direction]!);
  } else {
    directed(above, left, ANGLES[direction - ANGLES.length]!);
  }
  const mean = (lines.reduce((sum, sample) => (sum + sample) | 0, 0) + 32) >> 6;
  for (let y = 0; y < SIDE; y++) {
    for (let x = 0; x < SIDE; x++) {
      samples[own + y * stride + x]! += lines[isFromLeft ? SIDE * x + y : SIDE * y + x]! - mean;
    }
  }
}
