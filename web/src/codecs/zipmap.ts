// Zoom stacks: a root, and patches of higher resolution over it. FORMAT.md, "zipmap"; crates/zipmap.

import { atLevel, fullLevels, type Layout, MAX_PLANE_SIDE, type Sections, type Size } from "../container.js";
import { type Budget, corrupt } from "../errors.js";
import { floatBits, type Form, FORMATS, type Plane, planeBytes, type PlaneFormat, Uniforms } from "../form.js";
import type { Reader } from "../reader.js";
import { CLAMP, type Content, fits, formatsOf, readContent, readPlanes, RGBA, withLevels } from "./content.js";
import { type Codec, images } from "./codec.js";
import { readWholeBlocks } from "./dct.js";

const MAX_PATCHES = 2048;
const MAX_PATCH_LEVELS = 12;
/** Texels that the places of patches in blocks are multiples of. */
const BLOCK_SIDE = 8;
/** Stands for a content where texels are in blocks of variable length, and each level of patch images is stored. */
const IN_BLOCKS = 255;
/** The same where two of three levels of patch images are means of the one before them. */
const WITH_MEANS = IN_BLOCKS - 1;
/** Most mip levels that blocks give. */
const BLOCK_LEVELS = 3;
/** Bits of a column in the plane of all patch images; above it stands the mip level of that plane. */
const COLUMN_BITS = 13;
/** Words of a texel of the table. */
const TEXEL = 4;
/** Words of the table that describe a patch. */
const RECORD = 8 * TEXEL;
/** Texels in a row of the table, as a binary logarithm. */
const ROW_LOG2 = 8;
const TILES_PER_PATCH = 64;
/** Most tiles a side. */
const MAX_TILES = 128;
/** Most tiles times patches. */
const MAX_NAMES = 1 << 22;
/** By how much of a tile a patch may miss it and is yet named. */
const TILE_MARGIN = 0.01;
/** Least share of a matrix's length for a last element that is not the horizon. */
const LEAST_LAST = 1e-9;
/** Share of the third coordinate at a rectangle's middle below which a place is too near to the horizon. */
const HORIZON_SHARE = 1e-3;
const TINY = 1e-300;
const ROOT = "root";
const PATCHES = "patches";

type Point = readonly [number, number, number];
/** Columns. */
type Matrix = readonly [Point, Point, Point];

/** A patch image: its finest size, and its mip levels. */
interface PatchImage extends Size {
  levels: number;
}

interface Patch {
  /** Number of its patch image. */
  content: number;
  /** From the root's texture coordinates to its own, row by row. */
  rows: number[];
}

/** What stands before the texels. */
interface Header {
  /** Contents of the root and of patch images; null where they are in blocks. */
  contents: [Content, Content] | null;
  /** Mip levels of the plane of all patch images. */
  mips: number;
  root: PatchImage;
  images: PatchImage[];
  patches: Patch[];
}

/** Places of the levels of patch images in a plane of `mips` mip levels. */
interface Packing extends Size {
  mips: number;
  /** Column and row of each level of each image, in mip level `level % mips`. */
  origins: [number, number][][];
}

/** The larger of two numbers; the other one where one is NaN. */
const larger = (a: number, b: number): number => (a > b || Number.isNaN(b) ? a : b);
const roundUp = (value: number, step: number): number => Math.ceil(value / step) * step;
const dot = (a: Point, b: Point): number => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a: Point, b: Point): Point => [a[1] * b[2] - b[1] * a[2], a[2] * b[0] - b[2] * a[0], a[0] * b[1] - b[0] * a[1]];
const scaled = (matrix: Matrix, by: number): Matrix => {
  const scale = ([x, y, z]: Point): Point => [x * by, y * by, z * by];
  return [scale(matrix[0]), scale(matrix[1]), scale(matrix[2])];
};
const transposed = ([a, b, c]: Matrix): Matrix => [[a[0], b[0], c[0]], [a[1], b[1], c[1]], [a[2], b[2], c[2]]];
const times = ([a, b, c]: Matrix, [x, y, z]: Point): Point => [
  a[0] * x + b[0] * y + c[0] * z,
  a[1] * x + b[1] * y + c[1] * z,
  a[2] * x + b[2] * y + c[2] * z,
];

