// Shaders of the cache of tiles from their parts: the counterpart of `texfold_shaders::tiles` and its neighbours.

import type { Module } from "./generated/modules.js";
import { block, blockPass, blockShare, blockTexel } from "./generated/parts.js";
import { tileDraw, tileEntry, tilePlace, tilePlan as planEntry, tileRequest, tileSample, tileTables } from "./generated/tiles.js";
import { sourcesOf } from "./shaders.js";

/** The functions that draw from a cache, with its bindings in `group`. */
export function tileSampling(group: number, anisotropy: number, stride: number): string {
  const sample = tileSample.replaceAll("TEXFOLD_GROUP", `${group}`).replace("TEXFOLD_ANISOTROPY;", `${anisotropy}.0;`);
  return [tileTables, sample.replace("TEXFOLD_STRIDE;", `${stride}u;`)].join("\n");
}

/** The compute shader that chooses the tiles of an update. */
export const tilePlan = (): string => [tileTables, blockPass, tileRequest, planEntry].join("\n");

/** The compute shader that decodes tiles of superblocks. */
export const tilePasses = (): string => [tileTables, tilePlace, blockPass, block, blockTexel, blockShare, tileRequest, tileEntry].join("\n");

/** The compute shader that draws tiles of a texture that is not in superblocks. */
export async function tileDrawing(module: Module): Promise<string> {
  return [await sourcesOf(module, 1), tileTables, tilePlace, blockPass, tileRequest, tileDraw].join("\n");
}
