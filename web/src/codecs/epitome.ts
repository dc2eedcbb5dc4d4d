// Images as maps into one or two epitomes. FORMAT.md, "epitome"; crates/epitome.

import { atLevel, fullLevels, type Layout, MAX_PLANE_SIDE, type Sections, type Size } from "../container.js";
import { type Budget, corrupt } from "../errors.js";
import { type Blocks, type Form, FORMATS, type Plane, planeBytes, Uniforms } from "../form.js";
import { Reader } from "../reader.js";
import { CLAMP, type Content, fits, formatsOf, readContent, readPlanes, RGBA, withLevels } from "./content.js";
import { type Codec, images } from "./codec.js";
import { readWholeBlocks } from "./dct.js";
import { BLOCK_SIDE, pushResidual, readWholeResidual, type Residual, type WordPlane, wordPlane } from "./residual.js";

const FORM_ID = "EPFM";
const MIPS_FLAG = 1;
const ERRORS_FLAG = 2;
const SEAM_FLAG = 4;
const FINER_FLAG = 8;
const BLOCKS_FLAG = 16;
const MAX_BLOCK = 64;
/** Half the usual width of a seam in eighths of a texel. */
const SEAM_WIDTH = 4;
const MAX_ENTRY_BYTES = 6;
const MAX_ENTRIES = 1 << 25;
const MAX_LAYERS = 8;
/** Texels a side of what layers bring. */
const CELL = 4;
/** Mip levels of the image that are read from the epitome. */
const FINE_LEVELS = 3;
const PARTS = ["epitome", "fine epitome"];
/** Bytes of an image beside its texels: parameters and lists of planes. */
const IMAGE_BYTES = 512;

/** How an epitome is stored. */
interface EpitomeForm extends Size {
  content: Content;
}

/** How map and epitomes are stored. */
interface Head {
  /** Texels a side of a block, and of the smallest leaf. */
  block: number;
  cell: number;
  isSplit: boolean;
  xBits: number;
  yBits: number;
  fractionBits: number;
  gainOffsetBits: number;
  matrixBits: number;
  entryBytes: number;
  seamWidth: number;
  epitomes: EpitomeForm[];
  /** Levels of an epitome, 1 or 2. */
  levels: number;
  /** Whether the last epitome has a residual plane. */
  hasErrors: boolean;
  /** Whether the epitome is in blocks of variable length. */
  isInBlocks: boolean;
  /** Whether coarse levels are BC7, the epitome BC1. */
  isFiner: boolean;
  matrices: number;
  gainOffsets: number;
}

function readEpitome(reader: Reader, layout: Layout, levels: number, hasErrors: boolean, isInBlocks: boolean): EpitomeForm {
  const content = readContent(reader);
  const width = reader.u32(), height = reader.u32();
  reader.check(!isInBlocks || content === "raw", "a format of planes for an epitome in blocks");
  const step = (isInBlocks || hasErrors ? BLOCK_SIDE : CELL) * levels;
  const isSide = (side: number): boolean => side % step === 0 && side >= step && side <= MAX_PLANE_SIDE;
  const isWritten = isSide(width) && isSide(height) && fits(content, layout);
  reader.check(isWritten, "an epitome of a size or content that no writer makes");
  return { content, width, height };
}

