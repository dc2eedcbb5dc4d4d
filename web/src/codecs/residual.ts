// Residual content: images as a reduced base and a residual plane. FORMAT.md, section of that name; crates/residual.

import { atLevel, fullLevels, type Layout, MAX_PLANE_SIDE, type Sections, type Size } from "../container.js";
import { type Budget, corrupt, truncated } from "../errors.js";
import { floatBits, type Plane } from "../form.js";
import type { Reader } from "../reader.js";
import { type Content, fits, formatsOf, readContent, readPlanes, withLevels } from "./content.js";

/** Texels a side of a residual block. */
export const BLOCK_SIDE = 8;
const MAX_REDUCE_LOG2 = 3;
const MAX_SHRINK_LOG2 = 2;
const ISOLATED_FLAG = 16;
const PADDED_FLAG = 32;
/** Texels of level 0 of a padded base beyond each border of the image. */
const PADDING = 4;
/** Coefficients of a cell and most bits of one, by subband. */
const COUNTS = [1, 3, 8, 4, 2, 6, 24];
const MAX_RATES = [5, 5, 5, 5, 5, 2, 3];
const BLOCK_CELLS = 4;
const CLASSES = 16;
/** Blocks that share a word with the place of their bits, and words in front of the bits of such a group. */
const GROUP = 16;
const GROUP_WORDS = 5;
/** Mip levels that the shader's parameters have room for. */
const LEVELS = 16;
/** Bytes of an image beside its texels: parameters and lists of planes. */
const IMAGE_BYTES = 1024;
/** Fewest words in a row of a plane of words, as a binary logarithm. */
const LEAST_ROW_LOG2 = 6;

/** An array of 32-bit words as a texture. */
export interface WordPlane {
  plane: Plane;
  /** Binary logarithm of the words in a row. */
  rowLog2: number;
}

/** A plane of that many words (at least 1), whole rows, all of them 0. */
export function wordPlane(part: string, words: number, budget: Budget): WordPlane {
  let rowLog2 = LEAST_ROW_LOG2;
  while (Math.ceil(words / 2 ** rowLog2) > MAX_PLANE_SIDE) {
    rowLog2++;
  }
  const width = Math.min(words, 2 ** rowLog2), height = Math.ceil(words / width);
  budget.take(4 * width * height);
  return { plane: { part, format: "r32uint", width, height, levels: 1, data: new Uint8Array(4 * width * height) }, rowLog2 };
}

/** Square blocks that cover all levels of an image. */
export function levelBlocks(size: Size, levels: number, side: number): number {
  let blocks = 0;
  for (let level = 0; level < levels; level++) {
    const { width, height } = atLevel(size, level);
    blocks += Math.ceil(width / side) * Math.ceil(height / side);
  }
  return blocks;
}

/** Planes and parameters of one image. */
export interface ResidualImage {
  /** Residual plane, then one or two planes of the base. */
  planes: Plane[];
  uniforms: number[];
}

/** Residual content of a file. */
export interface Residual {
  /** Images and levels that are stored. */
  layout: Layout;
  /** Finest levels that are not stored. */
  shrinkLog2: number;
  images: ResidualImage[];
  /** Layers that are loaded, of those that there are. */
  layers: [number, number];
}

/** Adds the planes of an image; the numbers of those that the shader binds: residual plane, both of the base. */
export function pushResidual({ planes }: ResidualImage, all: Plane[]): [number, number, number] {
  const first = all.length;
  all.push(...planes);
  return [first, first + 1, all.length - 1];
}

/** How the base is stored. */
interface BaseForm {
  content: Content;
  reduceLog2: number;
  shrinkLog2: number;
  isIsolated: boolean;
  padding: number;
  /** Factor of alpha's contrast. */
  alphaGain: number;
}

/** What all blocks share. */
interface Model {
  /** Bits of a block of class 1; 0 without a residual plane. */
  classBits: number;
  /** Weights of subbands in 1/1024. */
  weights: number[];
  /** Bits of coefficients by class, 4 bits a subband. */
  classes: number[];
  axes: number;
}

