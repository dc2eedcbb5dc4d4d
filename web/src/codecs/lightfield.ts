// Surface light fields: a mesh, its mean, and terms of surface maps and view maps. FORMAT.md, "lightfield"; crates/lightfield.

import { type Layout, MAX_PLANE_SIDE, type Sections, type Size } from "../container.js";
import type { Budget } from "../errors.js";
import { type Blocks, floatBits, type Form, FORMATS, type Plane, planeBytes, Uniforms } from "../form.js";
import type { Reader } from "../reader.js";
import { type Content, formatsOf, readContent, RGBA } from "./content.js";
import type { Codec } from "./codec.js";
import { readWholeBlocks } from "./dct.js";

const MAX_VERTICES = 1 << 18;
const MAX_TRIANGLES = 1 << 19;
const MAX_TERMS = 8;
/** Largest binary logarithm of a patch's side. */
const MAX_SIDE_LOG2 = 6;
/** The number of a map that is not there. */
const NONE = 2 ** 32 - 1;
/** Rows of an atlas from one term to the next are multiples of it. */
const BLOCK = 4;
/** Words in a row of the mesh's texture. */
const ROW = 1024;
/** Stands for a content where maps are in blocks of variable length. */
const IN_BLOCKS = 255;
const MAX_COORDINATE = 1e9;
/** Byte that stands for 0, and bytes from there to the one that stands for 1, by the signs of the maps. */
const ZERO_AND_RANGE = [[128, 127], [0, 255]] as const;
const PARTS = ["mean", "surface maps", "view maps"] as const;
const SPACE = { channels: 3, colour: "srgb" } as const;
const round = Math.fround;

/** What "LFFM" says. */
interface Head {
  vertices: number;
  triangles: number;
  terms: number;
  /** Texels a side of a view map. */
  grid: number;
  directions: number;
  factors: number;
  /** Contents of the mean and of the maps; null where they are in blocks. */
  contents: [Content, Content] | null;
  /** Columns of the atlases of the mean, of surface maps, of view maps. */
  widths: [number, number, number];
  /** Log2 downscale of surface maps. */
  reduceLog2: number;
}

interface Mesh {
  /** x, y and z of each vertex. */
  positions: Float32Array;
  /** Three vertices a triangle. */
  indices: Uint32Array;
  /** Binary logarithm of the side of each triangle's patch. */
  sides: Uint8Array;
}

/** The maps of the mean or of a term: how many there are, and which is used where. */
interface Layer {
  /** Patches by binary logarithm of their side. */
  patches: number[];
  views: number;
  /** Number of each triangle's patch or, in a term, of each corner's; later the word that the shader reads. */
  patchOf: Uint32Array;
  /** Number of each vertex's view map; later where it lies. */
  viewOf: Uint32Array;
  /** Scales of a term: red, green and blue of each vertex. */
  scales: Uint8Array;
  /** First and end rows in the atlases of surface maps, or the mean, and of view maps. */
  rows: [[number, number], [number, number]];
}

function readHead(reader: Reader): Head {
  const vertices = reader.u32(), triangles = reader.u32();
  const terms = reader.u8(), grid = reader.u8(), directions = reader.u8(), factors = reader.u8();
  let contents: Head["contents"] = null;
  if (reader.bytes(2).some((number) => number !== IN_BLOCKS)) {
    reader.at -= 2;
    contents = [readContent(reader), readContent(reader)];
  }
  const widths: Head["widths"] = [reader.u16(), reader.u16(), reader.u16()];
  const reduceLog2 = reader.u8();
  reader.end();
  reader.check(directions < 3, "unknown kind of directions");
  reader.check(factors < ZERO_AND_RANGE.length, "unknown kind of factors");
  reader.check(vertices > 0 && vertices <= MAX_VERTICES, "no or too many vertices");
  reader.check(triangles > 0 && triangles <= MAX_TRIANGLES, "no or too many triangles");
  reader.check(terms <= MAX_TERMS, "more than 8 terms");
  reader.check(grid >= 4 && grid <= 64 && grid % 4 === 0, "view maps of a side that is no multiple of 4 in 4..=64");
  reader.check(reduceLog2 <= 3, "surface maps halved more than three times");
  const isHeld = !contents || contents.every((content) => ["raw", "bc1", "bc7"].includes(content));
  reader.check(isHeld, "content that holds no light-field maps");
  return { vertices, triangles, terms, grid, directions, factors, contents, widths, reduceLog2 };
}

