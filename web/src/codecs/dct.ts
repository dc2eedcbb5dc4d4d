// Images in blocks of variable length. FORMAT.md, section of that name; crates/dct.

import { atLevel, fullLevels, type Layout, type PixelInfo, pixelsOf, readMaps, type Sections, type Size } from "../container.js";
import { type Budget, corrupt, truncated } from "../errors.js";
import { type BlockLayout, type Blocks, type Channel, type Form, Uniforms } from "../form.js";
import { MODE_STOPS, PRESETS, RADII, SCALES, STOP, WORDS } from "../generated/dct.js";
import type { Reader } from "../reader.js";
import { CLAMP, formatsOf } from "./content.js";
import { type Codec, images } from "./codec.js";

/** Mip levels that one texture in blocks gives: its own, and two of means of its samples. */
export const STAGE_LEVELS = 3;
export const SIDE = 8;
export const COEFFICIENTS = 64;
export const SYMBOLS = 16;
/** Words of a table. */
export const TABLE_WORDS = SYMBOLS / 2;
const ZONES = 6;
const CLASSES = 16;
export const FIRST_END = ZONES * CLASSES + ZONES;
export const SET_TABLES = FIRST_END + 9;
const SETS = 4;
const MAGNITUDE_STOPS = 5;
const USUAL_STOP = 31;
/** Tables of magnitudes of the odd quantiser: the first one behind all others, those of a set, and all tables with them. */
export const FIRST_ODD = SETS * SET_TABLES;
export const ODD_TABLES = (ZONES / 2) * CLASSES;
const TABLES = FIRST_ODD + SETS * ODD_TABLES;
/** Tables of intra modes, by the number of neighbours that are predicted: behind all others. */
export const FIRST_MODE = TABLES;
const MODE_TABLES = 3;
/** How far the odd quantiser's stopping probabilities are expected above those of the even one. */
const ODD_SHIFT = [-6, 0, 1, 0, 0];
/** The letter of 0 in the preset. */
const PRESET_ZERO = 48;
export const PROBABILITY_BITS = 13;
const PROBABILITIES = 1 << PROBABILITY_BITS;
const AXIS_BITS = 10;
const MAX_AXES = 16;
const MAX_GROUP = 4;
const GROUP = 32;
/** Binary logarithm of the side of superblocks of the planes behind the image, where they are small. */
const BASE_LOG2 = 4;
const MAX_STEP = 20 * 256 - 1;

/** Sizes of the planes of an image: the image, the means of its 8x8 blocks, their means, to a single block. */
export function planesOf(size: Size): Size[] {
  const planes = [size];
  for (let last = size; last.width > SIDE || last.height > SIDE; planes.push(last)) {
    last = { width: Math.ceil(last.width / SIDE), height: Math.ceil(last.height / SIDE) };
  }
  return planes;
}

type Cut = Pick<BlockLayout, "size" | "superblockLog2" | "baseLog2">;

/** Samples along the side of a plane's superblocks, the image being plane 0. */
export function planeSide({ superblockLog2, baseLog2 }: Cut, plane: number): number {
  return 1 << (plane > 0 ? baseLog2 : superblockLog2);
}

/** Columns and rows of superblocks of each plane. */
export function superblockCounts(layout: Cut): [number, number][] {
  return planesOf(layout.size).map(({ width, height }, plane) => {
    const side = planeSide(layout, plane);
    return [Math.ceil(width / side), Math.ceil(height / side)];
  });
}

/** First tables of the rows of a set: magnitudes by zone, first magnitudes, numbers of coefficients; then the end of the last. */
const ROWS = [...Array.from({ length: ZONES + 1 }, (_, zone) => zone * CLASSES), FIRST_END, SET_TABLES];

/** First tables of all rows in their order, and the end of the last: those of each set, and with dependent quantisers those of the odd one. */
function rowsOf(isDependent: boolean): number[] {
  const ofSets = Array.from({ length: SETS }, (_, set) => ROWS.slice(0, -1).map((row) => set * SET_TABLES + row)).flat();
  const odd = Array.from({ length: isDependent ? (SETS * ODD_TABLES) / CLASSES : 0 }, (_, row) => FIRST_ODD + row * CLASSES);
  return [...ofSets, ...odd, tableCount(isDependent)];
}

/** Tables of a texture without those of intra modes. */
function tableCount(isDependent: boolean): number {
  return isDependent ? TABLES : FIRST_ODD;
}