function readHead(file: Sections, layout: Layout): Head {
  const reader = file.read(FORM_ID);
  const field = (most: number, what: string): number => {
    const value = reader.u8();
    reader.check(value <= most, what);
    return value;
  };
  const block = field(MAX_BLOCK, "a block above 64 texels"), isSplit = field(1, "a flag above 1") === 1;
  const xBits = field(16, "a field above 16 bits"), yBits = field(16, "a field above 16 bits");
  const fractionBits = field(3, "a fraction above 3 bits");
  const gainOffsetBits = field(8, "a field above 8 bits"), matrixBits = field(8, "a field above 8 bits");
  const flags = field(31, "a flag above 31"), has = (flag: number): boolean => (flags & flag) !== 0;
  const hasErrors = has(ERRORS_FLAG), isFiner = has(FINER_FLAG), isInBlocks = has(BLOCKS_FLAG);
  const levels = has(MIPS_FLAG) ? 2 : 1;
  const count = reader.u8();
  reader.check(count === 1 || count === 2, "not one or two epitomes");
  reader.check(!isInBlocks || (count === 1 && !hasErrors && !isFiner), "planes beside an epitome in blocks");
  const bits = xBits + yBits + gainOffsetBits + matrixBits + count - 1, entryBytes = Math.max(2, Math.ceil(bits / 8));
  reader.check(block >= 4 && block % 4 === 0 && entryBytes <= MAX_ENTRY_BYTES, "a map that no writer makes");
  const epitomes: EpitomeForm[] = [];
  while (epitomes.length < count) {
    epitomes.push(readEpitome(reader, layout, levels, hasErrors && epitomes.length === count - 1, isInBlocks));
  }
  if (count === 2) {
    const [first, second] = epitomes.map(({ content }) => formatsOf(content, layout));
    reader.check(first!.formats.length === 1 && second!.formats.length === 1, "two epitomes of several planes");
    reader.check(first!.swizzle === second!.swizzle, "two epitomes whose channels differ");
  }
  const matrices = reader.u32(), gainOffsets = reader.u32();
  const isTold = (number: number, width: number): boolean => number >= 1 && number <= 1 << width;
  reader.check(isTold(matrices, matrixBits) && isTold(gainOffsets, gainOffsetBits), "a palette longer than its numbers");
  const cell = isSplit ? Math.floor(block / 4) : block;
  const seamWidth = has(SEAM_FLAG) ? reader.u8() : SEAM_WIDTH;
  const isSeam = !has(SEAM_FLAG) || (seamWidth > SEAM_WIDTH && seamWidth <= 4 * cell);
  reader.check(isSeam, "a seam narrower than a texel or wider than a leaf");
  reader.end();
  const canBeFiner = layout.levels > FINE_LEVELS && epitomes[0]!.content === "bc1";
  reader.check(!isFiner || canBeFiner, "finer coarse levels where no writer makes them");
  const areLevels = levels > 1 === layout.levels > 1;
  reader.check(areLevels, "mip levels of the epitome without mip levels of the images, or the other way");
  return {
    block, cell, isSplit, xBits, yBits, fractionBits, gainOffsetBits, matrixBits, entryBytes, seamWidth,
    epitomes, levels, hasErrors, isInBlocks, isFiner, matrices, gainOffsets,
  };
}

/** The map of a layer. */
interface LayerMap {
  /** A byte a block: bit 0 four quarters, bits 1 to 4 those that are four leaves; none where blocks are not split. */
  trees: Uint8Array;
  /** Bits of each leaf's entry, as the shader reads them. */
  entries: Float64Array;
}

/** For each tree byte its leaves among the 21 squares of a block: itself, its quarters, theirs. */
const LEAVES = Array.from({ length: 32 }, (_, tree) =>
  tree === 0 ? [0] : [0, 1, 2, 3].flatMap((quarter) => {
    const first = 5 + 4 * quarter;
    return (tree >> (1 + quarter)) & 1 ? [first, first + 1, first + 2, first + 3] : [1 + quarter];
  }),
);

/** Columns and rows of blocks of an image. */
function blocksOf({ width, height }: Size, block: number): [number, number] {
  return [Math.ceil(width / block), Math.ceil(height / block)];
}

/** Checks the tree bytes; number of leaves. */
function countLeaves(id: string, trees: Uint8Array, { isSplit, block }: Head, layout: Layout): number {
  const reader = new Reader(id, trees);
  const blocks = layout.images.reduce((sum, size) => {
    const [columns, rows] = blocksOf(size, block);
    return sum + columns * rows;
  }, 0);
  reader.check(trees.length === (isSplit ? blocks : 0), "another number of blocks than the layout has");
  reader.check(trees.every((tree) => tree === 0 || (tree < 32 && tree % 2 === 1)), "a block split in a way that no writer makes");
  reader.check(block % (isSplit ? 16 : 4) === 0, "blocks that cannot be split twice");
  const leaves = isSplit ? trees.reduce((sum, tree) => sum + LEAVES[tree]!.length, 0) : blocks;
  reader.check(leaves <= MAX_ENTRIES, "more leaves than an entry's number can tell");
  return leaves;
}