/** Numbers of which all lowest bytes come first, then all next ones. */
function readNumbers(reader: Reader, count: number, bytes: number): Uint32Array {
  const planes = Array.from({ length: bytes }, () => reader.bytes(count));
  const words = new Uint32Array(count);
  planes.forEach((plane, shift) => plane.forEach((byte, at) => (words[at]! |= byte << (8 * shift))));
  return words;
}

/**
 * A layer where each of `count` triangles or corners has a patch of its own, of the side that `sideOf` names, and each vertex a
 * view map where `hasView` says so.
 */
function ownMaps(count: number, sideOf: (at: number) => number | undefined, vertices: number, hasView: (vertex: number) => boolean): Layer {
  const patches = new Array<number>(MAX_SIDE_LOG2 + 1).fill(0);
  const patchOf = new Uint32Array(count).fill(NONE), viewOf = new Uint32Array(vertices).fill(NONE);
  for (let at = 0; at < count; at++) {
    const side = sideOf(at);
    if (side !== undefined) {
      patchOf[at] = patches[side]!++;
    }
  }
  let views = 0;
  for (let vertex = 0; vertex < vertices; vertex++) {
    if (hasView(vertex)) {
      viewOf[vertex] = views++;
    }
  }
  return { patches, views, patchOf, viewOf, scales: new Uint8Array(0), rows: [[0, 0], [0, 0]] };
}

/** Reads which maps are used, of a layer where each has its own. */
function readSharing(reader: Reader, layer: Layer, sideOf: (at: number) => number): void {
  const isShared = reader.u8();
  reader.check(isShared < 2, "maps neither shared nor own");
  if (isShared === 0) {
    return;
  }
  const readCount = (most: number): number => {
    const count = reader.u32();
    reader.check(count <= most, "more maps than are used");
    return count;
  };
  layer.patches = layer.patches.map(readCount);
  layer.views = readCount(layer.views);
  const replace = (numbers: Uint32Array, endOf: (at: number) => number): void => {
    const stored = readNumbers(reader, numbers.reduce((sum, number) => sum + (number === NONE ? 0 : 1), 0), 3);
    let next = 0;
    numbers.forEach((number, at) => {
      if (number !== NONE) {
        numbers[at] = stored[next++]!;
        reader.check(numbers[at]! < endOf(at), "a map that does not exist");
      }
    });
  };
  replace(layer.patchOf, (at) => layer.patches[sideOf(at)]!);
  replace(layer.viewOf, () => layer.views);
}

/** Reads the mesh, and which maps of the mean are used. */
function readMesh(reader: Reader, head: Head, budget: Budget): { mesh: Mesh; mean: Layer } {
  const { vertices, triangles } = head;
  budget.take(24 * vertices + 36 * triangles);
  const positions = new Float32Array(3 * vertices);
  for (let axis = 0; axis < 3; axis++) {
    const values = new Float32Array(readNumbers(reader, vertices, 4).buffer);
    reader.check(values.every((value) => Math.abs(value) <= MAX_COORDINATE), "a place that is not finite or too far away");
    values.forEach((value, vertex) => (positions[3 * vertex + axis] = value));
  }
  const indices = readNumbers(reader, 3 * triangles, 4);
  for (let at = 1; at < indices.length; at++) {
    indices[at]! += indices[at - 1]!;
  }
  reader.check(indices.every((index) => index < vertices), "a triangle of a vertex that does not exist");
  const sides = reader.bytes(triangles);
  const largest = sides.reduce((most, side) => Math.max(most, side), 0);
  reader.check(largest <= MAX_SIDE_LOG2, "a patch of more than 64 texels a side");
  const least = 2 ** largest + 1;
  const fits = head.widths.every((width, atlas) => {
    const [multiple, narrowest] = atlas < 2 ? [BLOCK, least] : [head.grid, head.grid];
    return width >= narrowest && width <= MAX_PLANE_SIDE && width % multiple === 0;
  });
  reader.check(fits, "atlases of a width that holds no map");
  const mean = ownMaps(triangles, (at) => sides[at], 0, () => false);
  readSharing(reader, mean, (at) => sides[at]!);
  reader.end();
  return { mesh: { positions, indices, sides }, mean };
}

