// What the command `texfold view` writes into the page.

import type { BankImage } from "./bank.js";

/** One file. */
export interface Item {
  name: string;
  /** The file, in base 64 or as bytes. */
  data: string | Uint8Array;
  /** The images that it was made from, PNGs in base 64; none where they are not given. */
  originals: string[];
  /** A picture of it for browsers without WebGPU, a PNG in base 64. */
  still?: string;
  /** Around the mesh of a light field. */
  sphere?: { centre: [number, number, number]; radius: number };
  /** In the place of a file: a bank, whose tiles the program serves. */
  bank?: { images: BankImage[] };
  /** Name of the group whose originals and other images it has. */
  group?: string;
}

/** Images that the encodings of one input have in common: PNGs in base 64. */
export interface Group {
  originals: string[];
  /** By other encoders, decoded. */
  rivals: { name: string; data: string }[];
}

interface Data {
  items: Item[];
  groups?: Record<string, Group>;
  /** Whether the program that serves the page encodes images. */
  isServed: boolean;
}

/** What the program wrote into the page. */
export function readData(): Data {
  return JSON.parse(document.getElementById("data")!.textContent!) as Data;
}

/** A PNG in base 64, its values as they are. */
export function imageOf(data: string): Promise<ImageBitmap> {
  return createImageBitmap(new Blob([bytesOf(data)], { type: "image/png" }), { colorSpaceConversion: "none", premultiplyAlpha: "none" });
}

export function bytesOf(base64: string): Uint8Array<ArrayBuffer> {
  const text = atob(base64), bytes = new Uint8Array(text.length);
  for (let at = 0; at < text.length; at++) {
    bytes[at] = text.charCodeAt(at);
  }
  return bytes;
}

/** The bytes of a file. */
export const fileOf = (item: Item): Uint8Array => (typeof item.data === "string" ? bytesOf(item.data) : item.data);

/** An element of the page. */
export const element = <T extends HTMLElement>(id: string): T => document.getElementById(id) as T;

/** Makes an element with attributes and children. */
export function make(tag: string, attributes: Record<string, string> = {}, ...children: (Node | string)[]): HTMLElement {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    made.setAttribute(name, value);
  }
  made.append(...children);
  return made;
}