/** Tables of a texture. */
export function allTables({ isDependent, hasModes }: Pick<BlockLayout, "isDependent" | "hasModes">): number {
  return tableCount(isDependent) + (hasModes ? MODE_TABLES : 0);
}

/** Stopping probabilities of a table: fifteen of numbers of coefficients, five of magnitudes. */
function stopCount(table: number): number {
  return table < FIRST_ODD && table % SET_TABLES >= FIRST_END ? SYMBOLS - 1 : MAGNITUDE_STOPS;
}

/** The table of the even quantiser for the same class as an odd one: that of the higher one of both zones. */
function evenOf(odd: number): number {
  const set = Math.floor((odd - FIRST_ODD) / ODD_TABLES), within = (odd - FIRST_ODD) % ODD_TABLES;
  return set * SET_TABLES + (2 * Math.floor(within / CLASSES) + 1) * CLASSES + (within % CLASSES);
}

/** Bits of the probability tables, the lowest first; zeros behind the end. */
class Bits {
  private next = 0;
  constructor(private readonly bytes: Uint8Array) {}

  flag(): number {
    const bit = ((this.bytes[this.next >> 3] ?? 0) >> (this.next & 7)) & 1;
    this.next++;
    return bit;
  }

  /** A signed Exp-Golomb number; NaN for one that is too long. */
  signed(): number {
    let length = 0;
    while (this.flag() === 0) {
      if (++length > 7) {
        return NaN;
      }
    }
    let value = 1;
    for (; length > 0; length--) {
      value = (value << 1) | this.flag();
    }
    value -= 1;
    return value % 2 === 0 ? -value / 2 : (value + 1) / 2;
  }
}

/** Stopping probabilities of a table in the preset. */
function presetOf(table: number, preset: string): Uint8Array {
  const isOdd = table >= FIRST_ODD, set = isOdd ? SETS : Math.floor(table / SET_TABLES), within = isOdd ? 0 : table % SET_TABLES;
  const ends = Math.max(within - FIRST_END, 0), odd = Math.max(table - FIRST_ODD, 0);
  const ofSet = FIRST_END * MAGNITUDE_STOPS + (SET_TABLES - FIRST_END) * (SYMBOLS - 1);
  const start = set * ofSet + (within - ends + odd) * MAGNITUDE_STOPS + ends * (SYMBOLS - 1);
  return Uint8Array.from({ length: stopCount(table) }, (_, i) => preset.charCodeAt(start + i) - PRESET_ZERO);
}

/** Stopping probabilities moved so far, but not out of range. */
function moved(own: Uint8Array, by: (i: number) => number): Uint8Array {
  return own.map((value, i) => Math.min(Math.max(value + by(i), 0), STOP.length - 1));
}

/** Prediction of a table's stopping probabilities from those before. */
function predicted(all: Uint8Array[], table: number, isFirst: boolean, preset: string | undefined): Uint8Array {
  const before = all[table - 1]!;
  if (preset !== undefined) {
    const own = presetOf(table, preset), was = isFirst ? own : presetOf(table - 1, preset);
    return isFirst ? own : moved(own, (i) => before[i]! - was[i]!);
  }
  if (table >= FIRST_ODD) {
    const even = all[evenOf(table)]!, was = isFirst ? even : all[evenOf(table - 1)]!;
    return moved(even, (i) => isFirst ? ODD_SHIFT[i]! : before[i]! - was[i]!);
  }
  return (isFirst ? all[table - SET_TABLES] : before) ?? new Uint8Array(stopCount(table)).fill(USUAL_STOP);
}

/**
 * Words of all tables: for each pair of symbols the first slots of both, the first in the lower half. False where no writer writes such
 * bytes.
 */
function tablesOf(bytes: Uint8Array, fromPreset: boolean, isDependent: boolean, out: Uint32Array): boolean {
  const bits = new Bits(bytes), rows = rowsOf(isDependent), all: Uint8Array[] = [];
  const preset = fromPreset ? PRESETS[isDependent ? 1 : 0] : undefined;
  for (let row = 0; row + 1 < rows.length; row++) {
    const first = rows[row]!, asPredicted = bits.flag();
    for (let table = first; table < rows[row + 1]!; table++) {
      const values = Uint8Array.from(predicted(all, table, table === first, preset));
      all.push(values);
      if (asPredicted === 0 && bits.flag() === 0) {
        for (let i = 0; i < values.length; i++) {
          const value = values[i]! + bits.signed();
          if (!(value >= 0 && value < STOP.length)) {
            return false;
          }
          values[i] = value;
        }
      }
      writeTable(values, out.subarray(table * TABLE_WORDS, (table + 1) * TABLE_WORDS));
    }
  }
  return true;
}