/** For each leaf the number of that of the same place and side in the map before; -1 where there is none. */
function sameLeaves(before: Uint8Array, trees: Uint8Array, leaves: number): Int32Array {
  const same = new Int32Array(leaves);
  if (trees.length === 0) {
    return same.map((_, leaf) => leaf);
  }
  const places = new Int32Array(21);
  let first = 0, next = 0;
  trees.forEach((tree, block) => {
    places.fill(-1);
    for (const node of LEAVES[before[block]!]!) {
      places[node] = first++;
    }
    for (const node of LEAVES[tree]!) {
      same[next++] = places[node]!;
    }
  });
  return same;
}

/** `count` bits, eight a byte, the first lowest. */
function readBits(reader: Reader, count: number): (index: number) => boolean {
  const bytes = reader.bytes(Math.ceil(count / 8));
  reader.check(count % 8 === 0 || bytes[bytes.length - 1]! >> (count % 8) === 0, "bits after the last");
  return (index) => ((bytes[index >> 3]! >> (index & 7)) & 1) === 1;
}

/** Entries of all leaves; where there is a map before, a bit says of leaves of both whether they have the same. */
function readEntries(
  reader: Reader, head: Head, trees: Uint8Array, leaves: number, before: LayerMap | undefined, budget: Budget,
): Float64Array {
  reader.check(before !== undefined || reader.data.length === 7 * leaves, "another number of leaves than the blocks have");
  budget.take(leaves * (before ? 12 : 8));
  const same = before && sameLeaves(before.trees, trees, leaves);
  const isSame = readBits(reader, same?.reduce((sum, old) => sum + (old < 0 ? 0 : 1), 0) ?? 0);
  let own = leaves, bit = 0;
  same?.forEach((old, leaf) => {
    if (old >= 0 && isSame(bit++)) {
      own--;
    } else {
      same[leaf] = -1;
    }
  });
  const planes = reader.bytes(7 * own);
  reader.end();
  const yUnit = 2 ** head.xBits, ySpan = 2 ** head.yBits, gainOffsetUnit = yUnit * ySpan;
  const matrixUnit = gainOffsetUnit * 2 ** head.gainOffsetBits, planeUnit = matrixUnit * 2 ** head.matrixBits;
  const entries = new Float64Array(leaves);
  let x = 0, y = 0, index = 0, areHeld = true;
  for (let leaf = 0; leaf < leaves; leaf++) {
    const old = same ? same[leaf]! : -1;
    if (before && old >= 0) {
      const entry = before.entries[old]!;
      entries[leaf] = entry;
      x = entry % yUnit;
      y = Math.floor(entry / yUnit) % ySpan;
      continue;
    }
    const byte = (plane: number): number => planes[plane * own + index]!;
    x = (x + byte(0) + 256 * byte(1)) & 65535;
    y = (y + byte(2) + 256 * byte(3)) & 65535;
    const gainOffset = byte(4), matrix = byte(5), plane = byte(6);
    index++;
    areHeld &&= x < yUnit && y < ySpan && gainOffset < head.gainOffsets && matrix < head.matrices && plane < head.epitomes.length;
    entries[leaf] = x + y * yUnit + gainOffset * gainOffsetUnit + matrix * matrixUnit + plane * planeUnit;
  }
  reader.check(areHeld, "an entry outside of what its fields can hold");
  return entries;
}

/** Trees and entries, where the map of the layer before is given. */
function readMap(
  file: Sections, [treeId, entryId]: [string, string], head: Head, layout: Layout, before: LayerMap | undefined, budget: Budget,
): LayerMap {
  const { data } = file.read(treeId);
  const trees = before ? data.map((tree, block) => tree ^ (before.trees[block] ?? 0)) : data;
  const leaves = countLeaves(treeId, trees, head, layout);
  return { trees, entries: readEntries(file.read(entryId), head, trees, leaves, before, budget) };
}

/** The map as a GPU reads it. */
interface MapPlane extends WordPlane {
  /** First words. */
  matrixStart: number;
  gainOffsetStart: number;
  entryStart: number;
}