function readForm(reader: Reader, layout: Layout): BaseForm {
  const content = readContent(reader);
  // Normals of two channels are completed behind the filter, before residuals are added.
  const isNormal = content === "bc5" && layout.channels === 3;
  reader.check(fits(content, layout) && !isNormal, "content that cannot hold the channels");
  const flags = reader.u8();
  const isIsolated = (flags & ISOLATED_FLAG) !== 0, isPadded = (flags & PADDED_FLAG) !== 0;
  const reduceLog2 = flags & 3, shrinkLog2 = (flags >> 2) & 3, alphaGainLog2 = flags >> 6;
  reader.check(reduceLog2 >= 1 && reduceLog2 <= MAX_REDUCE_LOG2, "a log2 downscale of the base outside 1..=3");
  reader.check(!isPadded || !isIsolated, "a base that is padded and block-isolated");
  const isStored = shrinkLog2 <= (isIsolated ? 0 : MAX_SHRINK_LOG2);
  reader.check(isStored, "more than two levels not stored, or any beside a block-isolated base");
  reader.check(alphaGainLog2 === 0 || layout.channels % 2 === 0, "contrast of alpha in an image without");
  return { content, reduceLog2, shrinkLog2, isIsolated, padding: isPadded ? PADDING : 0, alphaGain: 1 << alphaGainLog2 };
}

function readModel(reader: Reader): Model {
  const coding = reader.u8(), isTurned = coding >> 4 === 1, classBits = 16 * (coding & 15);
  reader.check(coding < 32, "a coding of the residual plane that this reader does not know");
  reader.check(classBits <= 32, "more than 32 bits for the first class");
  const weights = COUNTS.map(() => reader.u16());
  const classes = Array.from({ length: CLASSES }, (_, number) => {
    const word = reader.u32();
    const rates = MAX_RATES.map((_, subband) => (word >>> (4 * subband)) & 15);
    const fit = word < 2 ** 28 && rates.every((rate, subband) => rate <= MAX_RATES[subband]!);
    reader.check(fit, "too many bits of a coefficient");
    const bits = BLOCK_CELLS * rates.reduce((sum, rate, subband) => sum + rate * COUNTS[subband]!, 0);
    reader.check(bits === 0 || bits === classBits * number, "a class of another number of bits");
    return word;
  });
  const axes = isTurned ? reader.u32() : 0;
  reader.check(axes < 2 ** 30, "axes with bits that mean nothing");
  reader.end();
  return { classBits, weights, classes, axes };
}

/** The base of one image: its planes with all their mip levels. */
function readBase(reader: Reader, form: BaseForm, layout: Layout, { width, height }: Size): Plane[] {
  const { formats } = formatsOf(form.content, layout);
  const more = 2 * form.padding * 2 ** form.reduceLog2;
  const size = atLevel({ width: width + more, height: height + more }, form.reduceLog2);
  // Further levels of the image read the last.
  const levels = Math.min(layout.levels, fullLevels(atLevel({ width, height }, form.reduceLog2)));
  return withLevels(Array.from({ length: levels }, (_, level) => {
    const at = atLevel(size, level);
    return readPlanes(reader, "base", formats, at.width, at.height);
  }));
}

/** `count` numbers of 4 bits, two a byte. */
function readNibbles(reader: Reader, count: number): Uint8Array {
  const bytes = reader.bytes(Math.ceil(count / 2));
  reader.check(count % 2 === 0 || bytes[bytes.length - 1]! < 16, "bits after the last number");
  return bytes;
}

interface Words extends WordPlane {
  /** First bit of the blocks' bits. */
  firstBit: number;
}

