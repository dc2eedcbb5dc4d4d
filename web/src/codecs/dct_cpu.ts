// Images in blocks of variable length, decoded on the CPU: the counterpart of crates/dct, which gives the texels of the compute passes.
// All arithmetic is in 32-bit integers and wraps.

import type { Size } from "../container.js";
import type { BlockLayout, Blocks, Channel } from "../form.js";
import { WORDS } from "../generated/dct.js";
import type { Rect } from "../plan.js";
import { COEFFICIENTS, allTables, FIRST_END, FIRST_MODE, FIRST_ODD, lengthOf, ODD_TABLES, planeSide, planesOf, PROBABILITY_BITS, SET_TABLES, SIDE, startOf, superblockCounts, SYMBOLS } from "./dct.js";
import { addPrediction } from "./intra.js";

/** First words of the classes of expected magnitudes and of the symbols. */
const LEVEL_WORDS = 64;
const SYMBOL_WORDS = 128;
/** First table of the magnitude that is read first. */
const FIRST_LAST = 96;
/** The state of dependent quantisation behind each one, behind an even magnitude and behind an odd one; four bits a state. */
const NEXT_STATES = [0x73426150, 0x51604372];
const ESCAPE = 15;
const ESCAPE_BITS = 24;
/** Largest magnitude that contexts tell apart. */
const LARGEST = 127;
/** Slots of a table that share a first guess of their symbol, and such groups of slots. */
const GUESS_SHIFT = 7;
const GUESSES = 64;
/** Places of a block's magnitudes: columns of 10, of which the last two and the two columns behind the last are 0. */
const PADDED_SHIFT = 7;
const PADDED_SIDE = 10;
/** Texels along the side of the largest superblock. */
const MAX_SIDE = 64;

/** Samples of a part of a plane: axis by axis, row by row. */
interface Part {
  left: number;
  top: number;
  width: number;
  height: number;
  samples: Int32Array;
}

/** Channels of texels, side by side. */
type Texels = Uint8ClampedArray | Int32Array;

/** First and end of superblocks. */
type Range = [number, number];

/** Times a constant in 1/256, rounded. */
function times(value: number, constant: number): number {
  return (Math.imul(value, constant) + 128) >> 8;
}

/** The eight values of the frequencies that lie `step` apart from `at` on; they go to `to`, `stride` apart from `place` on. */
function transform(from: Int32Array, at: number, step: number, to: Int32Array, place: number, stride: number): void {
  const i0 = from[at]!, i1 = from[at += step]!, i2 = from[at += step]!, i3 = from[at += step]!;
  const i4 = from[at += step]!, i5 = from[at += step]!, i6 = from[at += step]!, i7 = from[at + step]!;
  const sum = (i0 + i4) | 0, difference = (i0 - i4) | 0, both = (i2 + i6) | 0;
  const rotated = (times(i2 - i6, 362) - both) | 0;
  const even0 = (sum + both) | 0, even1 = (difference + rotated) | 0;
  const even2 = (difference - rotated) | 0, even3 = (sum - both) | 0;
  const z13 = (i5 + i3) | 0, z10 = (i5 - i3) | 0, z11 = (i1 + i7) | 0, z12 = (i1 - i7) | 0;
  const odd0 = (z11 + z13) | 0, z5 = times(z10 + z12, 473);
  const odd1 = (z5 - times(z10, 669) - odd0) | 0;
  const odd2 = (times(z11 - z13, 362) - odd1) | 0;
  const odd3 = (times(z12, 277) - z5 + odd2) | 0;
  to[place] = even0 + odd0;
  to[place += stride] = even1 + odd1;
  to[place += stride] = even2 + odd2;
  to[place += stride] = even3 - odd3;
  to[place += stride] = even3 + odd3;
  to[place += stride] = even2 - odd2;
  to[place += stride] = even1 - odd1;
  to[place + stride] = even0 - odd0;
}