/** Words of the blocks, of the palettes and of the entries. */
function mapPlane({ trees, entries }: LayerMap, palettes: Palettes, { entryBytes }: Head, budget: Budget): MapPlane {
  const { matrices, gainOffsets } = palettes;
  const matrixStart = trees.length, gainOffsetStart = matrixStart + matrices.length / 4;
  const entryStart = gainOffsetStart + gainOffsets.length / 3;
  // A word more: an entry is read from two.
  const { plane, rowLog2 } = wordPlane("map", entryStart + Math.ceil((entries.length * entryBytes) / 4) + 1, budget);
  const view = new DataView(plane.data.buffer);
  let leaves = 0;
  trees.forEach((tree, block) => {
    view.setUint32(4 * block, tree + leaves * 32, true);
    leaves += LEAVES[tree]!.length;
  });
  plane.data.set(matrices, 4 * matrixStart);
  for (let word = 0; 3 * word < gainOffsets.length; word++) {
    plane.data.set(gainOffsets.subarray(3 * word, 3 * word + 3), 4 * (gainOffsetStart + word));
  }
  // Bytes behind an entry are 0 until the next is written there.
  entries.forEach((entry, leaf) => {
    const at = 4 * entryStart + leaf * entryBytes;
    view.setUint32(at, entry % 2 ** 32, true);
    view.setUint16(at + 4, Math.floor(entry / 2 ** 32), true);
  });
  return { plane, rowLog2, matrixStart, gainOffsetStart, entryStart };
}

/** What entries point at, as it is stored. */
interface Palettes {
  matrices: Uint8Array;
  gainOffsets: Uint8Array;
}

function readPalettes(file: Sections, head: Head): Palettes {
  const reader = file.read("EPPL");
  const palettes = { matrices: reader.bytes(8 * head.matrices), gainOffsets: reader.bytes(6 * head.gainOffsets) };
  reader.end();
  return palettes;
}

/** All but head and palettes. */
interface Parts {
  map: LayerMap;
  /** Planes of each epitome that has no residual plane. */
  epitomes: Plane[][];
  errors?: Residual;
  blocks?: Blocks[];
  /** The plane of each image's levels that are not read from the epitome; none without such levels. */
  coarse: Plane[];
  layers: [number, number];
}

/** Content of coarse levels. */
function coarseContent({ epitomes, isFiner }: Head, { channels }: Layout): Content {
  const { content } = epitomes[0]!;
  if (content === "raw") {
    return channels === 1 ? "bc4" : channels === 2 ? "bc5" : "bc7";
  }
  return isFiner ? "bc7" : content;
}

/** Planes of all mip levels, as they stand in a section. */
function readLevels(reader: Reader, part: string, content: Content, layout: Layout, sizes: Size[]): Plane[][] {
  const { formats } = formatsOf(content, layout);
  return sizes.map(({ width, height }) => readPlanes(reader, part, formats, width, height));
}

function readCoarse(file: Sections, head: Head, layout: Layout, budget: Budget): Plane[] {
  const count = layout.levels - FINE_LEVELS;
  if (count <= 0) {
    return [];
  }
  const reader = file.read("EPMC");
  budget.take(reader.data.length);
  const planes = layout.images.map((size) => {
    const sizes = Array.from({ length: count }, (_, level) => atLevel(size, FINE_LEVELS + level));
    const levels = readLevels(reader, "mips", coarseContent(head, layout), layout, sizes);
    // Levels beyond 1x1 repeat the last.
    return withLevels(levels.slice(0, fullLevels(sizes[0]!)))[0]!;
  });
  reader.end();
  return planes;
}

/** Sizes of an epitome's levels. */
function levelSizes(size: Size, { levels }: Head): Size[] {
  return Array.from({ length: levels }, (_, level) => atLevel(size, level));
}

/** The file of one layer. */
function readWhole(file: Sections, head: Head, layout: Layout, budget: Budget): Parts {
  const { hasErrors, isInBlocks, levels } = head;
  const map = readMap(file, ["EPTR", "EPEN"], head, layout, undefined, budget);
  const parts: Parts = { map, epitomes: [], coarse: [], layers: [1, 1] };
  const plain = hasErrors || isInBlocks ? head.epitomes.slice(0, -1) : head.epitomes;
  if (plain.length > 0) {
    const reader = file.read("EPAT");
    budget.take(reader.data.length);
    parts.epitomes = plain.map((size, number) => {
      return withLevels(readLevels(reader, PARTS[number]!, size.content, layout, levelSizes(size, head)));
    });
    reader.end();
  }
  const { width, height } = head.epitomes[head.epitomes.length - 1]!;
  const own: Layout = { ...layout, images: [{ width, height }], levels };
  if (hasErrors) {
    parts.errors = readWholeResidual(file, 0, own, budget);
    if (parts.errors.shrinkLog2 > 0) {
      throw corrupt("RSF0", 0, "residual content whose levels are not all stored");
    }
  }
  if (!isInBlocks) {
    parts.coarse = readCoarse(file, head, layout, budget);
    return parts;
  }
  parts.blocks = readWholeBlocks(file, 0, own, budget);
  if (layout.levels > FINE_LEVELS) {
    const sizes = layout.images.map((size) => atLevel(size, FINE_LEVELS));
    const blocks = readWholeBlocks(file, 1, { ...layout, images: sizes, levels: layout.levels - FINE_LEVELS }, budget);
    parts.blocks = parts.blocks.concat(blocks.map((block) => ({ ...block, image: 1 + block.image })));
  }
  return parts;
}

