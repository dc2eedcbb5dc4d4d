// Images and files that are dropped on the page: encoded by the program that serves it, and beside that what the browser's own encoders make
// of the same image in as many bytes.

import { bytesOf, element, type Item, make } from "./data.js";
import { sized } from "./facts.js";

/** What the program says of an image that it has encoded. */
interface Answer {
  item: Item;
  report: { psnr: number; ssimulacra2?: number; encode_seconds: number };
}

/** An image by another encoder. */
export interface Rival {
  name: string;
  bytes: number;
  psnr: number;
  image: ImageBitmap;
}

const KINDS: [string, string][] = [["JPEG", "image/jpeg"], ["WebP", "image/webp"], ["AVIF", "image/avif"]];
const GOALS: [string, string][] = [
  ["0.5 bits a texel", "bpp=0.5"], ["1 bit a texel", "bpp=1"], ["2 bits a texel", "bpp=2"], ["4 bits a texel", "bpp=4"],
  ["30 dB", "psnr=30"], ["34 dB", "psnr=34"], ["38 dB", "psnr=38"], ["42 dB", "psnr=42"],
];
const CODECS = ["auto", "dct", "bc", "vq", "epitome", "progressive"];
const STEPS = 7;

/** Texels of an image, without its alpha. */
function texelsOf(image: ImageBitmap): Uint8ClampedArray {
  const context = new OffscreenCanvas(image.width, image.height).getContext("2d")!;
  context.drawImage(image, 0, 0);
  return context.getImageData(0, 0, image.width, image.height).data;
}

/** PSNR in dB of the colours that alpha does not hide. */
function psnr(one: Uint8ClampedArray, other: Uint8ClampedArray): number {
  let sum = 0, count = 0;
  for (let at = 0; at < one.length; at++) {
    const counts = at % 4 !== 3 && one[at | 3] !== 0;
    sum += counts ? (one[at]! - other[at]!) ** 2 : 0;
    count += Number(counts);
  }
  return 10 * Math.log10((255 ** 2 * count) / sum);
}

/** The best that an encoder of the browser makes in at most `most` bytes; null where the browser lacks it or no quality is small enough. */
async function rival([name, type]: [string, string], original: ImageBitmap, most: number): Promise<Rival | null> {
  const canvas = new OffscreenCanvas(original.width, original.height);
  canvas.getContext("2d")!.drawImage(original, 0, 0);
  let low = 0, high = 1, best: Blob | null = null;
  for (let step = 0; step < STEPS; step++) {
    const quality = (low + high) / 2, blob = await canvas.convertToBlob({ type, quality });
    if (blob.type !== type) {
      return null;
    }
    if (blob.size <= most) {
      [best, low] = [blob, quality];
    } else {
      high = quality;
    }
  }
  const image = best && (await createImageBitmap(best, { colorSpaceConversion: "none" }));
  return image && { name, bytes: best!.size, psnr: psnr(texelsOf(original), texelsOf(image)), image };
}

/** What the drop zone does with what it takes. */
export interface Taker {
  /** Shows a file, beside images by other encoders. */
  take(item: Item, rivals: Rival[]): Promise<void>;
}

/** Fills the panel's part for dropped files. */
export function listenForFiles(isServed: boolean, taker: Taker): void {
  const select = (label: string, options: [string, string][], chosen: number): [HTMLElement, HTMLSelectElement] => {
    const box = make("select", { "aria-label": label }, ...options.map(([name, value], at) => make("option", { value, ...(at === chosen ? { selected: "" } : {}) }, name)));
    return [make("label", {}, label, box), box as HTMLSelectElement];
  };
  const [goalLabel, goal] = select("Goal", GOALS, 1);
  const [codecLabel, codec] = select("Codec", CODECS.map((name) => [name, name]), 0);
  const file = make("input", { type: "file", "aria-label": "Image or .txf file" }) as HTMLInputElement;
  const told = make("div", { role: "status" });
  const hint = isServed
    ? "Drop an image anywhere: it is encoded on this machine and shown beside JPEG and WebP of as many bytes. Or drop a .txf file."
    : "Drop a .txf file anywhere. Images are encoded by the program: texfold view --serve.";
  element("drop").replaceChildren(make("h2", {}, "Your own"), ...(isServed ? [goalLabel, codecLabel] : []), file, make("p", { class: "hint" }, hint), told);
  let last: File | undefined;
  const take = async (given: File | undefined): Promise<void> => {
    if (!given) {
      return;
    }
    last = given;
    try {
      if (given.name.endsWith(".txf")) {
        told.replaceChildren();
        await taker.take({ name: given.name, data: new Uint8Array(await given.arrayBuffer()), originals: [] }, []);
      } else if (isServed) {
        told.replaceChildren(`Encoding ${given.name} …`);
        await encode(given, `${goal.value}&codec=${codec.value}&effort=fast`, taker, told);
      } else {
        told.replaceChildren(`${given.name} is no .txf file; start texfold view --serve to encode images`);
      }
    } catch (error) {
      told.replaceChildren(error instanceof Error ? error.message : `${error}`);
    }
  };
  file.addEventListener("change", () => void take(file.files?.[0]));
  goal.addEventListener("change", () => void take(last));
  codec.addEventListener("change", () => void take(last));
  document.addEventListener("dragover", (event) => event.preventDefault());
  document.addEventListener("drop", (event) => {
    event.preventDefault();
    void take(event.dataTransfer?.files[0]);
  });
}

/** Has an image encoded, shows it, then what other encoders make of it. */
async function encode(file: File, options: string, taker: Taker, told: HTMLElement): Promise<void> {
  const response = await fetch(`/encode?name=${encodeURIComponent(file.name)}&${options}`, { method: "POST", body: file, headers: { "X-Texfold": "1" } });
  if (!response.ok) {
    throw new Error(await response.text());
  }
  const { item, report } = (await response.json()) as Answer;
  const bytes = bytesOf(item.data as string).length;
  const blob = new Blob([bytesOf(item.originals[0]!)], { type: "image/png" });
  const original = await createImageBitmap(blob, { colorSpaceConversion: "none" });
  const found = await Promise.all(KINDS.map((kind) => rival(kind, original, bytes)));
  const rivals = found.filter((one) => one !== null);
  const row = (...cells: string[]): HTMLElement => make("tr", {}, ...cells.map((cell) => make("td", {}, cell)));
  const ours = row("Texfold, with mip levels", sized(bytes), `${report.psnr.toFixed(2)} dB`);
  const others = rivals.map(({ name, bytes: size, psnr: db }) => row(`${name}, no random access`, sized(size), `${db.toFixed(2)} dB`));
  const missing = KINDS.filter((_, at) => found[at] === null).map(([name]) => name);
  const quality = report.ssimulacra2 === undefined ? "" : `, SSIMULACRA2 ${report.ssimulacra2.toFixed(1)}`;
  told.replaceChildren(make("table", {}, ours, ...others), make("p", { class: "hint" }, `Encoded in ${report.encode_seconds.toFixed(1)} s${quality}.`,
    missing.length > 0 ? ` Not by this browser, or not in so few bytes: ${missing.join(", ")}.` : ""));
  await taker.take(item, rivals);
}
