// A cache of decoded tiles for any number of textures, filled by the GPU alone: the counterpart of `texfold_gpu::TileCache`, with the same
// shaders.

import { planeSide, planesOf, SIDE as BLOCK_SIDE, STAGE_LEVELS } from "./codecs/dct.js";
import { decodeBlocks } from "./codecs/dct_cpu.js";
import { atLevel, fullLevels, type Layout, pixelsOf, type Size } from "./container.js";
import { channelsOf } from "./decoder.js";
import { type Blocks, packedOffsets } from "./form.js";
import { WORDS } from "./generated/dct.js";
import {
  BORDER, CLAMP, FEEDBACK_BYTES, MOST_LEVELS, MOST_TILES, PLAN_BYTES, PLANES, SIDE, SRGB, STAGE_ROW_BYTES, TAIL_PLACES, TAIL_SIDE, TEXTURE_ROW_BYTES,
} from "./generated/tiles.js";
import type { Module } from "./generated/modules.js";
import { type Gpu, GpuError, type GpuTexture } from "./gpu.js";
import { BLOCK_NOTES, BLOCK_WORDS, levelsOf } from "./plan.js";
import { fill, layersOf, MOST_PARTS, type Part, partsOf, partsRow, refused, type TileContents } from "./tile_parts.js";
import { tileDrawing, tilePasses, tilePlan, tileSampling } from "./tile_shaders.js";
import type { Texture } from "./texture.js";

const INNER = SIDE - 2 * BORDER;
/** Texels along a side of a quarter of a tile, which holds a tail. */
const QUARTER = SIDE / 2;
const MOST_STAGES = Math.ceil(MOST_LEVELS / STAGE_LEVELS);
const FORMAT: GPUTextureFormat = "rgba8unorm";
const SRGB_FORMAT: GPUTextureFormat = "rgba8unorm-srgb";
/** Distance of the numbers of planes in their buffer: what every device allows. */
const STEP_STRIDE = 256;
/** A place of the pool that holds tails. */
const KEPT = 0xffffffff;

/** Sizes of a cache. */
export interface TileOptions {
  /** Bytes of decoded tiles, 64 KiB each, of materials 192 or 256: 64 MiB by default. Rounded down to whole layers, of 1, 4 or 16 MiB. */
  poolBytes?: number;
  /**
   * "textures" by default, each looked up by itself; or materials that `addMaterial` adds, "emissiveMaterials" where any emits light. Textures may
   * lie among materials, in as many layers.
   */
  contents?: TileContents;
  /** Bytes of compressed streams, 64 MiB by default. */
  streamBytes?: number;
  /** Most textures at a time, 256 by default. */
  textures?: number;
  /** Most tiles of all textures and levels, decoded or not, 131,072 by default: of a texture of 4096 texels a side 1593. */
  pages?: number;
  /** Most tiles that an update decodes, 1 to 64; 64 by default. */
  tilesPerUpdate?: number;
  /** Bytes of scratch memory of an update, 32 MiB by default: a tile takes 0.4 MB, one of two levels below a stage 4 MB. */
  scratchBytes?: number;
  /** Texels that the sampler reads along the longer axis of a pixel's footprint, 1 to 7; 4 by default. */
  anisotropy?: number;
  /** Of a square of so many pixels a side one marks, in each frame, the tiles that it reads: 1, 2, 4 or 8; 8 by default. */
  stride?: number;
}

/** Addressing and colours of a texture. */
export interface TileLook {
  /** Texture coordinates outside of 0 to 1; "repeat" by default. */
  address?: "repeat" | "clamp";
  /** Whether colours are sRGB and become linear light before they are filtered; by default what the texture's colour is. */
  srgb?: boolean;
}

/** The outcome of the last update. */
export interface TileReport {
  /** Tiles that it decoded. */
  decoded: number;
  /** Tiles that were looked at, and that it left for later. */
  missing: number;
  /** Mip levels that lookups add so that the pool suffices. */
  bias: number;
}

/** First and end. */
type Range = [number, number];

/** Free ranges of numbers from 0 on. */
class Ranges {
  private readonly free: Range[];

  constructor(start: number, end: number) {
    this.free = [[start, end]];
  }

  /** The first free range of that length; undefined where there is none. */
  take(length: number): Range | undefined {
    const at = this.free.findIndex(([start, end]) => end - start >= length);
    const found = this.free[at];
    if (!found) {
      return undefined;
    }
    const taken: Range = [found[0], found[0] + length];
    found[0] += length;
    if (found[0] === found[1]) {
      this.free.splice(at, 1);
    }
    return taken;
  }

  give([start, end]: Range): void {
    if (start === end) {
      return;
    }
    const found = this.free.findIndex((range) => range[0] >= end), at = found < 0 ? this.free.length : found;
    this.free.splice(at, 0, [start, end]);
    for (const [first, second] of [[at, at + 1], [at - 1, at]] as const) {
      const before = this.free[first], after = this.free[second];
      if (before && after && before[1] === after[0]) {
        before[1] = after[1];
        this.free.splice(second, 1);
      }
    }
  }
}

