// Planes of plain and BC content. FORMAT.md, "bc".

import type { Layout } from "../container.js";
import type { Reader } from "../reader.js";
import { type Plane, type PlaneFormat, planeBytes } from "../form.js";

/** How content is stored, in the order of the numbers in files. */
export type Content = "raw" | "bc1" | "bc3" | "bc4" | "bc5" | "bc7";
const CONTENTS: readonly Content[] = ["raw", "bc1", "bc3", "bc4", "bc5", "bc7"];

/** What shaders take a texel's channels by: numbers of `texfold_swizzle`. */
export const RGBA = 0;
const RGB = 1;
export const GRAY = 2;
export const GRAY_ALPHA = 3;
export const SPLIT = 4;
const NORMAL = 5;

/** Address mode of parameters before a renderer chooses one. */
export const CLAMP = 1;

export type Pixel = Pick<Layout, "channels" | "colour">;

export function readContent(reader: Reader): Content {
  const content = CONTENTS[reader.u8()];
  if (!content) {
    throw reader.corrupt("unknown content");
  }
  return content;
}

/** Whether content can hold the channels. */
export function fits(content: Content, pixel: Pixel): boolean {
  switch (content) {
    case "bc3":
      return pixel.channels % 2 === 0;
    case "bc4":
      return pixel.channels === 1;
    case "bc5":
      return pixel.channels === 2 || (pixel.channels === 3 && pixel.colour === "normal");
    default:
      return true;
  }
}

/** The planes that hold such pixels, and how a texel is read from them. */
export function formatsOf(content: Content, { channels }: Pixel): { formats: PlaneFormat[]; swizzle: number } {
  const alpha = channels % 2 === 0 ? RGBA : RGB;
  switch (content) {
    case "raw": {
      const formats: PlaneFormat[][] = [["r8unorm"], ["rg8unorm"], ["rg8unorm", "r8unorm"], ["rgba8unorm"]];
      return { formats: formats[channels - 1]!, swizzle: [GRAY, GRAY_ALPHA, SPLIT, RGBA][channels - 1]! };
    }
    case "bc1":
      return { formats: ["bc1-rgba-unorm"], swizzle: alpha };
    case "bc3":
      return { formats: ["bc3-rgba-unorm"], swizzle: RGBA };
    case "bc4":
      return { formats: ["bc4-r-unorm"], swizzle: GRAY };
    case "bc5":
      return { formats: ["bc5-rg-unorm"], swizzle: channels === 2 ? GRAY_ALPHA : NORMAL };
    case "bc7":
      return { formats: ["bc7-rgba-unorm"], swizzle: alpha };
  }
}

/** The planes of one level, not copied. */
export function readPlanes(reader: Reader, part: string, formats: PlaneFormat[], width: number, height: number): Plane[] {
  return formats.map((format) => {
    const data = reader.bytes(planeBytes(format, width, height));
    return { part, format, width, height, levels: 1, data };
  });
}

/** Planes of level after level as one plane with mip levels each. */
export function withLevels(levels: Plane[][]): Plane[] {
  return levels[0]!.map((first, number) => {
    if (levels.length === 1) {
      return first;
    }
    const parts = levels.map((planes) => planes[number]!.data);
    const data = new Uint8Array(parts.reduce((sum, part) => sum + part.length, 0));
    let at = 0;
    for (const part of parts) {
      data.set(part, at);
      at += part.length;
    }
    return { ...first, levels: levels.length, data };
  });
}
