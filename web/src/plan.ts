// Which superblocks a rectangle of a texture in blocks needs, and where the compute shader holds what it decodes of them: the counterpart
// of `texfold_shaders::DctPlan`.

import { planeSide, planesOf, STAGE_LEVELS, superblockCounts } from "./codecs/dct.js";
import { atLevel, fullLevels, type Size } from "./container.js";
import { type BlockLayout, packedOffsets } from "./form.js";
import { WORDS } from "./generated/dct.js";

const SIDE = 8;
/** Words of a block's samples in scratch memory, and of its notes. */
export const BLOCK_WORDS = 64;
export const BLOCK_NOTES = 5;
/** Most bytes of scratch memory that a decoder uses at once: half of what every WebGPU device binds. */
export const MAX_SCRATCH = 64 << 20;

/** A rectangle of a mip level, in texels. */
export interface Rect {
  level: number;
  x: number;
  y: number;
  width: number;
  height: number;
}

/** What is decoded of one plane. */
export interface Pass {
  /** Parameters of the shader. */
  words: Int32Array;
  superblocks: number;
  /** Blocks times axes. */
  blocks: number;
  deblocks: boolean;
  predicts: boolean;
  axes: number;
}

/** What a rectangle needs, the coarsest plane first. */
export interface Plan {
  rect: Rect;
  passes: Pass[];
  /** Words of scratch memory, all 0 before the first pass. */
  words: number;
}

/** First and end, columns then rows. */
type Range = [number, number];

/** Plan of a rectangle that lies inside of one of the levels that a texture gives. */
function planOf(layout: BlockLayout, rect: Rect): Plan {
  const planes = planesOf(layout.size);
  const texels = 1 << (layout.superblockLog2 - rect.level);
  const cover = (first: number, count: number): Range => [Math.floor(first / texels), Math.ceil((first + count) / texels)];
  let needed: [Range, Range] = [cover(rect.x, rect.width), cover(rect.y, rect.height)];
  const all = planes.map((_, plane) => {
    const found = needed, base = planes[plane + 1];
    if (base) {
      needed = [baseOf(layout, plane, found[0], base.width), baseOf(layout, plane, found[1], base.height)];
    }
    return found;
  });
  return { rect, ...passesOf(layout, planes, all) };
}

/** Superblocks of a plane's base that hold the means of its superblocks' blocks, and those a mean around them. */
function baseOf(layout: BlockLayout, plane: number, [start, end]: Range, all: number): Range {
  const side = planeSide(layout, plane) / SIDE, texels = planeSide(layout, plane + 1);
  return [Math.floor(Math.max(0, start * side - 1) / texels), Math.ceil(Math.min(all, end * side + 1) / texels)];
}

function passesOf(layout: BlockLayout, planes: Size[], needed: [Range, Range][]): { passes: Pass[]; words: number } {
  const axes = layout.ranks.length;
  const counts = superblockCounts(layout);
  const passes: Pass[] = [];
  // The first block's words stay 0: what lies beyond a border is read there.
  let next = BLOCK_WORDS, start = 0;
  let base: { first: number[]; held: number[]; wrap: number[]; samples: number } | undefined;
  for (let plane = planes.length - 1; plane >= 0; plane--) {
    const size = planes[plane]!, ranges = needed[plane]!, count = counts[plane]!, side = planeSide(layout, plane) / SIDE;
    const blocks = [Math.ceil(size.width / SIDE), Math.ceil(size.height / SIDE)];
    const first = ranges.map((range) => range[0]);
    const held = ranges.map((range, axis) => Math.min(range[1] * side, blocks[axis]!) - range[0] * side);
    const wrap = count.map((superblocks) => superblocks * side);
    const samples = next, total = held[0]! * held[1]! * axes;
    next += BLOCK_WORDS * total;
    const notes = next;
    next += BLOCK_NOTES * total;
    const ranks = layout.ranks.reduceRight((sum, rank) => (sum << 2) | rank, 0);
    const deblocking = plane > 0 ? 0 : layout.deblocking;
    const numbers = [
      ...blocks, ...first, ...ranges.map((range) => range[1] - range[0]), ...held,
      ...(base?.first ?? [0, 0]), ...(base?.held ?? [0, 0]), ...wrap, ...(base?.wrap ?? [0, 0]),
      count[0]!, start, side, axes, ranks, plane > 0 ? 1 : 0, base ? 1 : 0, samples, notes, base?.samples ?? 0,
      layout.steps + BLOCK_WORDS * plane, packedOffsets(layout), layout.index, layout.indexBits,
      layout.streamBytes, deblocking, WORDS.length, 0,
    ];
    const superblocks = (ranges[0][1] - ranges[0][0]) * (ranges[1][1] - ranges[1][0]);
    passes.push({ words: Int32Array.from(numbers), superblocks, blocks: total, deblocks: deblocking > 0, predicts: layout.hasModes && plane === 0, axes });
    base = { first: first.map((at) => at * side * SIDE), held, wrap: wrap.map((at) => at * SIDE), samples };
    start += count[0]! * count[1]!;
  }
  return { passes, words: next };
}

/** Plans of the parts of a rectangle that need at most `most` bytes each, cut where superblocks are. */
export function plansOf(layout: BlockLayout, rect: Rect, most: number): Plan[] {
  const texels = 1 << (layout.superblockLog2 - rect.level);
  const plan = planOf(layout, rect);
  const count = (first: number, length: number): number => Math.ceil((first + length) / texels) - Math.floor(first / texels);
  const columns = count(rect.x, rect.width), rows = count(rect.y, rect.height);
  if (4 * plan.words <= most || columns * rows <= 1) {
    return [plan];
  }
  if (rows > 1) {
    const middle = (Math.floor(rect.y / texels) + (rows >> 1)) * texels - rect.y;
    const lower = { ...rect, y: rect.y + middle, height: rect.height - middle };
    return [...plansOf(layout, { ...rect, height: middle }, most), ...plansOf(layout, lower, most)];
  }
  const middle = (Math.floor(rect.x / texels) + (columns >> 1)) * texels - rect.x;
  const right = { ...rect, x: rect.x + middle, width: rect.width - middle };
  return [...plansOf(layout, { ...rect, width: middle }, most), ...plansOf(layout, right, most)];
}

/** What a part of the finest level has of a level whose texels are means of squares of 2^`level` samples; parts are cut where superblocks are. */
export function reduced(part: Rect, size: Size, level: number): Rect {
  const few = atLevel(size, level);
  const cut = (first: number, count: number, all: number, last: number): [number, number] => {
    const start = first >> level, end = first + count >= all ? last : (first + count) >> level;
    return [start, Math.max(0, end - start)];
  };
  const [x, width] = cut(part.x, part.width, size.width, few.width);
  const [y, height] = cut(part.y, part.height, size.height, few.height);
  return { level, x, y, width, height };
}

/** Levels that a texture in blocks of that size can give. */
export const levelsOf = (size: Size): number => Math.min(STAGE_LEVELS, fullLevels(size));