/** The pass that draws tiles of an image that is not in blocks. */
interface Source {
  number: number;
  texture: GpuTexture;
  pipeline: GPUComputePipeline;
  /** Number and place for the shader. */
  params: GPUBuffer;
  own: GPUBindGroup;
  drawn: GPUBindGroup;
}

/** An image's share of the cache. */
interface Held {
  look: Required<TileLook>;
  pages: Range;
  stages: Range;
  /** Words and streams of each stage, in words of the data. */
  data: Range[];
  source?: Source;
  /** Whether the maps of a material share it. */
  isMaterial: boolean;
}

/** An image to add. */
interface Prepared {
  size: Size;
  levels: number;
  /** Levels with tiles of their own, and the first one of the tail. */
  own: number;
  tail: number;
  /** What its tiles are decoded from: one image, or the maps of a material. */
  parts: Part[];
  /** Of each part, its stages with tiles of their own. */
  stages: Blocks[][];
  /** All stages of the image. */
  blocks: Blocks[];
  /** Of each part, texels of the levels of the tail. */
  tails: (Uint8Array | Uint8ClampedArray)[][];
  image: number;
  /** The whole texture, and what draws its tiles, where it is not in blocks. */
  uploaded: GpuTexture | undefined;
  pipeline: GPUComputePipeline | undefined;
}

interface Resources {
  pool: GPUTexture;
  data: GPUBuffer;
  textures: GPUBuffer;
  pages: GPUBuffer;
  feedback: GPUBuffer;
  slots: GPUBuffer;
  stages: GPUBuffer;
  plan: GPUBuffer;
  workgroups: GPUBuffer;
  options: GPUBuffer;
  steps: GPUBuffer;
  scratch: GPUBuffer;
}

interface Passes {
  plan: [GPUComputePipeline, GPUBindGroup];
  clear: GPUComputePipeline;
  read: GPUComputePipeline;
  transform: GPUComputePipeline;
  predict: GPUComputePipeline;
  deblock: GPUComputePipeline[];
  write: GPUComputePipeline;
  decode: GPUBindGroup;
  output: GPUBindGroup;
  sourceLayout: GPUBindGroupLayout;
}

/**
 * A cache of decoded tiles. Shaders that draw call `texfold_tile_sample` (`wgsl`), which marks the tiles it looks at; `update`, once a frame behind
 * these draws, decodes those that are missing. Until a tile is there the nearest coarser one shows. One bind group serves all textures.
 */
export class TileCache {
  private readonly held: (Held | undefined)[];
  private readonly freePages: Ranges;
  private readonly freeStages: Ranges;
  private readonly freeData: Ranges;
  private readonly drawing = new Map<Module, Promise<GPUComputePipeline>>();

  private constructor(
    private readonly gpu: Gpu,
    private readonly options: Required<TileOptions>,
    private readonly on: Resources,
    private readonly passes: Passes,
    /** Layout of `bindGroup`. */
    readonly bindGroupLayout: GPUBindGroupLayout,
    /** All textures: what a fragment shader binds. It stays the same as textures come and go. */
    readonly bindGroup: GPUBindGroup,
  ) {
    this.held = Array.from({ length: options.textures }, () => undefined);
    this.freePages = new Ranges(0, options.pages);
    this.freeStages = new Ranges(0, mostStages(options));
    // The words that all stages share come first; a place in the streams is 32 bits of bytes.
    this.freeData = new Ranges(WORDS.length, Math.max(WORDS.length, Math.floor(Math.min(options.streamBytes, 0xffffffff) / 4)));
  }

  /**
   * Makes the pool, buffers and pipelines.
   * @throws GpuError where the device's limits are lower than the options need, or the pool is too small for so many textures.
   */
  static async create(gpu: Gpu, given: TileOptions = {}): Promise<TileCache> {
    const options = {
      poolBytes: given.poolBytes ?? 64 << 20,
      streamBytes: wordBytes(given.streamBytes ?? 64 << 20),
      textures: clamped(given.textures ?? 256, 1, 1 << 20),
      pages: clamped(given.pages ?? 1 << 17, 1, 2 ** 31),
      tilesPerUpdate: clamped(given.tilesPerUpdate ?? MOST_TILES, 1, MOST_TILES),
      scratchBytes: wordBytes(given.scratchBytes ?? 32 << 20),
      anisotropy: clamped(given.anisotropy ?? 4, 1, 2 * BORDER - 1),
      stride: 2 ** Math.floor(Math.log2(clamped(given.stride ?? 8, 1, 8))),
      contents: given.contents ?? "textures",
    };
    const { limits } = gpu.device;
    const side = options.poolBytes < 4 << 20 ? 512 : options.poolBytes < 64 << 20 ? 1024 : 2048;
    const most = Math.min(Math.floor(options.poolBytes / (4 * side * side)), limits.maxTextureArrayLayers), each = layersOf(options.contents);
    const layers = Math.max(1, Math.floor(most / each)) * each, slots = (side / SIDE) ** 2 * (layers / each);
    if (Math.ceil(options.textures / 4) > slots / 2) {
      throw new GpuError("the smallest levels of so many textures would fill half of the pool; raise poolBytes");
    }
    const needs = [
      ["maxStorageBuffersPerShaderStage", 7],
      ["maxStorageBufferBindingSize", Math.max(options.streamBytes, options.scratchBytes, FEEDBACK_BYTES + 4 * options.pages)],
      ["maxTextureDimension2D", side],
    ] as const;
    for (const [limit, needed] of needs) {
      if (needed > limits[limit]) {
        throw new GpuError(`the cache needs ${limit} of ${needed}, the device was made with ${limits[limit]}; ask for more or take smaller options`);
      }
    }
    const on = await gpu.guarded(() => resourcesOf(gpu.device, options, [side, layers, slots]));
    return new TileCache(gpu, options, on, await passesOf(gpu.device, on), ...drawnOf(gpu.device, on, options.anisotropy));
  }

