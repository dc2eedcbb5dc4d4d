// Sections of a .txf file, and those that every codec has: notes, and the layout of images. FORMAT.md, "File" and the section behind it.

import { checksum } from "./blake3.js";
import { Budget, corrupt, LoadError, truncated } from "./errors.js";
import { Reader } from "./reader.js";
import { decompress } from "./zstd.js";

const MAGIC = [0x89, 0x54, 0x58, 0x46, 0x0d, 0x0a, 0x1a, 0x0a];
const VERSION = 2;
const HEADER_BYTES = 32;
const ENTRY_BYTES = 40;
const HEAD = "head";
/** Most bytes of header and table. */
export const MAX_TABLE = HEADER_BYTES + 4096 * ENTRY_BYTES;

interface Entry {
  id: string;
  compression: number;
  offset: number;
  stored: number;
  raw: number;
  checksum: bigint;
}

/** A place in a file, as a number; what no file can be as long as stays too large. */
const place = (value: bigint): number => Number(value);

/** The table of sections of a file or of a prefix of one, and the sections that are whole. */
export class Sections {
  readonly codec: number;
  private readonly entries: Entry[] = [];

  constructor(private readonly bytes: Uint8Array, private readonly budget: Budget) {
    const known = Math.min(bytes.length, MAGIC.length);
    if (known === 0 || MAGIC.some((byte, i) => i < known && bytes[i] !== byte)) {
      throw new LoadError("not a .txf file; give a file that Texfold wrote");
    }
    const head = new Reader(HEAD, bytes);
    head.bytes(MAGIC.length);
    const version = head.u16();
    if (version !== VERSION) {
      throw new LoadError(
        `the file is of format version ${version}, this reader knows ${VERSION}; update Texfold, or encode the source again where the file is older`,
      );
    }
    this.codec = head.u16();
    const count = head.u32(), length = head.u64(), sum = head.u64();
    budget.check("sections", count, budget.limits.sections);
    const end = HEADER_BYTES + count * ENTRY_BYTES;
    if (end > bytes.length) {
      throw truncated(HEAD);
    }
    const summed = new Uint8Array(end - 8);
    summed.set(bytes.subarray(0, HEADER_BYTES - 8));
    summed.set(bytes.subarray(HEADER_BYTES, end), HEADER_BYTES - 8);
    head.check(checksum(summed) === sum, "the table does not match its checksum");
    const total = this.readTable(head, count, BigInt(end));
    head.check(length === total && BigInt(bytes.length) <= length, "the file's length does not match its table");
  }

  /** Reads the table; the offset at which the last section ends. */
  private readTable(head: Reader, count: number, first: bigint): bigint {
    let next = first;
    for (let i = 0; i < count; i++) {
      const id = head.id(), compression = head.u32(), offset = head.u64(), stored = head.u64(), raw = head.u64();
      const entry = { id, compression, offset: place(offset), stored: place(stored), raw: place(raw), checksum: head.u64() };
      head.check(compression < 2, "unknown compression");
      head.check(offset === next, "sections do not follow one another");
      head.check(compression === 1 || stored === raw, "a stored section has two lengths");
      next += stored;
      head.check(next < 1n << 64n, "a section is too long");
      head.check(!this.entries.some((other) => other.id === id), "two sections of the same name");
      this.entries.push(entry);
    }
    return next;
  }

  /** Whether the table has the section, arrived or not. */
  names(id: string): boolean {
    return this.entries.some((entry) => entry.id === id);
  }

  /** Whether the section is there and whole. */
  has(id: string): boolean {
    return this.entries.some((entry) => entry.id === id && this.isWhole(entry));
  }

  /** Where each section ends, in bytes from the start of the file. */
  ends(): { id: string; end: number }[] {
    return this.entries.map(({ id, offset, stored }) => ({ id, end: offset + stored }));
  }

  private isWhole(entry: Entry): boolean {
    return entry.offset + entry.stored <= this.bytes.length;
  }

  /** The raw bytes of a section: where it is stored as it is, a view of the file. */
  read(id: string): Reader {
    const entry = this.entries.find((other) => other.id === id);
    if (!entry || !this.isWhole(entry)) {
      throw truncated(id);
    }
    const stored = this.bytes.subarray(entry.offset, entry.offset + entry.stored);
    if (checksum(stored) !== entry.checksum) {
      throw corrupt(id, 0, "its bytes do not match its checksum");
    }
    this.budget.take(entry.raw);
    if (entry.compression === 0) {
      return new Reader(id, stored);
    }
    try {
      return new Reader(id, decompress(stored, entry.raw));
    } catch (error) {
      throw error instanceof RangeError ? corrupt(id, 0, "its zstd frame is damaged") : error;
    }
  }
}

/** How a texture was made. */
export interface Notes {
  /** Settings in the words of the command line. */
  settings: string;
  /** One sentence: what was modelled, what was left out and why. */
  verdict: string;
  /** PSNR in dB of the decoded image without a part, by the part's name. */
  psnrWithout: [string, number][];
}

const MAX_TEXT = 4096;
const MAX_PARTS = 64;

