import { atLevel, MAX_PLANE_SIDE, type Size } from "../container.js";
import { type Form, type Plane, Uniforms } from "../form.js";
import { CLAMP, fits, formatsOf, readContent, readPlanes } from "./content.js";
import { type Codec, images } from "./codec.js";

const MAX_CODEBOOK_SIDE = 256;
const MAX_SAMPLES = 64;
const CELL = 4;
/** Mip levels that the shader's parameters have room for. */
const LEVELS = 16;

/** Where the images of one size lie in their index plane: columns and rows of blocks of an image, columns of images. */
interface Arrangement {
  width: number;
  rows: number;
  columns: number;
  lines: number;
}

/** Images of one size that share an index plane. */
interface SizeClass {
  size: Size;
  /** Number of images. */
  count: number;
  capacity: number;
}

const columnsOf = (size: Size): number => Math.ceil(size.width / CELL);

function blocksOf(size: Size, levels: number): number {
  let blocks = 0;
  for (let level = 0; level < levels; level++) {
    const { width, height } = atLevel(size, level);
    blocks += Math.ceil(width / CELL) * Math.ceil(height / CELL);
  }
  return blocks;
}

const rowsOf = (size: Size, levels: number): number => Math.ceil(blocksOf(size, levels) / columnsOf(size));

function arranged({ size, count }: SizeClass, levels: number): Arrangement {
  const rows = rowsOf(size, levels);
  const columns = Math.max(1, Math.ceil(count / Math.max(1, Math.floor(MAX_PLANE_SIDE / rows))));
  return { width: columnsOf(size), rows, columns, lines: Math.ceil(count / columns) };
}

/** Images as indices into a codebook. FORMAT.md, "vq". */
export const vq: Codec = images((file, layout, budget) => {
  const head = file.read("VQFM");
  const content = readContent(head);
  head.check(fits(content, layout), "content that cannot hold the channels");
  const width = head.u32(), height = head.u32(), freeCells = head.u32();
  const isSide = (side: number): boolean => side % CELL === 0 && side >= CELL && side <= MAX_CODEBOOK_SIDE;
  head.check(isSide(width) && isSide(height), "a codebook side that is no multiple of 4 in 4..=256");
  const samples = head.u32();
  head.check(samples <= MAX_SAMPLES, "more than 64 samples");
  head.f32();
  const taken = new Set<number>();
  for (let i = 0; i < samples; i++) {
    const x = head.u32(), y = head.u32(), side = head.u32();
    head.u32();
    head.u32();
    head.u32();
    head.check(side >= CELL && x + side <= width && y + side <= height, "a sample outside the codebook or smaller than a block");
    for (let row = Math.floor(y / CELL); row < Math.ceil((y + side) / CELL); row++) {
      for (let column = Math.floor(x / CELL); column < Math.ceil((x + side) / CELL); column++) {
        taken.add(row * MAX_CODEBOOK_SIDE + column);
      }
    }
  }
  head.end();
  head.check(freeCells <= (width * height) / CELL ** 2 - taken.size, "more free cells than cells");
  const { formats, swizzle } = formatsOf(content, layout);
  const code = file.read("CODE");
  const codebook = readPlanes(code, "codebook", formats, width, height);
  code.end();
  const indices = file.read("INDX");
  const blocks = layout.images.reduce((sum, size) => sum + blocksOf(size, layout.levels), 0);
  indices.check(indices.data.length === 2 * blocks, "another number of blocks than the layout has");
  const isShort = layout.images.every((size) => rowsOf(size, layout.levels) <= MAX_PLANE_SIDE);
  indices.check(isShort, "an image whose index fills more than 8192 rows");

  // Images by size, in the order in which sizes first appear; a size that fills a plane begins a further one.
  const classes: SizeClass[] = [];
  const open = new Map<number, number>();
  const places = layout.images.map((size) => {
    const key = size.width * 65536 + size.height;
    let number = open.get(key);
    if (number === undefined || classes[number]!.count === classes[number]!.capacity) {
      number = classes.length;
      open.set(key, number);
      const columns = Math.max(1, Math.floor(MAX_PLANE_SIDE / columnsOf(size)));
      const rows = Math.max(1, Math.floor(MAX_PLANE_SIDE / rowsOf(size, layout.levels)));
      classes.push({ size, count: 0, capacity: columns * rows });
    }
    return { number, image: classes[number]!.count++ };
  });

  const uniforms = new Uniforms();
  const form: Form = { module: "vq", planes: [...codebook], uniforms: new Uint8Array(0), images: [], blocks: [] };
  const planes = classes.map((sizeClass) => {
    const arrangement = arranged(sizeClass, layout.levels);
    const { width: columns, rows } = arrangement;
    const plane: Plane = {
      part: "index",
      format: "rg8uint",
      width: columns * arrangement.columns,
      height: rows * arrangement.lines,
      levels: 1,
      data: new Uint8Array(0),
    };
    budget.take(2 * plane.width * plane.height);
    plane.data = new Uint8Array(2 * plane.width * plane.height);
    const starts = Array.from({ length: LEVELS }, (_, level) => (level < layout.levels ? blocksOf(sizeClass.size, level) : 0));
    const { size } = sizeClass;
    const range = uniforms.add(size.width, size.height, layout.levels, CLAMP, swizzle, rows, 0, 0, ...starts);
    form.planes.push(plane);
    return { arrangement, plane, range, number: form.planes.length - 1, blocks: blocksOf(size, layout.levels) };
  });

  const last = [width - CELL, height - CELL];
  for (const { number, image } of places) {
    const found = planes[number]!;
    const { width: columns, rows, columns: across } = found.arrangement;
    const x = (image % across) * columns, y = Math.floor(image / across) * rows;
    for (let axis = 0; axis < 2; axis++) {
      const values = indices.bytes(found.blocks), limit = last[axis]!;
      let value = 0;
      for (let block = 0; block < values.length; block++) {
        value = (value + values[block]!) & 255;
        if (value > limit) {
          indices.at = 0;
          throw indices.corrupt("an index outside the codebook");
        }
        const place = (y + Math.floor(block / columns)) * found.plane.width + x + (block % columns);
        found.plane.data[2 * place + axis] = value;
      }
    }
    const bound = [found.number, 0, codebook.length - 1];
    form.images.push({ planes: bound, uniforms: found.range, image: x * MAX_PLANE_SIDE + y });
  }
  form.uniforms = uniforms.bytes();
  return { form, layers: [1, 1] };
});
