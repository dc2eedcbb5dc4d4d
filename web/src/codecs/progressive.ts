import type { Layout, Sections } from "../container.js";
import type { Budget } from "../errors.js";
import { floatBits, type Form, type Plane, Uniforms } from "../form.js";
import { CLAMP, fits, formatsOf, type Pixel, readContent, readPlanes } from "./content.js";
import { type Codec, images } from "./codec.js";
import { levelBlocks, pushResidual, readResidual, type WordPlane, wordPlane } from "./residual.js";

const MAP_ID = "PRMP";
/** Texels that sides of codebooks are multiples of, and longest side. */
const CELL_SIDE = 32;
const MAX_CODEBOOK_SIDE = 4096;
const GAIN_BITS = 5;
const CODEBOOK_PIXEL: Pixel = { channels: 1, colour: "linear" };
/** Bytes of an image beside its residual content: parameters and lists of planes. */
const IMAGE_BYTES = 512;

/** What is drawn beside residual content. */
interface Details {
  /** The texture's own codebook. */
  codebook: Plane | undefined;
  /** How entries are laid out, 4 bits each: binary logarithm of a block's side, bits of column, row and rotation. */
  form: number;
  /** Least gain in 1/65536 of the range. */
  gainUnit: number;
  /** Entries of each image. */
  maps: WordPlane[];
}

function readCodebook(file: Sections, width: number, height: number): Plane {
  const reader = file.read("PRCB");
  const content = readContent(reader);
  reader.check(fits(content, CODEBOOK_PIXEL), "content that cannot hold gray");
  const planes = readPlanes(reader, "codebook", formatsOf(content, CODEBOOK_PIXEL).formats, width, height);
  reader.end();
  reader.check(width > 0 && width % CELL_SIDE === 0 && height % CELL_SIDE === 0, "a codebook that is not of whole cells");
  return planes[0]!;
}

/** Codebook and maps, where there are any. */
function readDetails(file: Sections, layout: Layout, budget: Budget): Details | undefined {
  if (!file.names(MAP_ID)) {
    return undefined;
  }
  const reader = file.read(MAP_ID);
  const [, publicRows, width, rows] = Array.from({ length: 4 }, () => {
    const side = reader.u32();
    reader.check(side <= MAX_CODEBOOK_SIDE, "a codebook longer than 4096 texels");
    return side;
  }) as [number, number, number, number];
  reader.u64();
  const form = reader.u32();
  const sideLog2 = form & 15, columnBits = (form >> 4) & 15, rowBits = (form >> 8) & 15, rotationBits = (form >> 12) & 15;
  const entryBits = columnBits + rowBits + rotationBits + GAIN_BITS;
  const isWithin = (value: number, least: number, most: number): boolean => value >= least && value <= most;
  const isKnown = isWithin(sideLog2, 3, 4) && isWithin(columnBits, 1, 12) && isWithin(rowBits, 1, 12) && isWithin(rotationBits, 3, 5);
  reader.check(isKnown && form < 65536 && entryBits <= 32, "an unknown layout of entries");
  const gainUnit = reader.u16();
  reader.check(publicRows === 0, "a public codebook is needed; open the image by its bank");
  const codebook = rows > 0 ? readCodebook(file, width, rows) : undefined;
  const maps = layout.images.map((size) => {
    const blocks = levelBlocks(size, layout.levels, 1 << sideLog2);
    const words = Math.ceil((blocks * entryBits) / 32);
    const bytes = reader.bytes(4 * words);
    // An entry is read from two words.
    const map = wordPlane("map", words + 1, budget);
    const { data } = map.plane;
    data.set(bytes);
    for (let block = 0, bit = columnBits; block < blocks; block++, bit += entryBits) {
      const at = bit >>> 3;
      const low = data[at]! | (data[at + 1]! << 8) | (data[at + 2]! << 16);
      reader.check(((low >> (bit & 7)) & ((1 << rowBits) - 1)) < rows, "an entry behind the last row of the codebooks");
    }
    return map;
  });
  reader.end();
  return { codebook, form, gainUnit, maps };
}

/** Images as residual content, with details from codebooks. FORMAT.md, "progressive". */
export const progressive: Codec = images((file, layout, budget) => {
  budget.take(layout.images.length * IMAGE_BYTES);
  const residual = readResidual(file, 0, layout, budget);
  const details = readDetails(file, residual.layout, budget);
  const codebook = details?.codebook;
  const uniforms = new Uniforms();
  const form: Form = { module: "progressive", planes: codebook ? [codebook] : [], uniforms: new Uint8Array(0), images: [], blocks: [] };
  layout.images.forEach(({ width, height }, number) => {
    const image = residual.images[number]!, map = details?.maps[number];
    const bound = pushResidual(image, form.planes);
    // Of what there is none any plane is bound.
    const planes = [bound[0], bound[1], codebook ? 0 : bound[1], ...bound];
    if (map) {
      planes[0] = form.planes.push(map.plane) - 1;
    }
    const range = uniforms.add(
      width, height, layout.levels, CLAMP, residual.shrinkLog2, details?.form ?? 0,
      floatBits((details?.gainUnit ?? 0) / 65536), map?.rowLog2 ?? 0,
      0, 0, codebook?.width ?? 0, codebook?.height ?? 0,
      ...image.uniforms,
    );
    form.images.push({ planes, uniforms: range, image: 0 });
  });
  form.uniforms = uniforms.bytes();
  return { form, layers: residual.layers };
});
