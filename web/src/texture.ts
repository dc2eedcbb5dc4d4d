import type { Codec } from "./codecs/codec.js";
import { bc } from "./codecs/bc.js";
import { dct } from "./codecs/dct.js";
import { atLevel, fullLevels, type Layout, MAX_TABLE, type Notes, readNotes, Sections } from "./container.js";
import { Budget, LIMITS, type Limits, LoadError } from "./errors.js";
import type { Form } from "./form.js";

/** Codecs by their numbers in files: name, and how files are read. Those that are used less are fetched when a file needs them. */
const CODECS: Record<number, [string, () => Promise<Codec>]> = {
  1: ["bc", async () => bc],
  2: ["vq", async () => (await import("./codecs/vq.js")).vq],
  3: ["epitome", async () => (await import("./codecs/epitome.js")).epitome],
  4: ["progressive", async () => (await import("./codecs/progressive.js")).progressive],
  5: ["lightfield", async () => (await import("./codecs/lightfield.js")).lightfield],
  6: ["zipmap", async () => (await import("./codecs/zipmap.js")).zipmap],
  7: ["dct", async () => dct],
};

/** A texture that is loaded. */
export class Texture {
  constructor(
    /** Name of the codec. */
    readonly codec: string,
    readonly notes: Notes,
    /** Sizes, mip levels and channels of the images; null for a light field. */
    readonly layout: Layout | null,
    /** Planes and parameters, as a GPU takes them. */
    readonly form: Form,
    /** Layers that are loaded, of those that the whole file has. */
    readonly layers: [number, number],
    /** Bytes of the whole file. */
    readonly fileBytes: number,
  ) {}

  /** Bytes that a GPU holds: planes, parameters, and blocks as they are stored. */
  get compressedBytes(): number {
    const { planes, uniforms, blocks } = this.form;
    const sum = (values: number[]): number => values.reduce((all, value) => all + value, 0);
    const held = blocks.map((block) => block.headBytes + block.streams.length);
    return sum(planes.map((plane) => plane.data.length)) + uniforms.length + sum(held);
  }

  /** Bytes of the texels of all images and mip levels as plain RGBA of 8 bits; 0 for a light field. */
  get plainBytes(): number {
    const { images, levels } = this.layout ?? { images: [], levels: 0 };
    let texels = 0;
    for (const size of images) {
      for (let level = 0; level < Math.min(levels, fullLevels(size)); level++) {
        const { width, height } = atLevel(size, level);
        texels += width * height;
      }
    }
    return 4 * texels;
  }
}

/** Where the bytes of a file come from: bytes themselves, which are kept and must not change, or an address to fetch. */
export type Source = Uint8Array | ArrayBuffer | Blob | string | URL;

/**
 * Loads a `.txf` file, or as many layers of one as a prefix of it holds.
 * @throws LoadError which names what is wrong with the file, or with the answer of the server.
 */
export async function open(source: Source, limits: Partial<Limits> = {}): Promise<Texture> {
  return load(await bytesOf(source), limits);
}

async function bytesOf(source: Source): Promise<Uint8Array> {
  if (source instanceof Uint8Array) {
    return source;
  }
  if (source instanceof ArrayBuffer) {
    return new Uint8Array(source);
  }
  const data = source instanceof Blob ? source : await fetched(source);
  return new Uint8Array(await data.arrayBuffer());
}

async function fetched(address: string | URL, headers: Record<string, string> = {}): Promise<Response> {
  const response = await fetch(address, { headers });
  if (!response.ok) {
    throw new LoadError(`the server answers ${response.status} to ${address}; check the address`);
  }
  return response;
}

/**
 * Fetches a `.txf` file and gives the texture again with each layer that arrives, the coarsest first and the whole last.
 * @throws LoadError as `open`; also where the server's answer ends before the first layer is whole.
 */
