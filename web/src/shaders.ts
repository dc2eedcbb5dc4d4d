// Whole shaders from their parts: the counterpart of `texfold_shaders::entry`, `block` and `light`.

import type { Module } from "./generated/modules.js";
import { address, block, blockEntry, blockFloat, blockPass, blockShare, blockTexel, blockUnorm, decode, draw, sample, view } from "./generated/parts.js";

/** The functions of a module with its bindings in `group`. */
export async function sourcesOf(module: Module, group = 0): Promise<string> {
  const files = await Promise.all(module.files.map(async ([load, first]) => ({ ...(await load()), first })));
  const texts = files.map(({ text, first }) =>
    text.replaceAll("TEXFOLD_GROUP", `${group}`).replace(/TEXFOLD_BINDING_(\d+)/g, (_, number: string) => `${first + +number}`),
  );
  return [address, sample, ...texts, files[0]!.entry].join("\n");
}

/** A shader with `vertex_main` and `fragment_main`: `draw` for trilinear lookups, `decode` for lookups within a level; the view is group 1. */
export async function drawing(module: Module, entry: "draw" | "decode"): Promise<string> {
  return [await sourcesOf(module), view, entry === "draw" ? draw : decode].join("\n");
}

/** A shader that draws a light field on its mesh; the camera is group 1. */
export const light = (module: Module): Promise<string> => sourcesOf(module);

/** The compute shader that decodes blocks to `rgba8unorm` or `rgba32float`. */
export function blocks(target: "rgba8unorm" | "rgba32float"): string {
  return [blockPass, block, blockTexel, blockShare, blockEntry, target === "rgba8unorm" ? blockUnorm : blockFloat].join("\n");
}
