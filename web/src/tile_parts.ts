// Images that the tiles of a texture are decoded from: one, or the maps of a material. The counterpart of `texfold_gpu`'s `tiles::parts`.

import type { Layout, MapInfo } from "./container.js";
import { pixelsOf } from "./container.js";
import { GpuError } from "./gpu.js";

/** Most halvings from the largest image's sides to those of another. */
const MOST_HALVINGS = 3;

/** Most images of a tile. */
export const MOST_PARTS = 8;

/** Contents of a cache: textures, each looked up by itself, or materials without or with emitted light. */
export type TileContents = "textures" | "materials" | "emissiveMaterials";

/** Layers of the pool that a tile takes. */
export const layersOf = (contents: TileContents): number => ({ textures: 1, materials: 3, emissiveMaterials: 4 })[contents];

/** Layers of a material's tile, as the shaders name them. */
const [COLOR, NORMAL, PACKED, EMISSIVE] = [0, 1, 2, 3];

/** An image of a texture, and the channels of a tile that it fills. */
export interface Part {
  image: number;
  layer: number;
  /** The only channel that it fills; undefined where it fills all four. */
  channel?: number;
  /** Halvings from the texture's sides to its own, 0 to 3; undefined for 0. */
  halvings?: number;
}

/** The two words of a texture's row for its parts. */
export function partsRow(parts: Part[]): [number, number] {
  let channels = 0, shape = parts.length;
  parts.forEach(({ layer, channel, halvings }, number) => {
    channels |= (4 * layer + (channel ?? 0)) << (4 * number);
    shape |= (1 << (4 + layer)) | (channel === undefined ? 0 : 1 << (8 + number)) | ((halvings ?? 0) << (16 + 2 * number));
  });
  return [channels >>> 0, shape >>> 0];
}

/** Puts the texels of a part into those of a layer, where they belong there. */
export function fill({ layer: own, channel }: Part, layer: number, texels: Uint32Array, from: Uint32Array): void {
  if (own !== layer) {
    return;
  }
  if (channel === undefined) {
    texels.set(from);
    return;
  }
  const bytes = new Uint8Array(texels.buffer), first = new Uint8Array(from.buffer);
  for (let at = 0; at < bytes.length; at += 4) {
    bytes[at + channel] = first[at]!;
  }
}

/** The parts of a material, those that fill whole layers first, and whether its colours are sRGB. */
export function partsOf(layout: Layout, layers: number): { parts: Part[]; isSrgb: boolean } {
  const { maps } = layout;
  if (!maps) {
    throw refused("the texture has no maps");
  }
  const largest = layout.images.reduce((one, other) => (other.width * other.height > one.width * one.height ? other : one));
  const has = (kind: MapInfo["kind"]): boolean => maps.some((map) => map.kind === kind);
  const places: Partial<Record<MapInfo["kind"], [number, number?]>> = {
    color: [COLOR], opacity: [COLOR, 3], normal: [NORMAL], height: [has("normal") ? NORMAL : PACKED, 3], orm: [PACKED], occlusion: [PACKED, 0], roughness: [PACKED, 1],
    metalness: [PACKED, 2], emissive: [EMISSIVE],
  };
  const colours = new Set<boolean>(), parts: Part[] = [];
  for (const [image, { kind }] of maps.entries()) {
    const place = places[kind];
    if (!place) {
      throw refused("one of its maps is of another kind");
    }
    const [layer, channel] = place;
    if (layer >= layers) {
      throw refused("the cache has no layers for such a map; make it for materials, with emitted light where there is any");
    }
    if (kind === "color" || kind === "emissive") {
      colours.add(pixelsOf(layout, image).colour === "srgb");
    }
    if (parts.some((part) => part.layer === layer && part.channel === channel)) {
      throw refused("two of its maps are of the same kind");
    }
    const { width, height } = layout.images[image]!, halvings = Math.log2(largest.width / width);
    if (largest.height / height !== largest.width / width || !Number.isInteger(halvings) || halvings > MOST_HALVINGS) {
      throw refused("the sides of a map are not those of the largest, halves, quarters or eighths");
    }
    parts.push(channel === undefined ? { image, layer, halvings } : { image, layer, channel, halvings });
  }
  if (colours.size > 1) {
    throw refused("one of its colours is sRGB, the other one is not");
  }
  if (parts.length > MOST_PARTS) {
    throw refused("it has more than eight maps");
  }
  parts.sort((one, other) => Number(one.channel !== undefined) - Number(other.channel !== undefined) || one.image - other.image);
  return { parts, isSrgb: colours.has(true) };
}

export const refused = (what: string): GpuError => new GpuError(`the material cannot be looked up at once: ${what}; add() looks its maps up one by one`);