/** Reads the scales of a term, and which maps of it are used. */
function readTerm(reader: Reader, head: Head, { indices }: Mesh, coarse: Uint8Array, budget: Budget): Layer {
  budget.take(4 * (indices.length + head.vertices));
  const scales = reader.bytes(3 * head.vertices);
  const uses = (vertex: number): boolean => (scales[3 * vertex]! | scales[3 * vertex + 1]! | scales[3 * vertex + 2]!) > 0;
  const sideOf = (at: number): number => coarse[Math.floor(at / 3)]!;
  const layer = ownMaps(indices.length, (at) => (uses(indices[at]!) ? sideOf(at) : undefined), head.vertices, uses);
  readSharing(reader, layer, sideOf);
  reader.end();
  return { ...layer, scales };
}

/** Whether all sections of a term have arrived; in blocks, those that the file names. */
function isWhole(file: Sections, head: Head, term: number): boolean {
  if (head.contents) {
    return ["Q", "G", "H"].every((kind) => file.has(`LF${kind}${term}`));
  }
  return file.has(`LFQ${term}`) && ["RBB", "RBD"].every((kind) => file.has(kind + (term + 1)) || !file.names(kind + (term + 1)));
}

/** Turns the numbers of a layer's maps into places below the first rows; false where they do not fit an atlas. */
function place(layer: Layer, width: number, sideOf: (at: number) => number, head: Head, first: [number, number]): boolean {
  const tops: number[] = [];
  let [top, viewTop] = first;
  for (let log2 = MAX_SIDE_LOG2; log2 >= 0; log2--) {
    tops[log2] = top;
    const columns = Math.max(1, Math.floor(width / (2 ** log2 + 1)));
    top += Math.ceil(Math.ceil(layer.patches[log2]! / 2) / columns) * (2 ** log2 + 2);
  }
  top = Math.ceil(top / BLOCK) * BLOCK;
  const columns = Math.max(1, Math.floor(head.widths[2] / head.grid));
  const viewEnd = viewTop + Math.ceil(layer.views / columns) * head.grid;
  layer.rows = [[first[0], top], [viewTop, viewEnd]];
  if (Math.max(top, viewEnd) > MAX_PLANE_SIDE) {
    return false;
  }
  layer.patchOf = layer.patchOf.map((patch, at) => {
    const log2 = sideOf(at), side = 2 ** log2, across = Math.max(1, Math.floor(width / (side + 1))), slot = patch >>> 1;
    const x = (slot % across) * (side + 1), y = tops[log2]! + Math.floor(slot / across) * (side + 2);
    return patch === NONE ? 0 : x | (y << 14) | (log2 << 28) | (patch << 31);
  });
  layer.viewOf = layer.viewOf.map((view) => {
    const y = viewTop + Math.floor(view / columns) * head.grid;
    return view === NONE ? 0 : ((view % columns) * head.grid) | (y << 14);
  });
  return true;
}

