// What the page tells of a file.

import type { GpuTexture, PixelInfo, Texture } from "../index.js";
import type { BankImage } from "./bank.js";
import { element, make } from "./data.js";

/** Bytes as a person reads them. */
export function sized(bytes: number): string {
  const units = ["bytes", "kB", "MB", "GB"];
  const power = bytes < 1000 ? 0 : Math.min(3, Math.floor(Math.log10(bytes) / 3));
  const value = bytes / 1000 ** power;
  return `${power === 0 ? value : value.toPrecision(3)} ${units[power]}`;
}

function table(rows: [string, string][]): HTMLElement {
  return make("table", {}, ...rows.map(([name, value]) => make("tr", {}, make("td", {}, name), make("td", {}, value))));
}

/** A size with a bar as long as its share of the largest. */
function bar(name: string, bytes: number, most: number): HTMLElement[] {
  const width = `${((100 * bytes) / most).toFixed(2)}%`;
  return [table([[name, sized(bytes)]]), make("div", { class: "bar", style: `width:${width}` })];
}

/** Fills the panel with what is known of an image of a bank. */
export function showBankFacts({ name, width, height, tiles, fileBytes, compressedBytes }: BankImage): void {
  const sizes: [string, number][] = [["On disk", fileBytes], ["Compressed in memory", compressedBytes], ["As plain RGBA", 4 * width * height]];
  const rows: [string, string][] = [["Image", name], ["Texels", `${width} x ${height}`], ["Tiles", `${tiles.length}`]];
  const most = Math.max(...sizes.map(([, bytes]) => bytes));
  const bars = sizes.flatMap(([size, bytes]) => bar(size, bytes, most));
  element("facts").replaceChildren(table(rows), make("h2", {}, "Size"), ...bars, make("p", { class: "hint" }, "Drag, wheel or pinch; arrows, + and -, 0 fits, 1 shows texels as pixels."));
}

/** Fills the panel. */
export function showFacts(texture: Texture, drawn: GpuTexture | null): void {
  const { layout, notes, form, layers } = texture;
  const rows: [string, string][] = [["Codec", texture.codec]];
  let texels = 0;
  if (layout) {
    const [first] = layout.images;
    const counts = layout.images.map(({ width, height }) => width * height);
    // Maps lie over one another.
    texels = layout.maps ? Math.max(...counts) : counts.reduce((sum, count) => sum + count, 0);
    rows.push([layout.maps ? "Maps" : "Images", layout.images.length === 1 ? `${first!.width} x ${first!.height}` : `${layout.images.length}`]);
    rows.push(["Mip levels", `${layout.levels}`]);
    const describe = ({ channels, depth, colour }: PixelInfo): string => `${channels} of ${depth} bits, ${colour}`;
    rows.push(...(layout.maps ?? [{ kind: "Channels", pixels: layout }]).map(({ kind, pixels }): [string, string] => [kind, describe(pixels)]));
    rows.push(["Bits a texel in memory", ((8 * texture.compressedBytes) / texels).toFixed(2)]);
  }
  rows.push(["Read", form.blocks.length > 0 ? "by block" : "by texel"]);
  if (layers[1] > 1) {
    rows.push([layout ? "Layers" : "Mean and terms", `${layers[0]} of ${layers[1]}`]);
  }
  if (drawn && drawn.skippedLevels > 0) {
    rows.push(["Shown from mip level", `${drawn.skippedLevels}, the finest that this GPU holds`]);
  }
  const sizes: [string, number][] = [["On disk", texture.fileBytes], ["Compressed in memory", texture.compressedBytes]];
  if (drawn) {
    sizes.push(["As drawn here", drawn.residentBytes]);
  }
  if (texture.plainBytes > 0) {
    sizes.push([layout && layout.levels === 1 ? "As plain RGBA" : "As plain RGBA with mips", texture.plainBytes]);
  }
  const most = Math.max(...sizes.map(([, bytes]) => bytes));
  const children: (HTMLElement | string)[] = [table(rows), make("h2", {}, "Size"), ...sizes.flatMap(([name, bytes]) => bar(name, bytes, most))];
  if (notes.settings || notes.verdict) {
    children.push(make("h2", {}, "Settings"), make("p", {}, notes.settings), make("p", {}, notes.verdict));
  }
  if (notes.psnrWithout.length > 0) {
    const parts = notes.psnrWithout.map(([name, psnr]): [string, string] => [name, `${psnr.toFixed(2)} dB`]);
    children.push(make("h2", {}, "PSNR without a part"), table(parts));
  }
  children.push(make("p", { class: "hint" }, layout ? "Drag, wheel or pinch; arrows, + and -, 0 fits, 1 shows texels as pixels." : "Drag to turn, wheel or pinch to come nearer."));
  element("facts").replaceChildren(...children);
}
