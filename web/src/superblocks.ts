// Bytes of the superblocks of a texture in blocks: what a map of bits shows.

import { lengthOf, planeSide, superblockCounts } from "./codecs/dct.js";
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
  const side = planeSide(layout, 0);
  const counts = superblockCounts(layout);
  const [columns, rows] = counts[0]!;
  const before = counts.slice(1).reduce((sum, [columns, rows]) => sum + columns * rows, 0);
  const index = words.subarray(layout.index);
  const bytes = Array.from({ length: columns * rows }, (_, number) => lengthOf(index, layout.indexBits, before + number));
  return { columns, rows, side, bytes };
}