/** Unit normals of the vertices: those of the triangles around, weighted by area; +z where there are none. All in 32-bit floats. */
function normalsOf({ positions, indices }: Mesh): Float32Array {
  const normals = new Float32Array(positions.length);
  const normal = new Float32Array(3), ab = new Float32Array(3), ac = new Float32Array(3);
  for (let at = 0; at < indices.length; at += 3) {
    const [a, b, c] = [3 * indices[at]!, 3 * indices[at + 1]!, 3 * indices[at + 2]!] as const;
    for (let axis = 0; axis < 3; axis++) {
      ab[axis] = positions[b + axis]! - positions[a + axis]!;
      ac[axis] = positions[c + axis]! - positions[a + axis]!;
    }
    for (let axis = 0; axis < 3; axis++) {
      const next = (axis + 1) % 3, last = (axis + 2) % 3;
      normal[axis] = round(ab[next]! * ac[last]!) - round(ac[next]! * ab[last]!);
    }
    if (normal.every(Number.isFinite)) {
      for (const corner of [a, b, c]) {
        normal.forEach((value, axis) => (normals[corner + axis]! += value));
      }
    }
  }
  for (let at = 0; at < normals.length; at += 3) {
    const [x, y, z] = [normals[at]!, normals[at + 1]!, normals[at + 2]!] as const;
    const squared = round(round(round(x * x) + round(y * y)) + round(z * z));
    const by = round(1 / round(Math.sqrt(squared)));
    normals.set(by > 0 && by < Infinity ? [x * by, y * by, z * by] : [0, 0, 1], at);
  }
  return normals;
}

/** The mesh as shaders read it. */
function meshPlane(head: Head, mesh: Mesh, [mean, ...terms]: Layer[], budget: Budget): Plane {
  const count = (6 + 2 * terms.length) * head.vertices + (4 + 3 * terms.length) * head.triangles;
  const height = Math.ceil(count / ROW);
  budget.take(4 * ROW * height + 4 * mesh.positions.length);
  const words = new Uint32Array(ROW * height);
  const places = new Uint32Array(mesh.positions.buffer), normals = new Uint32Array(normalsOf(mesh).buffer);
  let at = 0;
  const add = (from: Uint32Array, first: number): void => {
    for (let next = first; next < first + 3; next++) {
      words[at++] = from[next]!;
    }
  };
  for (let vertex = 0; vertex < head.vertices; vertex++) {
    add(places, 3 * vertex);
    add(normals, 3 * vertex);
    for (const { scales, viewOf } of terms) {
      words[at++] = scales[3 * vertex]! | (scales[3 * vertex + 1]! << 8) | (scales[3 * vertex + 2]! << 16);
      words[at++] = viewOf[vertex]!;
    }
  }
  for (let triangle = 0; triangle < head.triangles; triangle++) {
    add(mesh.indices, 3 * triangle);
    words[at++] = mean!.patchOf[triangle]!;
    terms.forEach((term) => add(term.patchOf, 3 * triangle));
  }
  return { part: "mesh", format: "r32uint", width: ROW, height, levels: 1, data: new Uint8Array(words.buffer) };
}

/** Adds the planes of all atlases; the two that shaders read of each. */
function addPlanes(file: Sections, head: Head, contents: [Content, Content], [mean, ...terms]: Layer[], budget: Budget, form: Form): number[] {
  const formats = [0, 1, 1].map((content) => formatsOf(contents[content]!, SPACE).formats);
  const sections: [number, string, [number, number]][] = [[0, "LFMN", mean!.rows[0]]];
  terms.forEach(({ rows }, term) => sections.push([1, `LFG${term}`, rows[0]], [2, `LFH${term}`, rows[1]]));
  const bands = sections.map(([atlas, id, [first, end]]) => {
    const reader = file.read(id);
    const stored = formats[atlas]!.map((format) => reader.bytes(planeBytes(format, head.widths[atlas]!, end - first)));
    reader.end();
    return { atlas, end, stored };
  });
  return PARTS.flatMap((part, atlas) => {
    const found = bands.filter((band) => band.atlas === atlas), width = head.widths[atlas]!;
    const first = form.planes.length, height = Math.max(BLOCK, found.at(-1)?.end ?? 0);
    formats[atlas]!.forEach((format, number) => {
      budget.take(planeBytes(format, width, height));
      const data = new Uint8Array(planeBytes(format, width, height)), [step, side] = FORMATS[format];
      let start = 0;
      for (const { stored } of found) {
        const band = data.subarray(start, start + stored[number]!.length);
        band.set(stored[number]!);
        // Plain bytes are stored as differences.
        for (let at = step; side === 1 && at < band.length; at++) {
          band[at]! += band[at - step]!;
        }
        start += band.length;
      }
      form.planes.push({ part, format, width, height, levels: 1, data });
    });
    return [first, form.planes.length - 1];
  });
}