/** Filters `count` lines across a border, `along` apart; `q0` is the sample behind the border of the first, and samples of a line are `across` apart. */
function smooth(samples: Int32Array, q0: number, across: number, along: number, count: number, limit: number, near: number, far: number): void {
  for (; count > 0; count--, q0 += along) {
    const p0 = q0 - across, p1 = p0 - across, q1 = q0 + across;
    const step = Math.imul(samples[q0]! - samples[p0]!, 9), slopes = Math.imul(samples[q1]! - samples[p1]!, 3);
    let jump = (step - slopes + 8) >> 4;
    jump = jump > limit ? limit : jump < -limit ? -limit : jump;
    const byNear = (Math.imul(jump, near) + 4) >> 3, byFar = (Math.imul(jump, far) + 4) >> 3;
    samples[p1] = samples[p1]! + byFar;
    samples[p0] = samples[p0]! + byNear;
    samples[q0] = samples[q0]! - byNear;
    samples[q1] = samples[q1]! - byFar;
  }
}

/** Filters the borders of the blocks of a superblock of the image. */
function deblock(samples: Int32Array, side: number, columns: number, rows: number, { ranks, deblocking }: BlockLayout): void {
  ranks.forEach((rank, axis) => {
    const first = axis * side * side, limit = rank === 0 ? deblocking : 2 * deblocking;
    const near = rank === 0 ? 6 : 8, far = rank === 0 ? -2 : 3;
    for (let x = SIDE; x < SIDE * columns; x += SIDE) {
      smooth(samples, first + x, 1, side, SIDE * rows, limit, near, far);
    }
    for (let y = SIDE; y < SIDE * rows; y += SIDE) {
      smooth(samples, first + y * side, side, 1, SIDE * columns, limit, near, far);
    }
  });
}

/** For each symbol of each table its frequency, and its first slot behind 16 bits. */
function rangesOf(words: Int32Array, tables: number): Int32Array {
  const ranges = new Int32Array(tables * SYMBOLS);
  const start = (at: number): number => (words[WORDS.length + (at >> 1)]! >> (16 * (at & 1))) & 0xffff;
  for (let at = 0; at < ranges.length; at++) {
    const end = (at + 1) % SYMBOLS === 0 ? 1 << PROBABILITY_BITS : start(at + 1);
    ranges[at] = (end - start(at)) | (start(at) << 16);
  }
  return ranges;
}

/** First symbol of each group of slots of each table. */
function guessesOf(ranges: Int32Array): Uint8Array {
  const guesses = new Uint8Array((ranges.length / SYMBOLS) * GUESSES);
  for (let guess = 0, at = 0; guess < guesses.length; guess++) {
    const group = guess % GUESSES, first = ((guess - group) / GUESSES) * SYMBOLS;
    at = group === 0 ? first : at;
    while ((ranges[at]! >> 16) + (ranges[at]! & 0xffff) <= group << GUESS_SHIFT) {
      at++;
    }
    guesses[guess] = at - first;
  }
  return guesses;
}

/** A stream of symbols and plain bits. */
interface Stream {
  /** Begins to read the superblock of that number; an empty one where it is missing. */
  start(number: number): void;
  /** The next symbol by that table. */
  symbol(table: number): number;
  /** The next number of at most 16 bits. */
  bits(count: number): number;
  /** A magnitude from 8 on. */
  large(symbol: number): number;
}

