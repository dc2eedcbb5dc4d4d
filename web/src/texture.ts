import { type Codec, type Loaded } from "./codecs/codec.js";
import { bc } from "./codecs/bc.js";
import { dct } from "./codecs/dct.js";
import { epitome } from "./codecs/epitome.js";
import { lightfield } from "./codecs/lightfield.js";
import { progressive } from "./codecs/progressive.js";
import { vq } from "./codecs/vq.js";
import { zipmap } from "./codecs/zipmap.js";
import { type Layout, type Notes, readNotes, Sections } from "./container.js";
import { Budget, LIMITS, type Limits, LoadError } from "./errors.js";
import type { Form } from "./form.js";

/** Codecs by their numbers in files: name, and how files are read. */
const CODECS: Record<number, [string, Codec]> = {
  1: ["bc", bc],
  2: ["vq", vq],
  3: ["epitome", epitome],
  4: ["progressive", progressive],
  5: ["lightfield", lightfield],
  6: ["zipmap", zipmap],
  7: ["dct", dct],
};

/** A texture that is loaded. */
export class Texture {
  /** Name of the codec. */
  readonly codec: string;
  readonly notes: Notes;
  /** Sizes, mip levels and channels of the images; null for a light field. */
  readonly layout: Layout | null;
  /** Layers that are loaded, of those that the whole file has. */
  readonly layers: [number, number];
  /** Planes and parameters, as a GPU takes them. */
  readonly form: Form;
  /** Bytes of the file, or of the part of it that was given. */
  readonly fileBytes: number;

  constructor(codec: string, notes: Notes, loaded: Loaded, fileBytes: number) {
    this.codec = codec;
    this.notes = notes;
    this.layout = loaded.layout;
    this.layers = loaded.layers;
    this.form = loaded.form;
    this.fileBytes = fileBytes;
  }

  /** Bytes that a GPU holds: planes, parameters, and blocks as they are stored. */
  get compressedBytes(): number {
    const { planes, uniforms, blocks } = this.form;
    const sum = (values: number[]): number => values.reduce((all, value) => all + value, 0);
    const held = blocks.map((block) => block.headBytes + block.streams.length);
    return sum(planes.map((plane) => plane.data.length)) + uniforms.length + sum(held);
  }
}

/**
 * Loads a `.txf` file, or as many layers of one as a prefix of it holds. The bytes are kept, not copied: they must not change.
 * @throws LoadError which names what is wrong with the file.
 */
export function load(bytes: Uint8Array, limits: Partial<Limits> = {}): Texture {
  const budget = new Budget({ ...LIMITS, ...limits });
  const file = new Sections(bytes, budget);
  const found = CODECS[file.codec];
  if (!found) {
    throw new LoadError(`the file holds codec number ${file.codec}; open it with a Texfold that has that codec`);
  }
  const [name, codec] = found;
  const notes = readNotes(file);
  return new Texture(name, notes, codec(file, budget), bytes.length);
}