/** An epitome that layers fill. */
interface Layered {
  /** Its planes, as much of them as is drawn. */
  planes: Plane[];
  /** The layer that brings each cell; the next where it has not arrived. */
  cells: Uint8Array;
  /** Cells in a row. */
  columns: number;
}

/** Number of the cells of a layer. */
const cellsOf = (layers: Uint8Array, layer: number): number => layers.reduce((sum, of) => sum + (of === layer ? 1 : 0), 0);

/** Layers that bring the cells of a mip level: each that of the first cell of level 0 under it. */
function layersAt({ cells, columns }: Layered, level: number): Uint8Array {
  if (level === 0) {
    return cells;
  }
  const layers = new Uint8Array(cells.length >> (2 * level)).fill(255);
  cells.forEach((layer, cell) => {
    const row = Math.floor(cell / columns), coarse = (row >> level) * (columns >> level) + ((cell % columns) >> level);
    layers[coarse] = Math.min(layers[coarse]!, layer);
  });
  return layers;
}

/** Reads the cells that a layer brings; those in rows that are not drawn are passed over. */
function readCells(reader: Reader, epitome: Layered, layer: number, levels: number): void {
  // First byte of the level in each plane.
  const starts = epitome.planes.map(() => 0);
  for (let level = 0; level < levels; level++) {
    const layers = layersAt(epitome, level), columns = epitome.columns >> level;
    const count = cellsOf(layers, layer);
    epitome.planes.forEach((plane, number) => {
      const source = reader.bytes(count * planeBytes(plane.format, CELL, CELL)), start = starts[number]!;
      const [blockBytes, side] = FORMATS[plane.format], lines = CELL / side, run = lines * blockBytes;
      const { width, height } = atLevel(plane, level), end = start + planeBytes(plane.format, width, height);
      starts[number] = end;
      let from = 0;
      layers.forEach((of, cell) => {
        for (let line = 0; of === layer && line < lines; line++, from += run) {
          const at = start + ((Math.floor(cell / columns) * lines + line) * columns + (cell % columns)) * run;
          if (at < end) {
            plane.data.set(source.subarray(from, from + run), at);
          }
        }
      });
    });
  }
}

/** Number of layers, and rows of each epitome that the last of them reads. */
function readLayers(file: Sections, head: Head): { total: number; rows: number[] } {
  const reader = file.read("EPLA");
  const total = reader.u8();
  reader.check(total >= 2 && total <= MAX_LAYERS, "layers outside 2..=8");
  const step = CELL * head.levels;
  const rows = head.epitomes.map(({ height }) => {
    const read = reader.u32();
    reader.check(read % step === 0 && read >= step && read <= height, "rows that the epitome has not");
    return read;
  });
  reader.end();
  return { total, rows };
}