function streamOf({ layout, words: unsigned, streams }: Blocks, words: Int32Array): Stream {
  const bytes = streams.subarray(0, layout.streamBytes), ranges = rangesOf(words, allTables(layout)), guesses = guessesOf(ranges);
  const index = unsigned.subarray(layout.index);
  // The first byte that is not read, and the stream's end.
  let state = 0, next = 0, end = 0;
  const refill = (): void => {
    if (state >>> 16 === 0 && next + 2 <= end) {
      state = (state << 16) | (bytes[next + 1]! << 8) | bytes[next]!;
      next += 2;
    }
  };
  const bits = (count: number): number => {
    const value = state & ((1 << count) - 1);
    state >>>= count;
    refill();
    return value;
  };
  return {
    bits,
    start(number) {
      const length = lengthOf(index, layout.indexBits, number);
      next = startOf(index, layout.indexBits, number);
      end = next + length > bytes.length ? next : next + length;
      const held = end - next, head = held < 4 ? held : 4 - (held & 1);
      state = 0;
      for (let at = head; at > 0; at--) {
        state = (state << 8) | bytes[next + at - 1]!;
      }
      next += head;
    },
    symbol(table) {
      const slot = state & ((1 << PROBABILITY_BITS) - 1), first = table << 4;
      let symbol = guesses[(table << 6) + (slot >> GUESS_SHIFT)]!, range = ranges[first + symbol]!;
      while (slot - (range >> 16) >= (range & 0xffff)) {
        range = ranges[first + ++symbol]!;
      }
      state = (Math.imul(range & 0xffff, state >>> PROBABILITY_BITS) + slot - (range >> 16)) | 0;
      refill();
      return symbol;
    },
    large(symbol) {
      const word = words[SYMBOL_WORDS + symbol]!, first = (word >> 16) & 0xfff;
      if (symbol < ESCAPE) {
        return first + bits(word >>> 28);
      }
      const length = Math.min(bits(5), ESCAPE_BITS), low = bits(Math.min(length, 12));
      return first + (low | (bits(Math.max(length - 12, 0)) << 12));
    },
  };
}

/** Sets the coefficients of the block in that column and row of a plane to what the means around it, of which there are `all`, say. */
function predict(coefficients: Int32Array, { left, top, width, height, samples }: Part, all: Size, axis: number, column: number, row: number): void {
  const line = (y: number): number => (axis * height + y - top) * width - left;
  const west = Math.max(column - 1, 0), east = Math.min(column + 1, all.width - 1);
  const here = line(row), above = line(Math.max(row - 1, 0)), below = line(Math.min(row + 1, all.height - 1));
  const m = samples[here + column]!, w = samples[here + west]!, e = samples[here + east]!;
  const n = samples[above + column]!, s = samples[below + column]!;
  coefficients[0] = m;
  coefficients[8] = times(w - e, 50);
  coefficients[16] = times(w + e - 2 * m, 12);
  coefficients[1] = times(n - s, 50);
  coefficients[9] = times(samples[above + west]! - samples[above + east]! - samples[below + west]! + samples[below + east]!, 10);
  coefficients[2] = times(n + s - 2 * m, 12);
}

/** Adds what a stream says of an axis of the block of that number to `coefficients`; a bit for each row of them that it adds to. */
type BlockReader = (plane: number, columns: number, block: number, axis: number) => number;