/** Symbols of magnitudes that share a stopping probability with those before: 3 to 7 and 8 to 14. */
const MAGNITUDE_STOP = [0, 1, 2, 3, 3, 3, 3, 3, 4, 4, 4, 4, 4, 4, 4];

function writeTable(stops: Uint8Array, out: Uint32Array): void {
  const frequencies = new Uint16Array(SYMBOLS);
  let rest = 65536, sum = 0, largest = 0;
  for (let symbol = 0; symbol < SYMBOLS; symbol++) {
    const stop = stops.length > MAGNITUDE_STOPS ? symbol : MAGNITUDE_STOP[symbol]!;
    const taken = symbol === SYMBOLS - 1 ? rest : Math.floor((rest * STOP[stops[stop]!]!) / 65536);
    rest -= taken;
    frequencies[symbol] = 1 + Math.floor((taken * (PROBABILITIES - SYMBOLS)) / 65536);
    sum += frequencies[symbol]!;
    largest = frequencies[symbol]! > frequencies[largest]! ? symbol : largest;
  }
  frequencies[largest]! += PROBABILITIES - sum;
  for (let pair = 0, start = 0; pair < TABLE_WORDS; pair++) {
    const split = start + frequencies[2 * pair]!;
    out[pair] = start + split * 65536;
    start = split + frequencies[2 * pair + 1]!;
  }
}

/** Steps of the coefficients of a plane. */
function writeSteps(units: number, slope: number, plane: number, fraction: number, out: Uint32Array): void {
  const shift = 2 ** (25 - (fraction + 4) + 3 * plane);
  for (let at = 0; at < COEFFICIENTS; at++) {
    const weight = 4096 + (plane === 0 ? slope * RADII[at]! : 0);
    const scale = (SCALES[at % SIDE]! * SCALES[at >> 3]!) >> 12;
    const scaled = Math.floor((units * weight) / 4096) * scale;
    out[at] = Math.min(2 ** 24 - 1, Math.max(1, Math.floor((scaled + shift / 2) / shift)));
  }
}

/** First byte of the streams of a superblock. */
export function startOf(index: Uint32Array, width: number, number: number): number {
  const first = Math.floor(number / GROUP);
  let start = index[first * (width + 1)] ?? 0;
  for (let before = first * GROUP; before < number; before++) {
    start += lengthOf(index, width, before);
  }
  return start;
}

/** Bytes of the stream of a superblock, by an index with lengths of `width` bits. */
export function lengthOf(index: Uint32Array, width: number, number: number): number {
  const bit = (number % GROUP) * width, low = bit & 31;
  const at = Math.floor(number / GROUP) * (width + 1) + 1 + (bit >> 5);
  const word = ((index[at] ?? 0) >>> low) | ((index[at + 1] ?? 0) << 1 << (31 - low));
  return word & (2 ** width - 1);
}

/** A texture that is read but for the streams of its finest plane. */
interface Stage {
  blocks: Blocks;
  /** Streams of the bases. */
  base: Uint8Array;
  /** Bytes of the streams of plane 0. */
  detailBytes: number;
}

function readGroup(reader: Reader, ranks: number[], channels: Channel[], shift: number): void {
  const count = reader.u8();
  reader.check(count >= 1 && count <= MAX_GROUP, "a group of none or more than four channels");
  const firstAxis = channels.length;
  const means = Array.from({ length: count }, () => reader.u16());
  for (let channel = 0; channel < count; channel++) {
    const weights = [0, 0, 0, 0];
    for (let axis = 0; axis < count; axis++) {
      weights[axis] = reader.i16();
      reader.check(Math.abs(weights[axis]!) <= 1 << AXIS_BITS, "an axis longer than one");
    }
    channels.push({ mean: ((means[channel]! << shift) + (1 << (shift - 1))) | 0, firstAxis, weights });
    ranks.push(channel);
  }
}

