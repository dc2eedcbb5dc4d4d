// Bytes of the superblocks of a texture in blocks: what a map of bits shows.

import { lengthOf, planesOf } from "./codecs/dct.js";
import type { Blocks } from "./form.js";

/** Columns and rows of superblocks of level 0, texels along the side of one, and the bytes of each, row by row. */
export interface Superblocks {
  columns: number;
  rows: number;
  side: number;
  bytes: number[];
}

/** The superblocks of a stage. */
export function superblocksOf({ layout, words }: Blocks): Superblocks {
  const side = 1 << layout.superblockLog2;
  const counts = planesOf(layout.size).map(({ width, height }) => [Math.ceil(width / side), Math.ceil(height / side)] as const);
  const [columns, rows] = counts[0]!;
  const before = counts.slice(1).reduce((sum, [width, height]) => sum + width * height, 0);
  const index = words.subarray(layout.index);
  const bytes = Array.from({ length: columns * rows }, (_, number) => lengthOf(index, layout.indexBits, before + number));
  return { columns, rows, side, bytes };
}