  /**
   * The WGSL to paste into shaders that draw, with `bindGroup` bound to `group`: `texfold_tile_sample(texture: u32, uv: vec2<f32>) -> vec4<f32>` in
   * uniform control flow, `texfold_tile_sample_grad(texture, uv, dpdx, dpdy)` and `texfold_tile_sample_level(texture, uv, lod)` in any. Pipelines
   * that draw colours alone may set the constant `TEXFOLD_TILE_COLOURS` to 1, those that draw other data alone to 0. Of materials
   * `texfold_tile_sample_material(material, uv) -> TexfoldTileMaterial`, `…_grad` and `…_level` give all maps from one lookup: `color` (with opacity),
   * `normal` from -1 to 1, `height`, `emissive`, `occlusion`, `roughness`, `metalness`.
   */
  wgsl(group: number): string {
    return tileSampling(group, this.options.anisotropy, this.options.stride);
  }

  /** Bytes of GPU memory of the whole cache: pool, streams, tables and scratch memory. */
  get bytes(): number {
    const { pool, ...buffers } = this.on;
    return Object.values(buffers).reduce((sum, { size }) => sum + size, 4 * pool.width * pool.height * pool.depthOrArrayLayers);
  }

  /**
   * Adds all images of a texture and gives their numbers in the order of its layout: the `texture` arguments of the WGSL functions.
   * @throws GpuError where the cache is full or the device refuses; nothing is added then.
   */
  async add(texture: Texture, look: TileLook = {}): Promise<number[]> {
    const prepared = await this.prepared(texture), added: number[] = [];
    const { layout } = texture;
    try {
      for (const image of prepared) {
        const free = this.held.indexOf(undefined);
        if (free < 0) {
          throw full("all textures are in use", "textures");
        }
        // Of a material's maps those of data stay as they are.
        const isColour = layout !== null && pixelsOf(layout, image.image).colour === "srgb";
        const srgb = layout?.maps ? isColour && look.srgb !== false : look.srgb ?? isColour;
        this.put(image, free, { address: look.address ?? "repeat", srgb });
        added.push(free);
      }
    } catch (error) {
      added.forEach((number) => this.remove(number));
      destroyUnused(prepared, this.held);
      throw error;
    }
    return added;
  }

  /**
   * Adds a material in superblocks (codec `dct`), whose maps `texfold_tile_sample_material` looks up together, and gives its number. The maps of a tile
   * are decoded together and share places of the pool. Maps that are missing read as 1, normals as (0, 0, 1). `texfold_tile_sample` of it gives base
   * colour and opacity.
   * Maps may have half, a quarter or an eighth of the sides of the largest: levels that they lack are enlarged.
   * @throws GpuError for maps of other sizes, of the kind "other", or two of a kind, which `add` takes; also as there. Nothing is added then.
   */
  async addMaterial(material: Texture, look: TileLook = {}): Promise<number> {
    const prepared = await this.prepared(material);
    try {
      const free = this.held.indexOf(undefined);
      if (free < 0) {
        throw full("all textures are in use", "textures");
      }
      this.putMaterial(prepared, material, free, look);
      return free;
    } finally {
      destroyUnused(prepared, this.held);
    }
  }

  /**
   * Puts another texture in the place of one that `add` gave as `textures`, or of one material, under the same numbers: a file of which more has arrived.
   * @throws GpuError as `add`, also where there is no room for both at once or the texture has fewer images: those from there on stay as they were.
   */
  async replace(textures: number[], texture: Texture): Promise<void> {
    const prepared = await this.prepared(texture);
    try {
      for (const [image, number] of textures.entries()) {
        const held = this.held[number], next = prepared[image];
        if (!held || !next) {
          throw new GpuError(`no image ${image}; the texture has ${prepared.length} images, or that of the cache was removed`);
        }
        if (held.isMaterial) {
          this.putMaterial(prepared, texture, number, held.look);
        } else {
          this.put(next, number, held.look);
        }
      }
    } finally {
      destroyUnused(prepared, this.held);
    }
  }

  /** Removes an image, not between `update` and the submission of its encoder; lookups of it give transparent black until another one takes its number. */
  remove(number: number): void {
    const held = this.held[number];
    if (held) {
      this.held[number] = undefined;
      this.write(this.on.textures, TEXTURE_ROW_BYTES * number, new Uint8Array(TEXTURE_ROW_BYTES));
      this.drop(held);
    }
  }