/** The same homography with a last element of 1, or of length 1 where that is 0. */
function normalised(matrix: Matrix): Matrix {
  const last = matrix[2][2];
  const length = Math.sqrt(matrix.flat().reduce((sum, value) => sum + value * value, 0));
  return scaled(matrix, 1 / (Math.abs(last) > LEAST_LAST * length ? last : larger(length, TINY)));
}

/** Cuts a polygon of homogeneous points to where `side` is not negative. */
function clip(polygon: Point[], side: (point: Point) => number): Point[] {
  const kept: Point[] = [];
  for (let i = 0; i < polygon.length; i++) {
    const point = polygon[i]!, next = polygon[i + 1 < polygon.length ? i + 1 : 0]!;
    const here = side(point), there = side(next);
    if (here >= 0) {
      kept.push(point);
    }
    if (here >= 0 !== there >= 0) {
      const share = here / (here - there);
      kept.push([point[0] + (next[0] - point[0]) * share, point[1] + (next[1] - point[1]) * share, point[2] + (next[2] - point[2]) * share]);
    }
  }
  return kept;
}

/**
 * Cuts a polygon, x and y of `count` corners, to where a coordinate is at least 0, or at most `most`; the number of corners
 * that stay, which `to` holds.
 */
function cut(from: number[], count: number, to: number[], axis: number, most?: number): number {
  const side = (corner: number): number => (most === undefined ? from[2 * corner + axis]! : most - from[2 * corner + axis]!);
  let kept = 0;
  for (let i = 0; i < count; i++) {
    const next = i + 1 < count ? i + 1 : 0, here = side(i), there = side(next);
    const x = from[2 * i]!, y = from[2 * i + 1]!;
    if (here >= 0) {
      to[2 * kept] = x;
      to[2 * kept++ + 1] = y;
    }
    if (here >= 0 !== there >= 0) {
      const share = here / (here - there);
      to[2 * kept] = x + (from[2 * next]! - x) * share;
      to[2 * kept++ + 1] = y + (from[2 * next + 1]! - y) * share;
    }
  }
  return kept;
}

/** Corners of a polygon that is cut, for all tiles. */
const corners: number[] = [], others: number[] = [];

/** A patch as seen from the root. */
class Outline {
  /** x and y of its corners in the root's texture coordinates. */
  private readonly polygon: number[];
  /** From texels of the root to texels of the patch, column by column. */
  private readonly texels: number[];
  private readonly left: number;
  private readonly top: number;
  private readonly right: number;
  private readonly bottom: number;

  constructor(rows: number[], { width, height }: Size, private readonly root: Size) {
    const columns = [0, 1, 2].map((column): Point => [rows[column]!, rows[column + 3]!, rows[column + 6]!]);
    const [x, y, z] = columns as [Point, Point, Point];
    const across = cross(y, z);
    const inverse = transposed(scaled([across, cross(z, x), cross(x, y)], 1 / dot(x, across)));
    this.polygon = inverse.flat().every(Number.isFinite) ? Outline.seen(normalised(inverse)) : [];
    const us = this.polygon.filter((_, i) => i % 2 === 0), vs = this.polygon.filter((_, i) => i % 2 === 1);
    [this.left, this.top, this.right, this.bottom] = [Math.min(...us), Math.min(...vs), Math.max(...us), Math.max(...vs)];
    const own = (column: Point, by: number): number[] => [width * column[0] * by, height * column[1] * by, column[2] * by];
    this.texels = [...own(x, 1 / root.width), ...own(y, 1 / root.height), ...own(z, 1)];
  }