/** Residual plane of an image of so many blocks. */
function readPlane(reader: Reader, blocks: number, { classBits, classes }: Model, budget: Budget): Words {
  const groups = Math.ceil(blocks / GROUP);
  const numbers = readNibbles(reader, blocks);
  // First half word of each group's bits, then the end of the last.
  budget.take(8 * (groups + 1));
  const starts = new Float64Array(groups + 1);
  let halves = 0, isAllowed = true;
  for (let block = 0; block < blocks; block++) {
    const number = (numbers[block >> 1]! >> (4 * (block & 1))) & 15;
    isAllowed &&= number === 0 || classes[number] !== 0;
    halves += (number * classBits) / 16;
    starts[(block >> 4) + 1] = halves;
  }
  reader.check(isAllowed, "a block of a class that has no bits");
  const scales = readNibbles(reader, blocks);
  const bits = reader.bytes(2 * halves);
  const heads = groups * GROUP_WORDS, words = heads + Math.ceil(halves / 2);
  reader.check(words <= MAX_PLANE_SIDE ** 2, "a residual plane larger than a plane");
  const { plane, rowLog2 } = wordPlane("residual plane", words, budget);
  const view = new DataView(plane.data.buffer);
  for (let group = 0; group < groups; group++) {
    const at = 4 * GROUP_WORDS * group, half = GROUP / 2;
    view.setUint32(at, starts[group]!, true);
    plane.data.set(numbers.subarray(group * half, (group + 1) * half), at + 4);
    plane.data.set(scales.subarray(group * half, (group + 1) * half), at + 4 + half);
  }
  plane.data.set(bits, 4 * heads);
  return { plane, rowLog2, firstBit: 32 * heads };
}

/** Residual planes of all images; nothing where they are not there. */
function readRest(file: Sections, id: string, layout: Layout, model: Model, budget: Budget): Words[] | undefined {
  if (file.names(id) && model.classBits === 0) {
    throw corrupt(id, 0, "a residual plane that the form does not name");
  }
  if (!file.has(id)) {
    return undefined;
  }
  const reader = file.read(id);
  const planes = layout.images.map((size) => readPlane(reader, levelBlocks(size, layout.levels, BLOCK_SIDE), model, budget));
  reader.end();
  return planes;
}

/** Residual content of that number, of images of the layout; its planes where the file has brought them. */
export function readResidual(file: Sections, number: number, full: Layout, budget: Budget): Residual {
  const head = file.read(`RSF${number}`);
  const form = readForm(head, full), model = readModel(head);
  const { reduceLog2, shrinkLog2, padding, alphaGain } = form;
  budget.take(full.images.length * IMAGE_BYTES);
  const images = full.images.map((size) => atLevel(size, shrinkLog2));
  const layout: Layout = { ...full, images, levels: Math.max(1, full.levels - shrinkLog2) };
  const reader = file.read(`RSB${number}`);
  budget.take(reader.data.length);
  const bases = images.map((size) => readBase(reader, form, layout, size));
  reader.end();
  const rest = readRest(file, `RSP${number}`, layout, model, budget);

  const { swizzle } = formatsOf(form.content, full);
  const total = model.classBits > 0 ? 2 : 1;
  const found = images.map((size, image): ResidualImage => {
    const base = bases[image]!, { width, height, levels } = base[0]!;
    const { plane, rowLog2, firstBit } = rest?.[image] ?? { ...wordPlane("residual plane", 1, budget), firstBit: 0 };
    const uniforms = [
      size.width, size.height, width, height, swizzle, rest ? model.classBits : 0, rowLog2, firstBit,
      levels, form.isIsolated ? BLOCK_SIDE >> reduceLog2 : 0, padding, model.axes,
      ...Array.from({ length: LEVELS }, (_, level) => (level < layout.levels ? levelBlocks(size, level, BLOCK_SIDE) : 0)),
      ...model.classes,
      ...model.weights.map((weight) => floatBits(weight / 1024)),
      floatBits(alphaGain),
    ];
    return { planes: [plane, ...base], uniforms };
  });
  return { layout, shrinkLog2, images: found, layers: [rest ? total : 1, total] };
}

/** As `readResidual` of a codec without layers: the residual plane must be there. */
export function readWholeResidual(file: Sections, number: number, full: Layout, budget: Budget): Residual {
  const residual = readResidual(file, number, full, budget);
  if (residual.layers[0] < residual.layers[1]) {
    throw truncated(`RSP${number}`);
  }
  return residual;
}