  /** Records the passes that decode what draws before it have looked at and not found: once a frame, behind these. */
  update(encoder: GPUCommandEncoder): void {
    const { plan, clear, read, transform, predict, deblock, write, decode, output } = this.passes;
    const pass = encoder.beginComputePass();
    pass.setPipeline(plan[0]);
    pass.setBindGroup(0, plan[1]);
    pass.dispatchWorkgroups(1);
    const dispatch = (pipeline: GPUComputePipeline, step: number, number: number): void => {
      pass.setPipeline(pipeline);
      pass.setBindGroup(0, decode, [step * STEP_STRIDE]);
      pass.dispatchWorkgroupsIndirect(this.on.workgroups, 12 * number);
    };
    dispatch(clear, 0, 0);
    dispatch(read, 0, 1);
    for (let plane = 0; plane < PLANES; plane++) {
      dispatch(transform, plane, 2 + plane);
    }
    // As many workgroups as for the superblocks of all planes.
    dispatch(predict, PLANES - 1, 1);
    deblock.forEach((pipeline) => dispatch(pipeline, PLANES - 1, 1 + PLANES));
    pass.setBindGroup(1, output);
    pass.setPipeline(write);
    pass.dispatchWorkgroupsIndirect(this.on.workgroups, 12 * (2 + PLANES));
    for (const { source } of this.held.filter((held) => held !== undefined)) {
      if (source) {
        pass.setPipeline(source.pipeline);
        pass.setBindGroup(0, source.own);
        pass.setBindGroup(1, source.drawn);
        pass.dispatchWorkgroupsIndirect(this.on.workgroups, 12 * (2 + PLANES + source.number));
      }
    }
    pass.end();
  }

  /** The outcome of the last update, read back: for tests and displays of statistics. */
  async report(): Promise<TileReport> {
    const { device } = this.gpu;
    const copy = device.createBuffer({ size: 16, usage: GPUBufferUsage.COPY_DST | GPUBufferUsage.MAP_READ });
    const encoder = device.createCommandEncoder();
    encoder.copyBufferToBuffer(this.on.feedback, 0, copy, 0, 16);
    device.queue.submit([encoder.finish()]);
    await copy.mapAsync(GPUMapMode.READ);
    const view = new DataView(copy.getMappedRange());
    const report = { decoded: view.getUint32(8, true), missing: view.getUint32(12, true), bias: view.getFloat32(4, true) };
    copy.destroy();
    return report;
  }

  /** Frees what the GPU holds. */
  destroy(): void {
    for (const source of this.held.flatMap((held) => held?.source ?? [])) {
      source.params.destroy();
      source.texture.destroy();
    }
    Object.values(this.on).forEach((resource: GPUTexture | GPUBuffer) => resource.destroy());
  }

  /** All images of a texture as they are added. */
  private async prepared(texture: Texture): Promise<Prepared[]> {
    const { layout, form } = texture;
    if (!layout) {
      throw new GpuError("a light field has no image; draw it with Gpu.drawLight()");
    }
    const isInBlocks = form.module === "bc" && form.blocks.length > 0;
    const isDecodedHere = isInBlocks && layout.levels > 1 && form.blocks.every((stage) => stage.layout.depth === 8);
    const uploaded = isDecodedHere ? undefined : await this.gpu.upload(texture);
    const pipeline = uploaded && !isInBlocks ? await this.drawingOf(uploaded.module) : undefined;
    const all: Prepared[] = [];
    for (const [image, size] of layout.images.entries()) {
      const levels = Math.min(layout.levels, fullLevels(size)), tail = tailOf(size), own = Math.min(levels, tail);
      const ofImage = form.blocks.filter((stage) => stage.image === image);
      const stages = isInBlocks ? ofImage.filter((stage) => stage.level < own) : [];
      if (own > MOST_LEVELS || stages.some((stage, number) => stage.level !== STAGE_LEVELS * number)) {
        throw new GpuError("an image is larger, or cut otherwise, than tiles expect; draw it with Gpu.draw()");
      }
      const tails: Prepared["tails"][number] = [];
      for (let level = tail; level < Math.min(Math.max(levels, tail + 1), fullLevels(size)); level++) {
        tails.push(await this.tailOf(uploaded, ofImage, layout, [image, level]));
      }
      const parts = [{ image, layer: 0 }];
      all.push({ size, levels, own, tail, parts, stages: [stages], blocks: isInBlocks ? ofImage : [], tails: [tails], image, uploaded: isInBlocks ? undefined : uploaded, pipeline });
    }
    if (isInBlocks) {
      uploaded?.destroy();
    }
    return all;
  }

  /** The texels of a level; of levels that the texture does not have, those in the middle of what each stands for. */
  private async tailOf(uploaded: GpuTexture | undefined, stages: Blocks[], layout: Layout, [image, level]: [number, number]): Promise<Prepared["tails"][number][number]> {
    const size = layout.images[image]!, { width, height } = atLevel(size, level);
    if (!uploaded) {
      const stage = stages.find((found) => level >= found.level && level < found.level + Math.min(found.levels, levelsOf(found.layout.size)));
      if (!stage) {
        throw new GpuError("a mip level is missing; draw the texture with Gpu.draw()");
      }
      return decodeBlocks(stage, { level: level - stage.level, x: 0, y: 0, width, height });
    }
    if (level < layout.levels) {
      return (await this.gpu.decode(uploaded, { image, level })).data;
    }
    const whole = (await this.gpu.decode(uploaded, { image })).data, texels = new Uint8Array(4 * width * height);
    for (let y = 0; y < height; y++) {
      for (let x = 0; x < width; x++) {
        const column = Math.floor(((2 * x + 1) * size.width) / (2 * width)), row = Math.floor(((2 * y + 1) * size.height) / (2 * height));
        const from = 4 * (row * size.width + column);
        texels.set(whole.subarray(from, from + 4), 4 * (y * width + x));
      }
    }
    return texels;
  }