function blockReader({ ranks, offsets, isDependent, steps, superblockLog2 }: BlockLayout, words: Int32Array, { symbol, bits, large }: Stream, planes: number, coefficients: Int32Array): BlockReader {
  const axes = ranks.length, count = (axes << (2 * superblockLog2 - 6)) + 1;
  const classes = new Uint8Array(words.buffer, words.byteOffset + 4 * LEVEL_WORDS, 256);
  // Magnitudes of the blocks of a superblock and symbols of their numbers; the first are 0 and stand for what is missing.
  const magnitudes = new Uint8Array(count << PADDED_SHIFT), ends = new Uint8Array(count);
  const parity = isDependent ? 1 : 0;
  // Magnitudes that are not 0, in halves of steps, above the 6 bits of their place.
  const found = new Int32Array(COEFFICIENTS);

  const readMagnitudes = (own: number, left: number, above: number, cross: number, gain: number, set: number, first: number, last: number): number => {
    const tables = set * SET_TABLES, oddTables = FIRST_ODD + set * ODD_TABLES;
    let nonzero = 0, state = 0;
    for (let number = last; number >= first; number--) {
      const scan = words[number]!, raster = scan & 63, zone = (scan >> 8) & 255;
      const place = raster + ((raster >> 3) << 1), at = own + place;
      let table = tables + FIRST_LAST + zone;
      if (number < last) {
        const template = magnitudes[at + 1]! + magnitudes[at + 2]! + magnitudes[at + PADDED_SIDE]!
          + magnitudes[at + 2 * PADDED_SIDE]! + magnitudes[at + PADDED_SIDE + 1]!;
        const expected = ((template * gain) >> 1) + magnitudes[left + place]! + magnitudes[above + place]! + magnitudes[cross + place]!;
        const first = state & 1 ? oddTables + ((zone >> 1) << 4) : tables + (zone << 4);
        table = first + classes[expected < 255 ? expected : 255]!;
      }
      let magnitude = symbol(table);
      if (magnitude > 7) {
        magnitude = large(magnitude);
      }
      magnitude += number === last ? 1 : 0;
      if (magnitude > 0) {
        found[nonzero++] = ((2 * magnitude - (state & 1)) << 6) | raster;
        magnitudes[at] = magnitude < LARGEST ? magnitude : LARGEST;
      }
      state = (NEXT_STATES[magnitude & parity]! >> (state << 2)) & 7;
    }
    return nonzero;
  };

  return (plane, columns, block, axis) => {
    const own = block * axes + axis + 1, first = plane < planes - 1 ? 1 : 0, rank = ranks[axis]!;
    if (own === 1) {
      magnitudes.fill(0);
    }
    const left = block % columns > 0 ? own - axes : 0, above = block >= columns ? own - axes * columns : 0;
    // Where there is only one neighbour, it counts twice.
    const one = left || above, other = above || left;
    const set = (plane > 0 ? 2 : 0) + (rank > 0 ? 1 : 0);
    const sum = ends[one]! + ends[other]!;
    const end = symbol(set * SET_TABLES + FIRST_END + (one === 0 ? 8 : sum === 0 ? 0 : Math.min((sum + 5) >> 2, 7)));
    ends[own] = end;
    const word = words[SYMBOL_WORDS + end]!, count = (word & 255) + bits((word >> 8) & 255);
    const last = Math.min(count + first, COEFFICIENTS) - 1, cross = rank > 1 ? own - 1 : 0;
    const nonzero = readMagnitudes(own << PADDED_SHIFT, one << PADDED_SHIFT, other << PADDED_SHIFT, cross << PADDED_SHIFT, one === 0 ? 5 : 4, set, first, last);
    let rows = 0, signs = 0;
    for (let at = 0; at < nonzero; at++, signs >>= 1) {
      if (at % 16 === 0) {
        signs = bits(Math.min(nonzero - at, 16));
      }
      const raster = found[at]! & 63, halves = found[at]! >>> 6;
      const value = Math.imul((halves << 4) - offsets[halves > 2 ? 1 : 0]!, words[steps + COEFFICIENTS * plane + raster]!) >>> 9;
      coefficients[raster] = coefficients[raster]! + (signs & 1 ? -value : value);
      rows |= 1 << (raster & 7);
    }
    return rows;
  };
}

/** Reads superblocks: the one in that column and row of a plane, whose means are `base`, into a part that has all of it; the number of its blocks. */
type PlaneReader = (plane: number, column: number, row: number, base: Part | undefined, out: Part) => [number, number];

function readerOf(blocks: Blocks, planes: Size[]): PlaneReader {
  const { layout, words: { buffer, byteOffset, length } } = blocks, axes = layout.ranks.length, counts = superblockCounts(layout);
  const words = new Int32Array(buffer, byteOffset, length), coefficients = new Int32Array(COEFFICIENTS);
  const modes = new Uint8Array((MAX_SIDE / SIDE) ** 2);
  const stream = streamOf(blocks, words), read = blockReader(layout, words, stream, planes.length, coefficients);
  return (plane, column, row, base, out) => {
    const { width, height } = planes[plane]!, means = planes[plane + 1]!;
    const before = counts.slice(plane + 1).reduce((sum, [columns, rows]) => sum + columns * rows, 0), side = planeSide(layout, plane) / SIDE;
    stream.start(before + row * counts[plane]![0] + column);
    const [columns, rows] = [width, height].map((texels, at) => Math.min(side, Math.ceil(texels / SIDE) - side * (at ? row : column))) as [number, number];
    for (let block = 0; block < columns * rows; block++) {
      const x = column * side + (block % columns), y = row * side + Math.floor(block / columns);
      const hasLeft = block % columns > 0, hasAbove = block >= columns, hasRight = (block + 1) % columns > 0;
      const mode = layout.hasModes && plane === 0 && block > 0
        ? stream.symbol(FIRST_MODE + (hasLeft && modes[block - 1]! > 0 ? 1 : 0) + (hasAbove && modes[block - columns]! > 0 ? 1 : 0))
        : 0;
      modes[block] = mode;
      for (let axis = 0; axis < axes; axis++) {
        coefficients.fill(0);
        if (base) {
          predict(coefficients, base, means, axis, x, y);
        }
        if (mode > 0) {
          coefficients.fill(0, 1);
        }
        const used = read(plane, columns, block, axis) | (base ? 7 : 0);
        for (let at = 0; at < SIDE; at++) {
          if ((used >> at) & 1) {
            transform(coefficients, at, SIDE, coefficients, at, SIDE);
          }
        }
        const place = (axis * out.height + SIDE * y - out.top) * out.width + SIDE * x - out.left;
        for (let at = 0; at < SIDE; at++) {
          transform(coefficients, SIDE * at, 1, out.samples, place + at, out.width);
        }
        if (mode > 0) {
          addPrediction(out.samples, place, out.width, mode, hasLeft, hasAbove, hasRight);
        }
      }
    }
    return [columns, rows];
  };
}