/** Adds the blocks of all atlases; the two textures that shaders read of each. */
function addBlocks(file: Sections, head: Head, [mean, ...terms]: Layer[], budget: Budget, form: Form): number[] {
  const read = (number: number, images: Size[]): Blocks[] => {
    const layout: Layout = { ...SPACE, images, levels: 1, depth: 8, alpha: "opaque", threshold: 0 };
    return images.length > 0 ? readWholeBlocks(file, number, layout, budget) : [];
  };
  const atlases: Blocks[][] = [read(0, [{ width: head.widths[0], height: mean!.rows[0][1] }]), [], []];
  terms.forEach(({ rows }, term) => {
    const bands = rows.map(([row, end], atlas) => ({ atlas: atlas + 1, row, width: head.widths[atlas + 1]!, height: end - row }));
    const used = bands.filter(({ height }) => height > 0);
    read(term + 1, used).forEach((blocks, number) => {
      const { atlas, row } = used[number]!;
      atlases[atlas]!.push({ ...blocks, row });
    });
  });
  let next = 0;
  return atlases.flatMap((bands) => {
    // Without maps nothing is read there.
    const image = bands.length > 0 ? next++ : 0;
    form.blocks.push(...bands.map((blocks) => ({ ...blocks, image })));
    return [1 + image, 1 + image];
  });
}

export const lightfield: Codec = (file, budget) => {
  const head = readHead(file.read("LFFM"));
  const reader = file.read("LFME");
  const { mesh, mean } = readMesh(reader, head, budget);
  const coarse = mesh.sides.map((log2) => Math.max(0, log2 - head.reduceLog2));
  const layers = [mean];
  for (let term = 0; term < head.terms && isWhole(file, head, term); term++) {
    layers.push(readTerm(file.read(`LFQ${term}`), head, mesh, coarse, budget));
  }
  const terms = layers.length - 1;
  let first: [number, number] = [0, 0];
  layers.forEach((layer, number) => {
    const sideOf = number === 0 ? (at: number) => mesh.sides[at]! : (at: number) => coarse[Math.floor(at / 3)]!;
    reader.check(place(layer, head.widths[number === 0 ? 0 : 1], sideOf, head, first), "maps that do not fit a texture");
    first = number === 0 ? [0, 0] : [layer.rows[0][1], layer.rows[1][1]];
  });
  const planes = [meshPlane(head, mesh, layers, budget)];
  const form: Form = { module: "lightfield", planes, uniforms: new Uint8Array(0), images: [], blocks: [] };
  let swizzles = [RGBA, RGBA], bound: number[];
  if (head.contents) {
    swizzles = head.contents.map((content) => formatsOf(content, SPACE).swizzle);
    bound = addPlanes(file, head, head.contents, layers, budget, form);
  } else {
    bound = addBlocks(file, head, layers, budget, form);
  }
  const uniforms = new Uniforms(), [zero, range] = ZERO_AND_RANGE[head.factors]!;
  const numbers = [head.vertices, head.triangles, terms, terms, head.directions, head.grid, swizzles[0]!, swizzles[1]!];
  const bytes = uniforms.add(...numbers, floatBits(zero), floatBits(range), head.reduceLog2, 0);
  form.uniforms = uniforms.bytes();
  form.images.push({ planes: [0, ...bound], uniforms: bytes, image: 0 });
  return { layout: null, form, layers: [terms + 1, head.terms + 1] };
};