  /** Puts the maps of a material under a number, in place of what has it. */
  private putMaterial(prepared: Prepared[], { layout }: Texture, number: number, look: TileLook): void {
    const { parts, isSrgb } = partsOf(layout!, layersOf(this.options.contents)), images = parts.map(({ image }) => prepared[image]!);
    if (images.some(({ uploaded }) => uploaded)) {
      throw refused("the texture is not in superblocks");
    }
    const whole = images.find((_, part) => !parts[part]!.halvings)!, address = look.address ?? "repeat";
    const stages = images.map(({ blocks }, part) => {
      const own = Math.max(whole.own - (parts[part]!.halvings ?? 0), Math.min(whole.own, 1));
      return blocks.filter((stage) => stage.level < own);
    });
    const tails = images.map((image, part) => whole.tails[0]!.map((_, index) => tailLevel(image, parts[part]!.halvings ?? 0, whole.tail + index, address)));
    this.put({ ...whole, parts, stages, tails }, number, { address, srgb: look.srgb !== false && isSrgb });
    this.held[number]!.isMaterial = true;
  }

  /** Puts an image under a number, in place of the one that has it. */
  private put(image: Prepared, number: number, look: Required<TileLook>): void {
    const words = image.stages.reduce((sum, stages) => sum + Math.max(0, ...stages.map(mostWords)), 0);
    if (4 * (words + BLOCK_WORDS) > this.options.scratchBytes) {
      throw full("a tile of this texture needs more scratch memory", "scratchBytes");
    }
    const held = this.reserve(image, look), before = this.held[number], { uploaded, pipeline } = image;
    if (uploaded && pipeline) {
      held.source = { number: number + 1, texture: uploaded, pipeline, ...this.sourceGroup(number + 1, image.image, uploaded) };
    }
    this.held[number] = held;
    image.stages.flat().forEach((stage, index) => this.writeStage(stage, held.stages[0] + index, held.data[2 * index]![0], held.data[2 * index + 1]![0]));
    this.write(this.on.pages, 4 * held.pages[0], new Uint8Array(4 * (held.pages[1] - held.pages[0])));
    this.writeTail(image, number, look);
    this.writeRow(image, number, held);
    if (before) {
      this.drop(before);
    }
  }

  private reserve({ size, own, stages: ofParts }: Prepared, look: Required<TileLook>): Held {
    const stages = ofParts.flat();
    let count = 0;
    for (let level = 0; level < own; level++) {
      count += tilesOf(atLevel(size, level)).reduce((all, tiles) => all * tiles, 1);
    }
    const held: Held = { look, pages: [0, 0], stages: [0, 0], data: [], isMaterial: false };
    const taken = (from: Ranges, length: number, what: string, option: string): Range => {
      const range = length > 0 ? from.take(length) : ([0, 0] as Range);
      if (!range) {
        this.free(held);
        throw full(what, option);
      }
      return range;
    };
    held.pages = taken(this.freePages, count, "all pages are in use", "pages");
    held.stages = taken(this.freeStages, stages.length, "all stages are in use", "textures");
    for (const stage of stages) {
      // The shader reads bytes as parts of two words.
      for (const words of [stage.words.length - WORDS.length, Math.ceil(stage.streams.length / 4) + 2]) {
        held.data.push(taken(this.freeData, words, "streams do not fit", "streamBytes"));
      }
    }
    return held;
  }

  private free({ pages, stages, data }: Held): void {
    data.forEach((range) => this.freeData.give(range));
    this.freeStages.give(stages);
    this.freePages.give(pages);
  }

  /** Frees a share, and what was uploaded for it alone. Places of the pool that still name its pages are free as soon as these name no place. */
  private drop(held: Held): void {
    this.write(this.on.pages, 4 * held.pages[0], new Uint8Array(4 * (held.pages[1] - held.pages[0])));
    this.free(held);
    held.source?.params.destroy();
    const texture = held.source?.texture;
    if (texture && !this.held.some((other) => other?.source?.texture === texture)) {
      texture.destroy();
    }
  }

  private write(buffer: GPUBuffer, at: number, data: ArrayBufferView): void {
    this.gpu.device.queue.writeBuffer(buffer, at, data as Uint8Array<ArrayBuffer>);
  }