  /** What of the unit square a homography leads into the unit square. */
  private static seen(matrix: Matrix): number[] {
    const middle = times(matrix, [0.5, 0.5, 1])[2];
    const front = middle < 0 ? scaled(matrix, -1) : matrix;
    const least = HORIZON_SHARE * larger(Math.abs(middle), TINY);
    let polygon = ([[0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]] as const).map((corner) => times(front, corner));
    const sides: ((point: Point) => number)[] = [([, , z]) => z - least, ([x]) => x, ([, y]) => y, ([x, , z]) => z - x, ([, y, z]) => z - y];
    for (const side of sides) {
      polygon = clip(polygon, side);
    }
    return polygon.map(([x, y, z]) => [x / z, y / z]).filter((point) => point.every(Number.isFinite)).flat();
  }

  /**
   * The square of the most texels of the patch along a texel of the root, where it shares the square of `side` with the
   * upper left corner (`left`, `top`); undefined where it shares none.
   */
  fineness(left: number, top: number, side: number): number | undefined {
    if (this.left > left + side || this.top > top + side || this.right < left || this.bottom < top) {
      return undefined;
    }
    for (let i = 0; i < this.polygon.length; i += 2) {
      corners[i] = this.polygon[i]! - left;
      corners[i + 1] = this.polygon[i + 1]! - top;
    }
    let count = cut(corners, this.polygon.length / 2, others, 0);
    count = cut(others, count, corners, 1);
    count = cut(corners, count, others, 0, side);
    count = cut(others, count, corners, 1, side);
    let most: number | undefined;
    for (let i = 0; i < count; i++) {
      const value = this.scale((corners[2 * i]! + left) * this.root.width, (corners[2 * i + 1]! + top) * this.root.height);
      most = most === undefined ? value : larger(most, value);
    }
    return most;
  }

  /** The square of the most texels along a texel of the root at a place. */
  private scale(x: number, y: number): number {
    const m = this.texels, ax = m[0]!, ay = m[1]!, az = m[2]!, bx = m[3]!, by = m[4]!, bz = m[5]!;
    const z = az * x + bz * y + m[8]!;
    const u = (ax * x + bx * y + m[6]!) / z, v = (ay * x + by * y + m[7]!) / z;
    const acrossU = (ax - u * az) / z, acrossV = (ay - v * az) / z;
    const downU = (bx - u * bz) / z, downV = (by - v * bz) / z;
    // The larger of the two eigenvalues of the derivative's product with its transpose.
    const trace = acrossU * acrossU + acrossV * acrossV + (downU * downU + downV * downV);
    const det = acrossU * downV - acrossV * downU;
    return 0.5 * (trace + Math.sqrt(larger(trace * trace - 4 * det * det, 0)));
  }
}

function tilesASide(patches: number): number {
  const wanted = Math.ceil(Math.sqrt(TILES_PER_PATCH * patches));
  const most = Math.floor(Math.sqrt(Math.floor(MAX_NAMES / Math.max(1, patches))));
  const log2 = Math.min(32 - Math.clz32(Math.max(1, wanted) - 1), 31 - Math.clz32(most));
  return Math.min(2 ** log2, MAX_TILES);
}

function fill(words: number[], multiple: number): void {
  while (words.length % multiple > 0) {
    words.push(0);
  }
}

