// Whole shaders from their parts: the counterpart of `texfold_shaders::entry`, `block` and `light`.

import * as wgsl from "./generated/wgsl.js";

/** The functions of a module with its bindings in `group`. */
function sourcesOf(module: wgsl.Module, group: number): string {
  const sources = module.sources.map(([text, first]) =>
    text.replaceAll("TEXFOLD_GROUP", `${group}`).replace(/TEXFOLD_BINDING_(\d+)/g, (_, number: string) => `${first + +number}`),
  );
  return [wgsl.address, wgsl.sample, ...sources, module.entry].join("\n");
}

/** A shader with `vertex_main` and `fragment_main`: `draw` for trilinear lookups, `decode` for lookups within a level; the view is group 1. */
export function drawing(module: wgsl.Module, entry: "draw" | "decode"): string {
  return [sourcesOf(module, 0), wgsl.view, wgsl[entry]].join("\n");
}

/** A shader that draws a light field on its mesh; the camera is group 1. */
export function light(module: wgsl.Module): string {
  return sourcesOf(module, 0);
}

/** The compute shader that decodes blocks to `rgba8unorm` or `rgba32float`. */
export function blocks(target: "rgba8unorm" | "rgba32float"): string {
  const store = target === "rgba8unorm" ? wgsl.blockUnorm : wgsl.blockFloat;
  return [wgsl.blockPass, wgsl.block, wgsl.blockTexel, wgsl.blockEntry, store].join("\n");
}

export const modules = wgsl.modules;