  private writeStage({ layout, words, streams }: Blocks, number: number, first: number, streamWord: number): void {
    const shared = WORDS.length, moved = (word: number): number => word - shared + first;
    this.write(this.on.data, 0, words.subarray(0, shared));
    this.write(this.on.data, 4 * first, words.subarray(shared));
    const whole = streams.length & ~3, last = new Uint8Array(8);
    last.set(streams.subarray(whole));
    this.write(this.on.data, 4 * streamWord, streams.subarray(0, whole));
    this.write(this.on.data, 4 * streamWord + whole, last);
    const channels = channelsOf(layout);
    this.write(this.on.stages, STAGE_ROW_BYTES * number, Int32Array.from([
      ...channels.map(({ mean }) => mean), ...channels.map(({ firstAxis }) => firstAxis), ...channels.flatMap(({ weights }) => weights),
      layout.size.width, layout.size.height, first, moved(layout.steps), moved(layout.index), layout.indexBits, 4 * streamWord, layout.streamBytes,
      layout.superblockLog2 | (layout.baseLog2 << 8), layout.ranks.length, layout.ranks.reduceRight((all, rank) => (all << 2) | rank, 0), packedOffsets(layout),
      layout.deblocking, layout.shift, 2 ** layout.depth - 1, (layout.isLight ? 1 : 0) | (layout.isWeighted ? 2 : 0),
    ]));
  }

  /** Column and row in quarters of tiles, and layer, of the tail of a texture. */
  private tailPlace(number: number): [number, number, number] {
    const side = this.on.pool.width / SIDE, slot = number >> 2;
    const layer = Math.floor(slot / (side * side)) * layersOf(this.options.contents);
    return [2 * (slot % side) + (number & 1), 2 * (Math.floor(slot / side) % side) + ((number >> 1) & 1), layer];
  }

  private writeTail(image: Prepared, number: number, look: Required<TileLook>): void {
    const images = image.tails.map((tails) => tailTexels(image, tails, look)), [column, row, first] = this.tailPlace(number);
    for (let layer = 0; layer < layersOf(this.options.contents); layer++) {
      const texels = new Uint32Array(QUARTER * QUARTER).fill(0xffffffff), origin = [column * QUARTER, row * QUARTER, first + layer];
      image.parts.forEach((part, at) => fill(part, layer, texels, images[at]!));
      this.gpu.device.queue.writeTexture({ texture: this.on.pool, origin }, texels, { bytesPerRow: 4 * QUARTER }, [QUARTER, QUARTER, 1]);
    }
  }

  private writeRow({ size, levels, own, tail, parts }: Prepared, number: number, { look, pages, stages, source }: Held): void {
    const row = new Uint32Array(TEXTURE_ROW_BYTES / 4);
    const [column, line, layer] = this.tailPlace(number);
    const flags = (look.srgb ? SRGB : 0) | (look.address === "clamp" ? CLAMP : 0);
    row.set([size.width, size.height, levels | (tail << 8) | (flags << 16), column | (line << 8) | (layer << 16), stages[0], source?.number ?? 0, ...partsRow(parts)]);
    for (let level = 0, first = pages[0]; level < own; level++) {
      const [columns, rows] = tilesOf(atLevel(size, level));
      row.set([first, columns!], 8 + 2 * level);
      first += columns! * rows!;
    }
    this.write(this.on.textures, TEXTURE_ROW_BYTES * number, row);
  }

  private drawingOf(module: Module): Promise<GPUComputePipeline> {
    const { device } = this.gpu;
    const make = async (): Promise<GPUComputePipeline> => {
      const shader = device.createShaderModule({ code: await tileDrawing(module) });
      const layout = device.createPipelineLayout({ bindGroupLayouts: [this.passes.sourceLayout, this.gpu.layoutOf(module)] });
      return device.createComputePipelineAsync({ layout, compute: { module: shader, entryPoint: "draw_tiles" } });
    };
    const found = this.drawing.get(module) ?? make();
    this.drawing.set(module, found);
    return found;
  }

  private sourceGroup(number: number, image: number, { form, groups }: GpuTexture): Pick<Source, "params" | "own" | "drawn"> {
    const params = this.gpu.device.createBuffer({ size: 16, usage: GPUBufferUsage.UNIFORM | GPUBufferUsage.COPY_DST });
    this.write(params, 0, Uint32Array.of(number, form.images[image]!.image, 0, 0));
    const resources = [{ buffer: this.on.plan }, { buffer: this.on.textures }, stored(this.on.pool), { buffer: params }];
    return { params, own: grouped(this.gpu.device, this.passes.sourceLayout, resources), drawn: groups[image]! };
  }
}

/** Frees what was uploaded for images of which none is in the cache. */
function destroyUnused(prepared: Prepared[], held: (Held | undefined)[]): void {
  for (const { uploaded } of prepared) {
    if (uploaded && !held.some((other) => other?.source?.texture === uploaded)) {
      uploaded.destroy();
    }
  }
}

/** Stages of all textures. */
const mostStages = ({ textures, contents }: Required<TileOptions>): number => textures * MOST_STAGES * (contents === "textures" ? 1 : MOST_PARTS);

const full = (what: string, option: string): GpuError => new GpuError(`the cache of tiles is full: ${what}; raise ${option} or remove textures`);
const wordBytes = (bytes: number): number => Math.max(4, Math.ceil(bytes / 4) * 4);
const clamped = (value: number, low: number, high: number): number => Math.min(Math.max(value, low), high);
const tilesOf = ({ width, height }: Size): number[] => [Math.ceil(width / INNER), Math.ceil(height / INNER)];