/** For each tile how many patches touch it and where its list begins, then the lists, each once: how fine they are, the uppermost first. */
function directory(outlines: Outline[], tiles: number): number[] {
  const words = new Array<number>(roundUp(tiles ** 2, TEXEL)).fill(0);
  const known = new Map<string, number>();
  const side = (1 + 2 * TILE_MARGIN) / tiles;
  for (let tile = 0; tile < tiles ** 2; tile++) {
    const left = ((tile % tiles) - TILE_MARGIN) / tiles, top = (Math.floor(tile / tiles) - TILE_MARGIN) / tiles;
    const list: number[] = [];
    let finest = 1;
    for (let patch = outlines.length - 1; patch >= 0; patch--) {
      const found = outlines[patch]!.fineness(left, top, side);
      if (found !== undefined) {
        list.push(patch);
        finest = larger(finest, found);
      }
    }
    // The next of the powers of the fourth root of two, a little less.
    const bits = floatBits(2 ** (Math.ceil(4 * Math.log2(finest) - 1e-3) / 4) * (1 - 1e-5));
    const key = String.fromCharCode(bits & 65535, bits >>> 16, ...list);
    let start = known.get(key);
    if (start === undefined) {
      start = words.length / TEXEL;
      known.set(key, start);
      words.push(bits);
      for (let i = 0; i < list.length; i += 2) {
        words.push(list[i]! | ((list[i + 1] ?? 0) << 16));
      }
      fill(words, TEXEL);
    }
    words[tile] = (list.length << 20) | start;
  }
  return words;
}

/**
 * Lays the levels of patch images into a plane of `mips` mip levels: rows of rectangles of falling height, sides padded to multiples of
 * `step`.
 */
function pack(images: PatchImage[], step: number, mips: number): Packing {
  const all = images.flatMap((image, index) =>
    Array.from({ length: Math.ceil(image.levels / mips) }, (_, stored) => {
      const { width, height } = atLevel(image, stored * mips);
      return { index, width: roundUp(width, step), height: roundUp(height, step) };
    }),
  );
  // Stable: equal heights stay in the order of images and levels.
  all.sort((a, b) => b.height - a.height);
  const area = all.reduce((sum, { width, height }) => sum + width * height, 0);
  const widest = all.reduce((most, { width }) => Math.max(most, width), 0) || step;
  const square = roundUp(Math.ceil(Math.sqrt(area)), step);
  let best: Packing | null = null;
  for (let i = 0; i <= 8; i++) {
    const limit = i < 8 ? roundUp(square + Math.floor((square * i) / 16), step) : MAX_PLANE_SIDE;
    if (limit < widest || limit > MAX_PLANE_SIDE) {
      continue;
    }
    const origins: [number, number][][] = images.map(() => []);
    let x = 0, y = 0, row = 0, used = step;
    for (const { index, width, height } of all) {
      if (x + width > limit) {
        y += row;
        x = row = 0;
      }
      // Levels of an image come in their order: none is higher than the one before.
      const places = origins[index]!, count = Math.min(mips, images[index]!.levels - places.length);
      for (let mip = 0; mip < count; mip++) {
        places.push([x >> mip, y >> mip]);
      }
      x += width;
      row = Math.max(row, height);
      used = Math.max(used, x);
    }
    const height = Math.max(y + row, step);
    if (height <= MAX_PLANE_SIDE && (!best || used * height < best.width * best.height)) {
      best = { origins, mips, width: used, height };
    }
  }
  if (!best) {
    throw corrupt("ZMFM", 0, "patches that fill more than a plane");
  }
  return best;
}

/** Pixels of patches: those of the root, with alpha. */
function patchLayout(layout: Layout, size: Size): Layout {
  return { ...layout, images: [size], levels: 1, channels: layout.channels < 3 ? 2 : 4, alpha: "straight" };
}

/** Sizes and levels of patch images, and the patches. */
function readPatches(head: Reader): { images: PatchImage[]; patches: Patch[] } {
  const imageCount = head.u16(), count = head.u16();
  head.check(count <= MAX_PATCHES, "more than 2048 patches");
  head.check(imageCount <= count, "more contents than patches");
  const images = Array.from({ length: imageCount }, () => {
    const image = { width: head.u16(), height: head.u16(), levels: head.u8() };
    const isSide = (side: number): boolean => side >= 1 && side <= MAX_PLANE_SIDE;
    head.check(isSide(image.width) && isSide(image.height), "a patch of another size than 1 to 8192");
    const most = Math.min(MAX_PATCH_LEVELS, fullLevels(image));
    head.check(image.levels >= 1 && image.levels <= most, "a patch with too many levels or none");
    return image;
  });
  const patches = Array.from({ length: count }, () => {
    const content = head.u16();
    head.check(content < imageCount, "a patch of a content that is not there");
    return { content, rows: Array.from({ length: 9 }, () => head.f32()) };
  });
  head.end();
  return { images, patches };
}