/** Writes the words of an index: for each 32 superblocks the first one's place, and their lengths; the end of the last one. */
function unpackIndex(bytes: Uint8Array, bits: number, total: number, out: Uint32Array): number {
  let start = 0;
  for (let number = 0; number < total; number++) {
    let length = 0;
    for (let at = 0; at < bits; at++) {
      const bit = number * bits + at;
      length |= ((bytes[bit >> 3]! >> (bit & 7)) & 1) << at;
    }
    const group = Math.floor(number / GROUP) * (bits + 1), inGroup = number % GROUP;
    if (inGroup === 0) {
      out[group] = start;
    }
    for (let at = 0; at < bits; at++) {
      const bit = inGroup * bits + at;
      out[group + 1 + (bit >> 5)]! |= ((length >> at) & 1) << (bit & 31);
    }
    start += length;
  }
  return start;
}

/** Reads header, index, tables and the streams of the bases; `place` is the part of an image that it is. */
export function readStage(reader: Reader, budget: Budget, place: { image: number; level: number; levels: number }, pixel: PixelInfo): Stage {
  const first = reader.at;
  const version = reader.u8();
  reader.check(version >= 1 && version <= 64, "a layout of blocks that this reader does not know");
  const parts = version - 1, isDeblocked = (parts & 1) > 0, fromPreset = (parts & 2) > 0, isPacked = (parts & 4) > 0, isDependent = (parts & 8) > 0;
  const hasSmallBases = (parts & 16) > 0, hasModes = (parts & 32) > 0;
  const size = { width: reader.u16() + 1, height: reader.u16() + 1 };
  const depth = reader.u8(), superblockLog2 = reader.u8();
  reader.check(depth === 8 || depth === 16, "samples of neither 8 nor 16 bits");
  reader.check(superblockLog2 >= 4 && superblockLog2 <= 6, "superblocks of another side than 16, 32 or 64");
  reader.check(!hasSmallBases || superblockLog2 > BASE_LOG2, "a layout of bases that no writer writes");
  const baseLog2 = hasSmallBases ? BASE_LOG2 : superblockLog2;
  const step = reader.u16(), slope = reader.u8();
  const offsets: [number, number] = [reader.u8(), reader.u8()];
  reader.check(step <= MAX_STEP && Math.max(...offsets) <= 16, "a quantiser beyond the largest");
  const none = reader.bytes(hasModes ? MODE_TABLES : 0);
  reader.check(none.every((stop) => isDependent && stop < STOP.length), "intra modes that no writer writes");
  const strength = isDeblocked ? reader.u8() : 0;
  reader.check(!isDeblocked || (strength >= 1 && strength <= 3), "a strength of deblocking that no writer writes");
  const fraction = depth > 8 ? 2 : 6, shift = fraction + AXIS_BITS;
  const ranks: number[] = [], channels: Channel[] = [];
  for (let groups = reader.u8(); groups > 0; groups--) {
    readGroup(reader, ranks, channels, shift);
    reader.check(ranks.length <= MAX_AXES, "more than 16 channels");
  }
  reader.check(ranks.length > 0, "no channels");
  budget.texels(size.width * size.height);
  const indexBits = reader.u8();
  reader.check(indexBits <= 24, "lengths of more than 24 bits");
  const tableBytes = reader.u16(), streamBytes = reader.u32();

  const planes = planesOf(size);
  const counts = superblockCounts({ size, superblockLog2, baseLog2 }).map(([columns, rows]) => columns * rows);
  const total = counts.reduce((sum, count) => sum + count, 0);
  // The last group of a packed index ends with its last length.
  const rest = isPacked ? total % GROUP : 0;
  const indexWords = Math.ceil((total - rest) / GROUP) * (indexBits + 1) + (rest > 0 ? 1 + Math.ceil((rest * indexBits) / 32) : 0);
  const modeWords = WORDS.length + tableCount(isDependent) * TABLE_WORDS, steps = WORDS.length + allTables({ isDependent, hasModes }) * TABLE_WORDS, index = steps + planes.length * COEFFICIENTS;
  budget.take(4 * (index + indexWords + 2));
  const stored = reader.bytes(isPacked ? Math.ceil((total * indexBits) / 8) : 4 * indexWords);
  const words = new Uint32Array(index + indexWords + 2);
  words.set(WORDS);
  if (isPacked) {
    const end = unpackIndex(stored, indexBits, total, words.subarray(index));
    reader.check(end < 2 ** 32, "superblocks of more than 4 GiB");
  } else {
    new Uint8Array(words.buffer, 4 * index).set(stored);
  }
  reader.check(tablesOf(reader.bytes(tableBytes), fromPreset, isDependent, words.subarray(WORDS.length, modeWords)), "tables of probabilities that no writer writes");
  none.forEach((stop, table) => writeTable(Uint8Array.of(stop, ...MODE_STOPS), words.subarray(modeWords + table * TABLE_WORDS)));
  const units = (256 + (step % 256)) * 2 ** Math.floor(step / 256);
  planes.forEach((_, plane) => {
    const start = steps + plane * COEFFICIENTS;
    writeSteps(units, slope, plane, fraction, words.subarray(start, start + COEFFICIENTS));
  });
  const headBytes = reader.at - first;
  const baseBytes = Math.min(startOf(words.subarray(index), indexBits, total - counts[0]!), streamBytes);
  const base = reader.bytes(baseBytes);
  const deblocking = Math.floor((strength * units * 2 ** fraction) / 2 ** 14);
  const layout = {
    size, depth, superblockLog2, baseLog2, ranks, channels, shift, offsets, isDependent, hasModes, steps, index, indexBits, streamBytes: baseBytes, deblocking,
    isLight: pixel.colour === "srgb",
    isWeighted: pixel.channels % 2 === 0 && pixel.alpha !== "band",
  };
  const blocks: Blocks = { layout, words, streams: base, headBytes, ...place, row: 0 };
  return { blocks, base, detailBytes: streamBytes - baseBytes };
}