/** The first level of an image that lies in its tail. */
function tailOf(size: Size): number {
  const side = Math.max(size.width, size.height);
  let level = 0;
  while (side >> level > TAIL_SIDE) {
    level++;
  }
  return level;
}

/** The column or row of an image of so many that one outside of it repeats. */
const addressed = (at: number, all: number, address: TileLook["address"]): number => (address === "clamp" ? clamped(at, 0, all - 1) : ((at % all) + all) % all);

/** Texels of an image whose sides are so often halves of those of a material, for a level of the material's tail; enlarged where the image is smaller. */
function tailLevel({ size, tail, tails }: Prepared, halvings: number, level: number, address: TileLook["address"]): Uint8Array | Uint8ClampedArray {
  const own = Math.max(level - halvings, 0), texels = tails[0]![own - tail]!, times = Math.max(halvings - level, 0);
  if (times === 0) {
    return texels;
  }
  const { width, height } = atLevel(size, own), scale = 1 << times, enlarged = new Uint8ClampedArray(4 * width * height * scale * scale);
  const taps = (at: number, all: number): [number, number][] => {
    const place = (at + 0.5) / scale - 0.5, low = Math.floor(place);
    return [[addressed(low, all, address), 1 - (place - low)], [addressed(low + 1, all, address), place - low]];
  };
  enlarged.forEach((_, at) => {
    const channel = at % 4, place = Math.floor(at / 4);
    let sum = 0;
    for (const [y, one] of taps(Math.floor(place / (width * scale)), height)) {
      for (const [x, other] of taps(place % (width * scale), width)) {
        sum += one * other * texels[4 * (y * width + x) + channel]!;
      }
    }
    enlarged[at] = Math.floor(sum + 0.5);
  });
  return enlarged;
}

/** The texels of an image's tail, of a quarter of a tile. */
function tailTexels({ size, tail }: Prepared, tails: Prepared["tails"][number], { address }: Required<TileLook>): Uint32Array {
  const texels = new Uint32Array(QUARTER * QUARTER);
  tails.forEach((decoded, index) => {
    const { width, height } = atLevel(size, tail + index), [left, top] = TAIL_PLACES[Math.min(index, TAIL_PLACES.length - 1)]!;
    const from = new Uint32Array(decoded.buffer, decoded.byteOffset, width * height);
    for (let y = -BORDER; y < height + BORDER; y++) {
      for (let x = -BORDER; x < width + BORDER; x++) {
        texels[(top! + BORDER + y) * QUARTER + left! + BORDER + x] = from[addressed(y, height, address) * width + addressed(x, width, address)]!;
      }
    }
  });
  return texels;
}

/** Most words of scratch memory that a tile of a stage takes, of its coarsest level. */
function mostWords({ layout, levels }: Blocks): number {
  const around = 1 << (levels - 1);
  let count = [SIDE * around, SIDE * around], sum = 0;
  for (const [plane, size] of planesOf(layout.size).entries()) {
    const side = planeSide(layout, plane);
    const blocks = (texels: number, all: number): number => (Math.min(Math.ceil(texels / side) + 1, Math.ceil(all / side)) * side) / BLOCK_SIDE;
    count = [blocks(count[0]!, size.width), blocks(count[1]!, size.height)];
    sum += count[0]! * count[1]! * layout.ranks.length * (BLOCK_WORDS + BLOCK_NOTES);
    // The means of these blocks and of those around them.
    count = count.map((texels) => texels + 2);
  }
  return sum;
}

const stored = (pool: GPUTexture): GPUTextureView => viewOf(pool, FORMAT, GPUTextureUsage.STORAGE_BINDING);

function viewOf(pool: GPUTexture, format: GPUTextureFormat, usage: number): GPUTextureView {
  return pool.createView({ format, usage, dimension: "2d-array" });
}

function grouped(device: GPUDevice, layout: GPUBindGroupLayout, resources: GPUBindingResource[]): GPUBindGroup {
  return device.createBindGroup({ layout, entries: resources.map((resource, binding) => ({ binding, resource })) });
}

type Binding = Omit<GPUBindGroupLayoutEntry, "binding" | "visibility">;
const READ: Binding = { buffer: { type: "read-only-storage" } };
const WRITE: Binding = { buffer: { type: "storage" } };
const UNIFORM: Binding = { buffer: { type: "uniform" } };
const POOL: Binding = { storageTexture: { format: FORMAT, viewDimension: "2d-array" } };