function readHeader(file: Sections, layout: Layout): Header {
  const head = file.read("ZMFM");
  const first = head.data[0], isBlocks = first === head.data[1] && (first === IN_BLOCKS || first === WITH_MEANS);
  head.at += isBlocks ? 2 : 0;
  const contents: Header["contents"] = isBlocks ? null : [readContent(head), readContent(head)];
  const deep = head.u8(), size = layout.images[0]!;
  head.check(layout.images.length === 1, "more than one image");
  const isExact = deep < 16 && (size.width | size.height) % (1 << deep) === 0;
  head.check(isExact && layout.levels > deep, "levels that do not lead to a root");
  const root = { ...atLevel(size, deep), levels: layout.levels - deep };
  const unfit = "a root that cannot be stored so";
  head.check(root.levels <= fullLevels(root) && Math.max(root.width, root.height) <= MAX_PLANE_SIDE, unfit);
  const { images, patches } = readPatches(head);
  if (contents) {
    const [ofRoot, ofImages] = contents;
    head.check(fits(ofRoot, layout) && (ofRoot !== "bc5" || layout.channels === 2), unfit);
    const pixel = patchLayout(layout, size);
    const allowed: Content[] = pixel.channels === 4 ? ["raw", "bc3", "bc7"] : ["raw", "bc5"];
    head.check(images.length === 0 || allowed.includes(ofImages), "content without soft alpha for patches");
  }
  const mips = first === WITH_MEANS ? images.reduce((most, { levels }) => Math.max(most, Math.min(levels, BLOCK_LEVELS)), 1) : 1;
  return { contents, mips, root, images, patches };
}

/** The levels of an image of planes, not copied. */
function readLevels(reader: Reader, part: string, formats: PlaneFormat[], image: PatchImage): Plane[][] {
  return Array.from({ length: image.levels }, (_, level) => {
    const { width, height } = atLevel(image, level);
    return readPlanes(reader, part, formats, width, height);
  });
}

/** The plane of all patches, from the levels of each of their images. */
function patchPlane(images: Plane[][], format: PlaneFormat, { width, height, origins }: Packing, budget: Budget): Plane {
  const [block, side] = FORMATS[format];
  budget.take(planeBytes(format, width, height));
  const data = new Uint8Array(planeBytes(format, width, height));
  images.forEach((levels, image) =>
    levels.forEach((level, number) => {
      const [x, y] = origins[image]![number]!;
      const run = Math.ceil(level.width / side) * block, rows = level.data.length / run;
      for (let row = 0; row < rows; row++) {
        const start = (((y / side + row) * width) / side + x / side) * block;
        data.set(level.data.subarray(row * run, (row + 1) * run), start);
      }
    }),
  );
  return { part: PATCHES, format, width, height, levels: 1, data };
}

/** Adds the planes of root and patches; where the patches lie, and how texels of the two are read. */
function addPlanes(file: Sections, header: Header, contents: Content[], layout: Layout, budget: Budget, form: Form): [Packing, number[]] {
  const pixels = [layout, patchLayout(layout, header.root)];
  const [root, patches] = contents.map((content, number) => formatsOf(content, pixels[number]!));
  const ofRoot = file.read("ZMRT");
  form.planes.push(...withLevels(readLevels(ofRoot, ROOT, root!.formats, header.root)));
  ofRoot.end();
  let images: Plane[][] = [];
  if (header.images.length > 0) {
    const ofImages = file.read("ZMPA");
    images = header.images.map((image) => readLevels(ofImages, PATCHES, patches!.formats, image).flat());
    ofImages.end();
  }
  const packing = pack(header.images, 4, 1), hasPatches = images.length > 0;
  form.planes.push(patchPlane(images, hasPatches ? patches!.formats[0]! : "rgba8unorm", packing, budget));
  return [packing, [root!.swizzle, hasPatches ? patches!.swizzle : 0]];
}

