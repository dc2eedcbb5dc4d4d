export { type Layout, type MapInfo, type Notes, type PixelInfo, type Size } from "./container.js";
export { type Limits, LoadError } from "./errors.js";
export type { Blocks, Form, ImageBinding, Plane, PlaneFormat } from "./form.js";
export { tileSource } from "./tile_source.js";
export { arriving, open, openLayers, type Source, Texture } from "./texture.js";
export { type Camera, Gpu, GpuError, type GpuTexture, type Pixels, type Region, type Upload, type View } from "./gpu.js";