/** A file of several layers, or as many of them as are whole: at least the first. */
function readLayered(file: Sections, head: Head, layout: Layout, budget: Budget): Parts {
  if (head.hasErrors || head.isInBlocks) {
    throw corrupt(FORM_ID, 0, "layers of content with a residual plane");
  }
  const { total, rows } = readLayers(file, head);
  const coarse = readCoarse(file, head, layout, budget);
  const isThere = (layer: number): boolean => {
    const kinds = layer + 1 < total ? ["T", "E", "C", "A"] : ["T", "E", "A"];
    return kinds.every((kind) => file.has(`EP${kind}${layer}`));
  };
  let loaded = 1;
  while (loaded < total && isThere(loaded)) {
    loaded++;
  }
  const epitomes = head.epitomes.map(({ content, width, height }, number): Layered => {
    const drawn = { width, height: loaded === total ? rows[number]! : height }, columns = width / CELL;
    const cells = columns * (height / CELL);
    budget.take(2 * cells);
    const planes = formatsOf(content, layout).formats.map((format): Plane => {
      const bytes = levelSizes(drawn, head).reduce((sum, size) => sum + planeBytes(format, size.width, size.height), 0);
      budget.take(bytes);
      return { part: PARTS[number]!, format, ...drawn, levels: head.levels, data: new Uint8Array(bytes) };
    });
    return { planes, cells: new Uint8Array(cells), columns };
  });
  let map: LayerMap | undefined;
  for (let layer = 0; layer < loaded; layer++) {
    map = readMap(file, [`EPT${layer}`, `EPE${layer}`], head, layout, map, budget);
    if (layer + 1 < total) {
      const reader = file.read(`EPC${layer}`);
      const isHere = readBits(reader, epitomes.reduce((sum, { cells }) => sum + cellsOf(cells, layer), 0));
      let bit = 0;
      for (const { cells } of epitomes) {
        cells.forEach((of, cell) => {
          if (of === layer && !isHere(bit++)) {
            cells[cell] = layer + 1;
          }
        });
      }
      reader.end();
    }
    const reader = file.read(`EPA${layer}`);
    epitomes.forEach((epitome) => readCells(reader, epitome, layer, head.levels));
    reader.end();
  }
  return { map: map!, epitomes: epitomes.map(({ planes }) => planes), coarse, layers: [loaded, total] };
}

/** Planes and parameters of what was read. */
function formOf(head: Head, palettes: Palettes, parts: Parts, layout: Layout, budget: Budget): Form {
  const { epitomes, errors, blocks, coarse } = parts;
  const map = mapPlane(parts.map, palettes, head, budget);
  const form: Form = {
    module: errors ? "epitome-errors" : "epitome",
    planes: [map.plane, ...epitomes.flat()],
    uniforms: new Uint8Array(0),
    images: [],
    blocks: blocks ?? [],
  };
  // A texture of blocks stands behind the map.
  let content = [1, blocks ? 1 : form.planes.length - 1], ofErrors: number[] = [];
  if (errors) {
    ofErrors = pushResidual(errors.images[0]!, form.planes);
    content = epitomes.length > 0 ? content : [ofErrors[1]!, ofErrors[1]!];
  }
  const sizes = head.epitomes.map((size, number) => epitomes[number]?.[0] ?? size);
  const planeA = sizes[0]!, planeB = sizes[1] ?? planeA;
  const swizzle = epitomes.length > 0 ? formatsOf(head.epitomes[0]!.content, layout).swizzle : RGBA;
  const coarseSwizzle = coarse.length > 0 ? formatsOf(coarseContent(head, layout), layout).swizzle : RGBA;
  const uniforms = new Uniforms();
  let treeStart = 0;
  layout.images.forEach((size, number) => {
    const [columns, rows] = blocksOf(size, head.block);
    const range = uniforms.add(
      size.width, size.height, layout.levels, CLAMP, swizzle, head.epitomes.length - 1, head.block, head.isSplit ? 1 : 0,
      columns, treeStart, map.entryStart, head.entryBytes, head.xBits, head.yBits, head.fractionBits, head.gainOffsetBits,
      head.matrixBits, map.matrixStart, map.gainOffsetStart, map.rowLog2, planeA.width, planeA.height, planeB.width, planeB.height,
      head.levels, coarseSwizzle, head.cell, head.seamWidth,
      ...(errors?.images[0]!.uniforms ?? []),
    );
    treeStart += columns * rows;
    let last = content[0]!;
    if (coarse.length > 0) {
      last = form.planes.push(coarse[number]!) - 1;
    } else if (blocks && layout.levels > FINE_LEVELS) {
      last = 2 + number;
    }
    form.images.push({ planes: [0, ...content, last, ...ofErrors], uniforms: range, image: 0 });
  });
  form.uniforms = uniforms.bytes();
  return form;
}

export const epitome: Codec = images((file, layout, budget) => {
  budget.take(layout.images.length * IMAGE_BYTES);
  const head = readHead(file, layout), palettes = readPalettes(file, head);
  const parts = file.names("EPLA") ? readLayered(file, head, layout, budget) : readWhole(file, head, layout, budget);
  return { form: formOf(head, palettes, parts, layout, budget), layers: parts.layers };
});