/** Adds the blocks of root and patches; where the patches lie. */
function addBlocks(file: Sections, { root, images, mips }: Header, layout: Layout, budget: Budget, form: Form): Packing {
  form.blocks.push(...readWholeBlocks(file, 0, { ...layout, images: [root], levels: root.levels }, budget));
  const packing = pack(images, BLOCK_SIDE, mips);
  if (images.length > 0) {
    const [blocks] = readWholeBlocks(file, 1, { ...patchLayout(layout, packing), levels: mips }, budget);
    form.blocks.push({ ...blocks!, image: 1 });
  }
  return packing;
}

/** The words of a patch: columns of its matrix that lead to texels, sizes, places of all levels. */
function record({ content, rows }: Patch, { width, height, levels }: PatchImage, { origins, mips }: Packing): number[] {
  const places = origins[content]!.map(([x, y], level) => x | ((level % mips) << COLUMN_BITS) | (y << 16));
  const extra = [width | (height << 16), places[0]!, levels | (content << 8)];
  const words = extra.flatMap((word, column) => {
    const [x, y, z] = [rows[column]! * width, rows[column + 3]! * height, rows[column + 6]!];
    return [floatBits(x), floatBits(y), floatBits(z), word];
  });
  words.push(...places);
  fill(words, RECORD);
  return words;
}

export const zipmap: Codec = images((file, layout, budget) => {
  const header = readHeader(file, layout);
  const { root, images, patches } = header;
  const form: Form = { module: "zipmap", planes: [], uniforms: new Uint8Array(0), images: [], blocks: [] };
  const tiles = tilesASide(patches.length);
  const table: Plane = { part: "tiles", format: "rgba32uint", width: 0, height: 0, levels: 1, data: new Uint8Array(0) };
  form.planes.push(table);
  let packing: Packing, swizzles = [RGBA, RGBA], bound: number[];
  if (header.contents) {
    [packing, swizzles] = addPlanes(file, header, header.contents, layout, budget, form);
    const last = form.planes.length - 1;
    bound = [0, 1, last - 1, last];
  } else {
    packing = addBlocks(file, header, layout, budget, form);
    bound = [0, 1, 1, images.length > 0 ? 2 : 1];
  }
  budget.take(4 * TEXEL * (tiles ** 2 * (patches.length / 8 + 3) + (RECORD / TEXEL) * patches.length));
  const outlines = patches.map(({ content, rows }) => new Outline(rows, images[content]!, root));
  const words = directory(outlines, tiles);
  fill(words, RECORD);
  const recordStart = words.length / TEXEL;
  for (const patch of patches) {
    words.push(...record(patch, images[patch.content]!, packing));
  }
  table.width = Math.min(words.length / TEXEL, 1 << ROW_LOG2);
  fill(words, TEXEL * table.width);
  table.height = words.length / TEXEL / table.width;
  table.data = new Uint8Array(Uint32Array.from(words).buffer);
  const uniforms = new Uniforms(), size = layout.images[0]!;
  const sizes = [size.width, size.height, layout.levels, CLAMP, root.width, root.height, root.levels, swizzles[0]!];
  const range = uniforms.add(...sizes, tiles, tiles, recordStart, swizzles[1]!, ROW_LOG2, 0, 0, 0);
  form.uniforms = uniforms.bytes();
  form.images.push({ planes: bound, uniforms: range, image: 0 });
  return { form, layers: [1, 1] };
});