/** The means that superblocks of a plane need, those a block around them, too; nothing where the plane is a single block. */
function baseOf(layout: BlockLayout, planes: Size[], read: PlaneReader, plane: number, columns: Range, rows: Range): Part | undefined {
  const base = planes[plane + 1], side = planeSide(layout, plane) / SIDE, texels = planeSide(layout, plane + 1);
  if (!base) {
    return undefined;
  }
  // Superblocks of the base, its first sample in them, and samples.
  const cover = ([start, end]: Range, all: number): [Range, number, number] => {
    const first = Math.floor(Math.max(0, start * side - 1) / texels), held = Math.ceil(Math.min(all, end * side + 1) / texels);
    return [[first, held], first * texels, Math.min(held * texels, SIDE * Math.ceil(all / SIDE)) - first * texels];
  };
  const [across, left, width] = cover(columns, base.width), [down, top, height] = cover(rows, base.height);
  const part = { left, top, width, height, samples: new Int32Array(width * height * layout.ranks.length) };
  const coarser = baseOf(layout, planes, read, plane + 1, across, down);
  for (let row = down[0]; row < down[1]; row++) {
    for (let column = across[0]; column < across[1]; column++) {
      read(plane + 1, column, row, coarser, part);
    }
  }
  return part;
}

/** Writes channels of `count` samples of a row of a superblock; bytes are clamped by the array that they go to. */
function writeLine({ samples, width, height }: Part, shift: number, channels: (Channel | undefined)[], from: number, count: number, out: Texels, to: number): void {
  const area = width * height;
  for (let channel = 0; channel < 4; channel++) {
    const found = channels[channel];
    if (found) {
      const { mean, firstAxis, weights } = found, w0 = weights[0]!, w1 = weights[1]!, w2 = weights[2]!, w3 = weights[3]!;
      for (let x = 0, place = to + channel, at = firstAxis * area + from; x < count; x++, place += 4, at++) {
        out[place] = (mean + Math.imul(samples[at]!, w0) + Math.imul(samples[at + area]!, w1)
          + Math.imul(samples[at + 2 * area]!, w2) + Math.imul(samples[at + 3 * area]!, w3)) >> shift;
      }
    }
  }
}