export async function* arriving(address: string | URL, limits: Partial<Limits> = {}): AsyncGenerator<Texture, void> {
  const body = (await fetched(address)).body?.getReader();
  let bytes: Uint8Array = new Uint8Array(1 << 16), length = 0, loaded = 0;
  let next = 0, ends: number[] = [];
  for (let done = !body; ; ) {
    // Only where a further section is whole can there be a further layer.
    if ((length > 0 && length >= next) || done) {
      const prefix = bytes.subarray(0, length);
      ends = ends.length > 0 ? ends : endsOf(prefix, limits, done);
      next = ends.length > 0 ? ends.find((end) => end > length) ?? Infinity : 0;
      const texture = ends.some((end) => end <= length) ? await load(prefix, limits).catch(unlessMissing(done)) : undefined;
      if (texture && texture.layers[0] > loaded) {
        loaded = texture.layers[0];
        yield texture;
      }
    }
    if (done) {
      return;
    }
    const part = await body!.read();
    done = part.done;
    if (part.value) {
      if (length + part.value.length > bytes.length) {
        const more = new Uint8Array(Math.max(2 * bytes.length, length + part.value.length));
        more.set(bytes.subarray(0, length));
        bytes = more;
      }
      bytes.set(part.value, length);
      length += part.value.length;
    }
  }
}

/** Bytes of the first request for a part of a file: the table of its sections, and of small files all. */
const FIRST_BYTES = 4096;

/**
 * Loads the first layers of a file at an address. Of further layers nothing is fetched from servers that know ranges; from others everything is.
 * @throws LoadError as `open`.
 */
export async function openLayers(address: string | URL, layers: number, limits: Partial<Limits> = {}): Promise<Texture> {
  let bytes = new Uint8Array(0), isWhole = false;
  for (let end = FIRST_BYTES; ; ) {
    const response = await fetched(address, { range: `bytes=${bytes.length}-${end - 1}` });
    const part = new Uint8Array(await response.arrayBuffer());
    const total = Number(/\/(\d+)$/.exec(response.headers.get("content-range") ?? "")?.[1] ?? NaN);
    const before = response.status === 206 ? bytes : new Uint8Array(0);
    bytes = new Uint8Array(before.length + part.length);
    bytes.set(before);
    bytes.set(part, before.length);
    isWhole = response.status !== 206 || part.length === 0 || bytes.length >= total;
    const ends = endsOf(bytes, limits, isWhole);
    const isPlausible = isWhole || ends.some((known) => known <= bytes.length);
    const texture = isPlausible ? await load(bytes, limits).catch(unlessMissing(isWhole)) : undefined;
    if (texture && (isWhole || texture.layers[0] >= Math.min(layers, texture.layers[1]))) {
      return texture;
    }
    end = ends.find((known) => known > bytes.length) ?? 2 * bytes.length;
  }
}

/** Throws an error but that of a file that ends too early while more of it is to come. */
function unlessMissing(done: boolean): (error: unknown) => undefined {
  return (error) => {
    if (done || !(error instanceof LoadError && error.missing)) {
      throw error;
    }
    return undefined;
  };
}

/** Where sections end; nothing while the table has not arrived. */
function endsOf(prefix: Uint8Array, limits: Partial<Limits>, done: boolean): number[] {
  try {
    return new Sections(prefix, new Budget({ ...LIMITS, ...limits })).ends().map(({ end }) => end);
  } catch (error) {
    return unlessMissing(done || prefix.length > MAX_TABLE)(error) ?? [];
  }
}

async function load(bytes: Uint8Array, limits: Partial<Limits>): Promise<Texture> {
  const budget = new Budget({ ...LIMITS, ...limits });
  const file = new Sections(bytes, budget);
  const found = CODECS[file.codec];
  if (!found) {
    throw new LoadError(`the file holds codec number ${file.codec}; open it with a Texfold that has that codec`);
  }
  const [name, codec] = found;
  const read = await codec();
  const notes = readNotes(file), { layout, form, layers } = read(file, budget);
  return new Texture(name, notes, layout, form, layers, file.ends().at(-1)?.end ?? bytes.length);
}