/** Pool and buffers of those sizes: texels a side of the pool, layers, places of tiles. */
function resourcesOf(device: GPUDevice, options: Required<TileOptions>, [side, layers, slots]: [number, number, number]): Resources {
  const buffer = (size: number, usage = 0): GPUBuffer =>
    device.createBuffer({ size: wordBytes(size), usage: usage | GPUBufferUsage.STORAGE | GPUBufferUsage.COPY_DST });
  const uniform = (data: Uint8Array<ArrayBuffer>): GPUBuffer => {
    const made = device.createBuffer({ size: data.length, usage: GPUBufferUsage.UNIFORM | GPUBufferUsage.COPY_DST });
    device.queue.writeBuffer(made, 0, data);
    return made;
  };
  const settings = Uint32Array.of(slots, options.tilesPerUpdate, options.scratchBytes / 4, options.textures, side / SIDE, layersOf(options.contents), 0, 0, 0, 0, 0, 0);
  // A plane; the first byte of the streams, and the bytes of their only buffer.
  const steps = new Uint32Array((STEP_STRIDE / 4) * PLANES);
  for (let plane = 0; plane < PLANES; plane++) {
    steps.set([plane, 0, options.streamBytes], (STEP_STRIDE / 4) * plane);
  }
  const usage = GPUTextureUsage.STORAGE_BINDING | GPUTextureUsage.TEXTURE_BINDING | GPUTextureUsage.COPY_DST;
  const on: Resources = {
    pool: device.createTexture({ label: "tiles", size: [side, side, layers], format: FORMAT, usage, viewFormats: [SRGB_FORMAT] }),
    data: buffer(options.streamBytes),
    textures: buffer(TEXTURE_ROW_BYTES * options.textures),
    pages: buffer(4 * options.pages),
    feedback: buffer(FEEDBACK_BYTES + 4 * options.pages, GPUBufferUsage.COPY_SRC),
    slots: buffer(4 * slots),
    stages: buffer(STAGE_ROW_BYTES * mostStages(options)),
    plan: buffer(PLAN_BYTES),
    workgroups: buffer(12 * (3 + PLANES + options.textures), GPUBufferUsage.INDIRECT),
    options: uniform(new Uint8Array(settings.buffer)),
    steps: uniform(new Uint8Array(steps.buffer)),
    scratch: buffer(options.scratchBytes),
  };
  // The first frame has the number 1: pages that were never looked at have the mark 0.
  device.queue.writeBuffer(on.feedback, 0, Uint32Array.of(1));
  device.queue.writeBuffer(on.slots, 0, new Uint32Array(Math.ceil(options.textures / 4)).fill(KEPT));
  return on;
}

function layoutOf(device: GPUDevice, visibility: number, bindings: Binding[]): GPUBindGroupLayout {
  return device.createBindGroupLayout({ entries: bindings.map((entry, binding) => ({ binding, visibility, ...entry })) });
}

/** All that an update dispatches. */
async function passesOf(device: GPUDevice, on: Resources): Promise<Passes> {
  const compute = (bindings: Binding[]): GPUBindGroupLayout => layoutOf(device, GPUShaderStage.COMPUTE, bindings);
  const pipeline = (module: GPUShaderModule, entryPoint: string, layouts: GPUBindGroupLayout[]): Promise<GPUComputePipeline> =>
    device.createComputePipelineAsync({ layout: device.createPipelineLayout({ bindGroupLayouts: layouts }), compute: { module, entryPoint } });
  const planLayout = compute([READ, WRITE, WRITE, WRITE, READ, WRITE, WRITE, UNIFORM]);
  const planned = [on.textures, on.pages, on.feedback, on.slots, on.stages, on.plan, on.workgroups, on.options];
  const decodeLayout = compute([READ, READ, READ, WRITE, { buffer: { type: "uniform", hasDynamicOffset: true } }]);
  const decoded = [{ buffer: on.plan }, { buffer: on.data }, { buffer: on.data }, { buffer: on.scratch }, { buffer: on.steps, size: 12 }];
  const outputLayout = compute([READ, READ, POOL]);
  const planModule = device.createShaderModule({ code: tilePlan() }), module = device.createShaderModule({ code: tilePasses() });
  const names = ["clear_scratch", "read_superblocks", "transform_blocks", "predict_blocks", "deblock_columns", "deblock_rows"];
  const [plan, write, clear, read, transform, predict, ...deblock] = await Promise.all([
    pipeline(planModule, "plan_tiles", [planLayout]),
    pipeline(module, "write_tiles", [decodeLayout, outputLayout]),
    ...names.map((name) => pipeline(module, name, [decodeLayout])),
  ]);
  return {
    plan: [plan!, grouped(device, planLayout, planned.map((buffer) => ({ buffer })))],
    clear: clear!,
    read: read!,
    transform: transform!,
    predict: predict!,
    deblock,
    write: write!,
    decode: grouped(device, decodeLayout, decoded),
    output: grouped(device, outputLayout, [{ buffer: on.textures }, { buffer: on.stages }, stored(on.pool)]),
    sourceLayout: compute([READ, READ, POOL, UNIFORM]),
  };
}

/** Bindings of shaders that draw from the cache. */
function drawnOf(device: GPUDevice, on: Resources, maxAnisotropy: number): [GPUBindGroupLayout, GPUBindGroup] {
  const texture: Binding = { texture: { viewDimension: "2d-array" } };
  const layout = layoutOf(device, GPUShaderStage.FRAGMENT, [READ, READ, WRITE, texture, texture, { sampler: {} }]);
  const sampler = device.createSampler({ magFilter: "linear", minFilter: "linear", mipmapFilter: "linear", maxAnisotropy });
  const pools = [FORMAT, SRGB_FORMAT].map((format) => viewOf(on.pool, format, GPUTextureUsage.TEXTURE_BINDING));
  return [layout, grouped(device, layout, [{ buffer: on.textures }, { buffer: on.pages }, { buffer: on.feedback }, ...pools, sampler])];
}