export function readNotes(file: Sections): Notes {
  const reader = file.read("NOTE");
  const decoder = new TextDecoder("utf-8", { fatal: true, ignoreBOM: true });
  const text = (): string => {
    const length = reader.u16();
    reader.check(length <= MAX_TEXT, "a text above 4096 bytes");
    const bytes = reader.bytes(length);
    let found: string;
    try {
      found = decoder.decode(bytes);
    } catch {
      throw reader.corrupt("a text that is not UTF-8");
    }
    reader.check(!/[\u0000-\u001f\u007f-\u009f]/.test(found), "control characters in a text");
    return found;
  };
  const notes: Notes = { settings: text(), verdict: text(), psnrWithout: [] };
  while (reader.at < reader.data.length) {
    reader.check(notes.psnrWithout.length < MAX_PARTS, "more than 64 parts");
    const name = text(), number = text();
    const bits = /^\+?\d+$/.test(number) ? Number(number) : NaN;
    reader.check(bits < 2 ** 32, "no number");
    const psnr = new Float32Array(Uint32Array.of(bits).buffer)[0]!;
    reader.check(Number.isFinite(psnr), "a number that is not finite");
    notes.psnrWithout.push([name, psnr]);
  }
  return notes;
}

/** Columns and rows. */
export interface Size {
  width: number;
  height: number;
}

/** Channels, depth, colour space and alpha of an image. */
export interface PixelInfo {
  /** 1 gray, 2 gray and alpha or a band, 3 RGB, 4 RGB and alpha or a band. */
  channels: number;
  /** Bits a channel of the source, 8 or 16. */
  depth: number;
  colour: "srgb" | "linear" | "normal";
  alpha: "opaque" | "straight" | "cutout" | "band";
  /** Alpha from which on a cut-out is there. */
  threshold: number;
}

/** A map of a material. */
export interface MapInfo {
  kind: (typeof MAP_KINDS)[number];
  name: string;
  pixels: PixelInfo;
}

/** Images of a texture: their sizes, mip levels and pixels; of maps of a material, the pixels of the first. */
export interface Layout extends PixelInfo {
  images: Size[];
  levels: number;
  /** The map that each image is, of a material. */
  maps?: MapInfo[];
}

const MAP_KINDS = ["color", "normal", "roughness", "metalness", "occlusion", "orm", "height", "emissive", "opacity", "other"] as const;
const MAX_MAPS = 64;
const MAX_MAP_NAME = 64;

const COLOURS = ["srgb", "linear", "normal"] as const;
const ALPHAS = ["opaque", "straight", "cutout", "band"] as const;
export const MAX_SIDE = 1 << 15;
/** Texels a side of a texture that every WebGPU device can sample. */
export const MAX_PLANE_SIDE = 8192;

/** Bytes that an image costs beside its texels: so a file of many small images is refused before they are listed. */
const IMAGE_BYTES = 512;

function readPixels(reader: Reader): PixelInfo {
  const channels = reader.u8(), depth = reader.u8(), colour = reader.u8(), alpha = reader.u8(), threshold = reader.f32();
  reader.check(channels >= 1 && channels <= 4, "channels outside 1..=4");
  reader.check(depth === 8 || depth === 16, "unknown depth");
  reader.check(colour < COLOURS.length, "unknown colour space");
  reader.check(alpha < ALPHAS.length, "unknown kind of alpha");
  return { channels, depth, colour: COLOURS[colour]!, alpha: ALPHAS[alpha]!, threshold };
}

/** Pixels of an image of a layout. */
export const pixelsOf = (layout: Layout, image: number): PixelInfo => layout.maps?.[image]?.pixels ?? layout;

/** Reads the maps that the images of a layout are, of a material. */
export function readMaps(file: Sections, layout: Layout): MapInfo[] | undefined {
  if (!file.has("MAPS")) {
    return undefined;
  }
  const reader = file.read("MAPS"), decoder = new TextDecoder("utf-8", { fatal: true });
  const names = new Set<string>();
  reader.check(layout.images.length <= MAX_MAPS, "more maps than 64");
  const maps = layout.images.map((_, index) => {
    const kind = MAP_KINDS[reader.u8()];
    reader.check(kind !== undefined, "an unknown kind of map");
    const pixels = readPixels(reader), bytes = reader.bytes(reader.u8());
    let name = "";
    try {
      name = decoder.decode(bytes);
    } catch {
      reader.check(false, "a name that is not UTF-8");
    }
    const isName = bytes.length > 0 && bytes.length <= MAX_MAP_NAME && !/^\.|[\u0000-\u001f\u007f-\u009f/\\:]/.test(name);
    reader.check(isName && !names.has(name), "names of maps that no writer gives");
    names.add(name);
    const isFirst = index > 0 || (["channels", "depth", "colour", "alpha"] as const).every((key) => pixels[key] === layout[key]);
    reader.check(isFirst, "a first map that is unlike the layout");
    return { kind: kind!, name, pixels };
  });
  reader.end();
  return maps;
}

export function readLayout(file: Sections, budget: Budget): Layout {
  const reader = file.read("LAYO");
  const pixels = readPixels(reader);
  const levels = reader.u32();
  reader.check(levels >= 1 && levels <= 16, "levels outside 1..=16");
  const images: Size[] = [];
  let texels = 0;
  for (let runs = reader.u32(); runs > 0; runs--) {
    const count = reader.u32(), width = reader.u32(), height = reader.u32();
    const isSide = (side: number): boolean => side >= 1 && side <= MAX_SIDE;
    reader.check(count > 0 && isSide(width) && isSide(height), "a side outside 1..=32768 or a run of 0 images");
    texels += count * width * height;
    budget.texels(texels);
    budget.take(count * IMAGE_BYTES);
    for (let i = 0; i < count; i++) {
      images.push({ width, height });
    }
  }
  reader.check(images.length > 0, "no image");
  reader.end();
  return { images, levels, ...pixels };
}

/** Columns and rows of a mip level. */
export function atLevel({ width, height }: Size, level: number): Size {
  return { width: Math.max(1, width >> level), height: Math.max(1, height >> level) };
}

/** Mip levels down to 1x1. */
export function fullLevels({ width, height }: Size): number {
  return 32 - Math.clz32(Math.max(width, height));
}