/** Images of a layout in blocks, from the sections of that number: what is loaded, and layers of those that there are. */
export function readBlocks(file: Sections, number: number, layout: Layout, budget: Budget): { blocks: Blocks[]; layers: [number, number] } {
  const reader = file.read(`RBB${number}`), detailId = `RBD${number}`;
  const stages = layout.images.flatMap((size, image) => {
    const all = Math.min(layout.levels, fullLevels(size));
    const count = Math.ceil(all / STAGE_LEVELS), pixels = pixelsOf(layout, image);
    return Array.from({ length: count }, (_, stage) => {
      const level = stage * STAGE_LEVELS, wanted = atLevel(size, level);
      const levels = Math.min(all - level, STAGE_LEVELS);
      const found = readStage(reader, budget, { image, level, levels }, pixels);
      const { size: is, depth, ranks } = found.blocks.layout;
      const fits = is.width === wanted.width && is.height === wanted.height && depth === pixels.depth && ranks.length === pixels.channels;
      reader.check(fits, "an image of another size, depth or number of channels");
      return found;
    });
  });
  reader.end();
  const hasDetail = stages.some((stage) => stage.detailBytes > 0);
  const total = hasDetail ? 2 : 1;
  if (!hasDetail && file.names(detailId)) {
    throw corrupt(detailId, 0, "superblocks of an image that has none");
  }
  const isLoaded = hasDetail && file.has(detailId);
  if (isLoaded) {
    const detail = file.read(detailId);
    for (const { blocks, base, detailBytes } of stages) {
      const more = detail.bytes(detailBytes);
      budget.take(base.length + detailBytes);
      blocks.streams = new Uint8Array(base.length + detailBytes);
      blocks.streams.set(base);
      blocks.streams.set(more, base.length);
      blocks.layout.streamBytes = blocks.streams.length;
    }
    detail.end();
  }
  return { blocks: stages.map((stage) => stage.blocks), layers: [isLoaded ? total : 1, total] };
}

/** As `readBlocks` of a codec without layers: the second layer must be there. */
export function readWholeBlocks(file: Sections, number: number, layout: Layout, budget: Budget): Blocks[] {
  const { blocks, layers } = readBlocks(file, number, layout, budget);
  if (layers[0] < layers[1]) {
    throw truncated(`RBD${number}`);
  }
  return blocks;
}

/** The form of images whose texels are plain ones of four channels: decoded from blocks, or given as they are. */
export function plainForm(layout: Pick<Layout, "images" | "levels">, blocks: Blocks[]): Form {
  const uniforms = new Uniforms();
  const { swizzle } = formatsOf("raw", { channels: 4, colour: "srgb" });
  const form: Form = { module: "bc", planes: [], uniforms: new Uint8Array(0), images: [], blocks };
  layout.images.forEach(({ width, height }, image) => {
    const range = uniforms.add(width, height, width, height, layout.levels, CLAMP, swizzle, 0);
    form.images.push({ planes: [image, image], uniforms: range, image: 0 });
  });
  form.uniforms = uniforms.bytes();
  return form;
}

export const dct: Codec = images((file, layout, budget) => {
  const maps = readMaps(file, layout);
  if (maps !== undefined) {
    layout.maps = maps;
  }
  const { blocks, layers } = readBlocks(file, 0, layout, budget);
  return { form: plainForm(layout, blocks), layers };
});