/** Writes `count` means of squares of 2^`level` samples a side, whose rows lie in `lines`; behind column `last` that counts again. */
function writeMeans({ isLight, isWeighted, depth }: BlockLayout, lines: Texels, last: number, level: number, count: number, out: Texels, to: number): void {
  const isDeep = depth > 8, shift = isDeep ? 12 : 0, scale = isDeep ? 257 : 1, squares = isLight && level > 0;
  // Samples of 16 bits are not clamped yet.
  const sample = (at: number): number => isDeep ? Math.max(0, Math.min(lines[at]!, 65535)) : lines[at]!;
  for (let texel = 0; texel < count; texel++, to += 4) {
    let red = 0, green = 0, blue = 0, alpha = 0, weights = 0;
    for (let place = 0; place < 1 << (2 * level); place++) {
      const column = (texel << level) + (place & ((1 << level) - 1));
      const at = 4 * (MAX_SIDE * (place >> level) + (column < last ? column : last));
      const r = sample(at), g = sample(at + 1), b = sample(at + 2), a = sample(at + 3);
      const weight = isWeighted ? (isDeep ? a >> 8 : a) + 1 : 1;
      red += weight * (squares ? Math.imul(r, r) >>> shift : r);
      green += weight * (squares ? Math.imul(g, g) >>> shift : g);
      blue += weight * (squares ? Math.imul(b, b) >>> shift : b);
      alpha += a;
      weights += weight;
    }
    const mean = (sum: number): number => {
      const value = Math.floor((sum + (weights >> 1)) / weights);
      return (squares ? Math.round(Math.sqrt(value * (1 << shift))) : value) / scale;
    };
    out[to] = mean(red);
    out[to + 1] = mean(green);
    out[to + 2] = mean(blue);
    out[to + 3] = ((alpha + ((1 << (2 * level)) >> 1)) >> (2 * level)) / scale;
  }
}

/** Writes what a rectangle has of a superblock's texels. */
function writeTexels(layout: BlockLayout, tile: Part, { level, x, y, width, height }: Rect, out: Uint8ClampedArray, lines: Texels): void {
  const { channels, shift, size, depth } = layout, [gray, green, blue, alpha] = channels;
  const shown = channels.length < 3 ? [gray, gray, gray, green] : [gray, green, blue, alpha];
  const left = Math.max(x, tile.left >> level), right = Math.min(x + width, (tile.left + tile.width) >> level);
  const first = (left << level) - tile.left, count = right - left;
  const bottom = Math.min(y + height, (tile.top + tile.height) >> level);
  for (let row = Math.max(y, tile.top >> level); row < bottom; row++) {
    const to = 4 * ((row - y) * width + left - x);
    const line = (number: number, target: Texels, place: number): void => {
      const at = Math.min((row << level) + number, size.height - 1) - tile.top;
      writeLine(tile, shift, shown, at * tile.width + first, count << level, target, place);
    };
    if (level === 0 && depth === 8) {
      line(0, out, to);
    } else {
      for (let number = 0; number < 1 << level; number++) {
        line(number, lines, 4 * MAX_SIDE * number);
      }
      writeMeans(layout, lines, size.width - 1 - tile.left - first, level, count, out, to);
    }
  }
}

/**
 * Texels of a rectangle of level `rect.level` (0 to 2: the stage's own level, and means of 2x2 and 4x4 of its samples) of a texture in blocks,
 * as RGBA of 8 bits row by row; gray in all three colours, alpha 255 where there is none. The rectangle lies inside of the level.
 */
export function decodeBlocks(blocks: Blocks, rect: Rect): Uint8ClampedArray<ArrayBuffer> {
  const { layout } = blocks, { ranks, deblocking } = layout;
  const out = new Uint8ClampedArray(4 * rect.width * rect.height).fill(255);
  if (out.length === 0) {
    return out;
  }
  const side = planeSide(layout, 0), few = side >> rect.level;
  const cover = (first: number, count: number): Range => [Math.floor(first / few), Math.ceil((first + count) / few)];
  const columns = cover(rect.x, rect.width), rows = cover(rect.y, rect.height);
  const planes = planesOf(layout.size), read = readerOf(blocks, planes), base = baseOf(layout, planes, read, 0, columns, rows);
  // Channels look at four axes, of which some weigh nothing.
  const tile = { left: 0, top: 0, width: side, height: side, samples: new Int32Array((ranks.length + 3) * side * side) };
  const lines = new (layout.depth > 8 ? Int32Array : Uint8ClampedArray)(16 * MAX_SIDE).fill(65535);
  for (let row = rows[0]; row < rows[1]; row++) {
    for (let column = columns[0]; column < columns[1]; column++) {
      tile.left = column * side;
      tile.top = row * side;
      const held = read(0, column, row, base, tile);
      if (deblocking > 0) {
        deblock(tile.samples, side, ...held, layout);
      }
      writeTexels(layout, tile, rect, out, lines);
    }
  }
  return out;
}
