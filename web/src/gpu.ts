// Textures on a GPU: uploaded, decoded where they are in blocks, drawn by the WGSL of their codec, read back.

import { plainForm, STAGE_LEVELS } from "./codecs/dct.js";
import { atLevel, fullLevels, type Layout, type Size } from "./container.js";
import { Decoder, targetOf } from "./decoder.js";
import { type Blocks, type Form, FORMATS, type ImageBinding, type Plane } from "./form.js";
import { type Module, modules } from "./generated/modules.js";
import { drawing, light } from "./shaders.js";
import type { Texture } from "./texture.js";

/** Why a texture cannot be drawn; the message says what to do. */
export class GpuError extends Error {
  override name = "GpuError";
}

/** What is drawn into a canvas or a texture. */
export interface View {
  /** Number of the image; 0 by default. */
  image?: number;
  /** Column and row of the image's level 0 at the upper left corner of the target, in texels; 0 by default. */
  x?: number;
  y?: number;
  /** Pixels of the target for each texel of level 0, 1 by default. */
  scale?: number;
  /** Draws one mip level, texel by texel; by default the level that fits, filtered. */
  level?: number;
  /** Draws texels as squares. */
  nearest?: boolean;
  /** What shows where the image is not or is transparent: red, green, blue from 0 to 1; black by default. */
  background?: [number, number, number];
  /** First column of the target that is drawn; what lies to the left stays as it is. 0 by default: the target is cleared. */
  from?: number;
  /** Leaves what the target shows outside of the image as it is: for images side by side. */
  keep?: boolean;
}

/** From where a light field is drawn. */
export interface Camera {
  /** From the mesh's space to clip space with depths 0 to 1: 16 numbers, column by column. */
  viewProjection: ArrayLike<number>;
  /** Where the camera is, in the mesh's space. */
  eye: [number, number, number];
  /** Most terms to draw beside the mean; all that are loaded by default. */
  terms?: number;
  background?: [number, number, number, number?];
}

/** How images in blocks are decoded. */
export interface Upload {
  /** Finest mip levels follow in parts, while coarser ones are drawn: `complete` tells when all are there. */
  coarseFirst?: boolean;
  /** By compute passes, by the CPU (8 bits a sample alone), or by what is faster: the CPU for coarse levels that are wanted first, as pipelines
   * take time to be made, and where the adapter is a software renderer. The texels are the same. */
  blocks?: "gpu" | "cpu" | "auto";
  /** Finest mip level that is wanted of images in blocks, 0 by default; rounded down to a multiple of three. */
  finest?: number;
}

/** A rectangle of texels of a mip level. */
export interface Region {
  image?: number;
  level?: number;
  x?: number;
  y?: number;
  width?: number;
  height?: number;
}

/** Texels of a region as an `ImageData` takes them: RGBA, row by row. */
export interface Pixels {
  width: number;
  height: number;
  data: Uint8ClampedArray<ArrayBuffer>;
}

/** Numbers of lookups in the shaders. */
const DRAW = { entry: "draw", lookup: 0 } as const;
const FETCH = { entry: "decode", lookup: 0 } as const;
const NEAREST = { entry: "decode", lookup: 1 } as const;
const BILINEAR = { entry: "decode", lookup: 2 } as const;
type Lookup = typeof DRAW | typeof FETCH | typeof NEAREST | typeof BILINEAR;

const VIEW_BYTES = 64;
const SCENE_BYTES = 80;
/** Texels of level 0 that are decoded on the CPU between two frames. */
const BAND_TEXELS = 1 << 20;
const DEPTH_FORMAT: GPUTextureFormat = "depth32float";
/** Rows of a copy begin at multiples of so many bytes. */
const ROW_BYTES = 256;

/** A texture on a GPU. */
export class GpuTexture {
  /** Resolves when all mip levels can be drawn. */
  complete: Promise<void> = Promise.resolve();
  /** Finest mip levels of the file that are not there, as the device cannot hold them: its level 0 is the file's level of this number. */
  skippedLevels = 0;
  /** Finest mip level of each image in blocks that can be drawn so far. */
  readonly finest: number[] = [];
  /** Whether `destroy` was called. */
  isDestroyed = false;

  constructor(
    /** Sizes and mip levels of the images as they are on the GPU; null for a light field. */
    readonly layout: Pick<Layout, "images" | "levels"> & Partial<Pick<Layout, "alpha" | "maps">> | null,
    readonly form: Form,
    readonly module: Module,
    /** Constants of pipelines that draw it. */
    readonly constants: Record<string, number>,
    /** Bind group of each image. */
    readonly groups: GPUBindGroup[],
    /** Bytes of its textures and buffers on the GPU. */
    readonly residentBytes: number,
    /** Parameters on the GPU, of each binding. */
    readonly params: GPUBuffer[],
    private readonly owned: (GPUTexture | GPUBuffer)[],
  ) {}

  /** Frees what the GPU holds. */
  destroy(): void {
    this.isDestroyed = true;
    this.owned.forEach((resource) => resource.destroy());
  }
}

/** An image in blocks: the stages of its mip levels, and the plain texture that they are decoded to. */
interface Decoded {
  stages: Blocks[];
  texture: GPUTexture;
  bytes: number;
}

/** A device, and the pipelines that were made on it. */
export class Gpu {
  private readonly pipelines = new Map<string, Promise<GPURenderPipeline>>();
  private readonly layouts = new Map<Module, GPUBindGroupLayout>();
  private decoder: Promise<Decoder> | undefined;
  private readonly viewLayout: GPUBindGroupLayout;

  /** On a device of the caller's. For BC content it needs the feature `texture-compression-bc`. */
  constructor(readonly device: GPUDevice) {
    const entries = [{ binding: 0, visibility: GPUShaderStage.VERTEX | GPUShaderStage.FRAGMENT, buffer: {} }];
    this.viewLayout = device.createBindGroupLayout({ entries });
  }

  /**
   * On a device of its own.
   * @throws GpuError where the browser has no WebGPU or no adapter.
   */
  static async create(): Promise<Gpu> {
    const adapter = await (globalThis.navigator as Navigator | undefined)?.gpu?.requestAdapter();
    if (!adapter) {
      throw new GpuError("no WebGPU here; open the page in a browser with WebGPU (Chrome, Edge, Safari 26, Firefox 141 or later) and a GPU that it allows");
    }
    const wanted: GPUFeatureName[] = ["texture-compression-bc", "float32-filterable"];
    const { maxStorageBufferBindingSize, maxBufferSize, maxTextureDimension2D } = adapter.limits;
    const device = await adapter.requestDevice({
      requiredFeatures: wanted.filter((feature) => adapter.features.has(feature)),
      requiredLimits: { maxStorageBufferBindingSize, maxBufferSize, maxTextureDimension2D },
    });
    return new Gpu(device);
  }

  /**
   * Uploads all planes of a texture. Images in blocks are decoded with all mip levels into plain textures, from the finest level on that the
   * device can hold.
   * @throws GpuError where the device cannot hold or sample it.
   */
  async upload(texture: Texture, options: Upload = {}): Promise<GpuTexture> {
    const { form, layout, skipped } = this.fitting(texture, options.finest ?? 0), module = modules[form.module]!;
    this.check(form);
    const buffers: GPUBuffer[] = [];
    const { planes, decoded, groups } = await this.guarded(() => {
      const planes = form.planes.map((plane) => this.plane(plane));
      const decoded = imagesOf(form.blocks).map((stages) => this.decodedOf(stages));
      return { planes, decoded, groups: this.groups(module, form, [...planes, ...decoded.map(({ texture: made }) => made)], buffers) };
    });
    const bytes = decoded.reduce((sum, made) => sum + made.bytes, form.uniforms.length);
    const resident = form.planes.reduce((sum, plane) => sum + plane.data.length, bytes);
    const owned = [...planes, ...decoded.map(({ texture: made }) => made), ...buffers];
    const made = new GpuTexture(layout, form, module, constantsOf(module, form), groups, resident, buffers, owned);
    made.skippedLevels = skipped;
    await this.decodeAll(made, decoded, options);
    return made;
  }

  /** A plain image, such as the one that a texture was made from, to be drawn like a texture: without mip levels. */
  uploadImage(image: ImageBitmap): GpuTexture {
    const { width, height } = image, format = "rgba8unorm", module = modules.bc!;
    const usage = GPUTextureUsage.TEXTURE_BINDING | GPUTextureUsage.COPY_DST | GPUTextureUsage.RENDER_ATTACHMENT;
    const texture = this.device.createTexture({ size: { width, height }, format, usage });
    this.device.queue.copyExternalImageToTexture({ source: image }, { texture, premultipliedAlpha: false }, { width, height });
    const form = plainForm({ images: [{ width, height }], levels: 1 }, []);
    const buffers: GPUBuffer[] = [];
    const groups = this.groups(module, form, [texture], buffers);
    const layout = { images: [{ width, height }], levels: 1 };
    return new GpuTexture(layout, form, module, constantsOf(module, form), groups, 4 * width * height, buffers, [texture, ...buffers]);
  }

  /**
   * What `make` gives, once the device has taken all that it made.
   * @throws GpuError where the device refuses.
   */
  async guarded<T>(make: () => T): Promise<T> {
    this.device.pushErrorScope("validation");
    this.device.pushErrorScope("out-of-memory");
    const made = make();
    const faults = await Promise.all([this.device.popErrorScope(), this.device.popErrorScope()]);
    const fault = faults.find((found) => found !== null);
    if (fault) {
      throw new GpuError(`the device refuses so much memory; free other textures or take a smaller one: ${fault.message}`);
    }
    return made;
  }

  /** A texture without the stages of images in blocks that are too large for the device or finer than wanted, where it has coarser ones. */
  private fitting({ codec, layout, form }: Texture, finest: number): { form: Form; layout: GpuTexture["layout"]; skipped: number } {
    const limit = this.device.limits.maxTextureDimension2D;
    const side = codec === "dct" && layout ? Math.max(...layout.images.flatMap(({ width, height }) => [width, height])) : 0;
    const least = Math.ceil(Math.max(0, Math.log2(side / limit)) / STAGE_LEVELS) * STAGE_LEVELS;
    const skipped = Math.max(least, Math.floor(finest / STAGE_LEVELS) * STAGE_LEVELS);
    if (!layout || codec !== "dct" || skipped === 0 || skipped >= layout.levels) {
      return { form, layout, skipped: 0 };
    }
    const fewer = { ...layout, images: layout.images.map((size) => atLevel(size, skipped)), levels: layout.levels - skipped };
    const blocks = form.blocks.filter(({ level }) => level >= skipped).map((stage) => ({ ...stage, level: stage.level - skipped }));
    return { form: plainForm(fewer, blocks), layout: fewer, skipped };
  }

  private check(form: Form): void {
    const limit = this.device.limits.maxTextureDimension2D;
    const sizes: Size[] = [...form.planes, ...form.blocks.map(({ layout }) => layout.size)];
    const large = sizes.find(({ width, height }) => Math.max(width, height) > limit);
    if (large) {
      throw new GpuError(`a plane of ${large.width}x${large.height} texels, the device takes ${limit} a side; draw it tile by tile or take a smaller texture`);
    }
    const bc = form.planes.find(({ format }) => format.startsWith("bc"));
    if (bc && !this.device.features.has("texture-compression-bc")) {
      throw new GpuError(`this device cannot sample ${bc.format}; take a texture of blocks (codec dct) or of raw content`);
    }
  }

  private plane(plane: Plane): GPUTexture {
    const [bytes, side] = FORMATS[plane.format];
    const whole = (size: Size): Size => ({ width: Math.ceil(size.width / side) * side, height: Math.ceil(size.height / side) * side });
    const levels = Math.min(plane.levels, fullLevels(plane));
    const texture = this.device.createTexture({
      label: plane.part,
      size: whole(plane),
      mipLevelCount: levels,
      format: plane.format,
      usage: GPUTextureUsage.TEXTURE_BINDING | GPUTextureUsage.COPY_DST,
    });
    let start = 0;
    for (let mipLevel = 0; mipLevel < levels; mipLevel++) {
      const size = whole(atLevel(plane, mipLevel));
      const bytesPerRow = (size.width / side) * bytes, end = start + bytesPerRow * (size.height / side);
      this.device.queue.writeTexture({ texture, mipLevel }, plane.data.subarray(start, end) as Uint8Array<ArrayBuffer>, { bytesPerRow }, size);
      start = end;
    }
    return texture;
  }

  /** Whether a stage is decoded on the CPU. */
  private isForCpu({ layout, level }: Blocks, { coarseFirst, blocks = "auto" }: Upload): boolean {
    const { isFallbackAdapter, architecture } = this.device.adapterInfo as GPUAdapterInfo & { isFallbackAdapter?: boolean };
    const isFaster = isFallbackAdapter === true || architecture === "swiftshader" || (coarseFirst === true && level > 0);
    return layout.depth === 8 && blocks !== "gpu" && (blocks === "cpu" || isFaster);
  }

  /** Decodes all stages, the coarsest first; with `coarseFirst` those of level 0 in parts, behind the promise `complete`. */
  private async decodeAll(made: GpuTexture, all: Decoded[], options: Upload): Promise<void> {
    const { coarseFirst = false } = options, stages = all.flatMap((decoded) => decoded.stages);
    if (stages.some((stage) => !this.isForCpu(stage, options))) {
      this.decoder ??= Decoder.create(this.device);
    }
    const isLate = ({ stages }: Decoded, level: number): boolean => coarseFirst && level === 0 && stages.some((stage) => stage.level > 0);
    const decode = async (late: boolean): Promise<void> => {
      for (const [image, decoded] of all.entries()) {
        for (const stage of decoded.stages.toReversed()) {
          if (isLate(decoded, stage.level) === late && !made.isDestroyed) {
            if (this.isForCpu(stage, options)) {
              await this.decodeOnCpu(stage, decoded.texture, late ? () => made.isDestroyed : undefined);
            } else {
              await (await this.decoder!).decode(stage, decoded.texture, late);
            }
            made.finest[image] = stage.level;
          }
        }
      }
    };
    await decode(false);
    made.complete = decode(true);
  }

  /** Decodes a stage on the CPU into its mip levels: whole, or band by band with time for frames in between, until `isOver`. */
  private async decodeOnCpu(stage: Blocks, texture: GPUTexture, isOver?: () => boolean): Promise<void> {
    const { decodeBlocks } = await import("./codecs/dct_cpu.js");
    for (let level = 0; level < stage.levels; level++) {
      const { width, height } = atLevel(stage.layout.size, level), band = isOver ? Math.ceil(BAND_TEXELS / width / 64) * 64 >> level : height;
      for (let y = 0; y < height && !isOver?.(); y += band) {
        const rows = Math.min(band, height - y), mipLevel = stage.level + level;
        const texels = decodeBlocks(stage, { level, x: 0, y, width, height: rows });
        this.device.queue.writeTexture({ texture, mipLevel, origin: [0, y + stage.row] }, texels, { bytesPerRow: 4 * width }, [width, rows]);
        if (isOver) {
          await new Promise((resolve) => setTimeout(resolve));
        }
      }
    }
  }

  /** An empty texture for the stages of an image. */
  private decodedOf(stages: Blocks[]): Decoded {
    const [first] = stages, { layout } = first!;
    const height = Math.max(...stages.filter(({ level }) => level === 0).map((stage) => stage.row + stage.layout.size.height));
    const size = { width: layout.size.width, height }, format = targetOf(layout);
    const levels = Math.max(...stages.map((stage) => stage.level + stage.levels));
    const texture = this.device.createTexture({
      label: "decoded blocks",
      size,
      mipLevelCount: levels,
      format,
      usage: GPUTextureUsage.TEXTURE_BINDING | GPUTextureUsage.STORAGE_BINDING | GPUTextureUsage.COPY_DST,
    });
    let bytes = 0;
    for (let level = 0; level < levels; level++) {
      const { width, height: rows } = atLevel(size, level);
      bytes += width * rows * (format === "rgba8unorm" ? 4 : 16);
    }
    return { stages, texture, bytes };
  }

  /** Bindings of a module. */
  layoutOf(module: Module): GPUBindGroupLayout {
    let layout = this.layouts.get(module);
    if (!layout) {
      const visibility = GPUShaderStage.VERTEX | GPUShaderStage.FRAGMENT | GPUShaderStage.COMPUTE;
      const entries = module.bindings.map((kind, binding): GPUBindGroupLayoutEntry => {
        if (typeof kind === "number") {
          return { binding, visibility, buffer: {} };
        }
        return { binding, visibility, texture: { sampleType: kind === "uint" ? "uint" : "unfilterable-float" } };
      });
      layout = this.device.createBindGroupLayout({ entries });
      this.layouts.set(module, layout);
    }
    return layout;
  }

  /** Bind groups of all images; those of the same parameters and planes share one. */
  private groups(module: Module, form: Form, planes: GPUTexture[], buffers: GPUBuffer[]): GPUBindGroup[] {
    const known = new Map<string, GPUBindGroup>();
    return form.images.map((image) => {
      const key = [image.uniforms[0], ...image.planes].join();
      const group = known.get(key) ?? this.group(module, form, image, planes, buffers);
      known.set(key, group);
      return group;
    });
  }

  private group(module: Module, form: Form, image: ImageBinding, planes: GPUTexture[], buffers: GPUBuffer[]): GPUBindGroup {
    let byte = image.uniforms[0], plane = 0;
    const entries = module.bindings.map((kind, binding): GPUBindGroupEntry => {
      if (typeof kind !== "number") {
        return { binding, resource: planes[image.planes[plane++]!]!.createView() };
      }
      const buffer = this.device.createBuffer({ size: kind, usage: GPUBufferUsage.UNIFORM | GPUBufferUsage.COPY_DST });
      this.device.queue.writeBuffer(buffer, 0, form.uniforms.slice(byte, byte + kind));
      byte += kind;
      buffers.push(buffer);
      return { binding, resource: { buffer } };
    });
    return this.device.createBindGroup({ layout: this.layoutOf(module), entries });
  }

  private pipeline(drawn: GpuTexture, { entry, lookup }: Lookup, format: GPUTextureFormat, blends: boolean): Promise<GPURenderPipeline> {
    const key = [drawn.form.module, entry, lookup, format, blends, ...Object.entries(drawn.constants)].join();
    return this.kept(key, async () => {
      const { device } = this, module = device.createShaderModule({ code: await drawing(drawn.module, entry) });
      const over: GPUBlendComponent = { srcFactor: "src-alpha", dstFactor: "one-minus-src-alpha" };
      const keep: GPUBlendComponent = { srcFactor: "zero", dstFactor: "one" };
      return device.createRenderPipelineAsync({
        layout: device.createPipelineLayout({ bindGroupLayouts: [this.layoutOf(drawn.module), this.viewLayout] }),
        vertex: { module, entryPoint: "vertex_main" },
        fragment: {
          module,
          entryPoint: "fragment_main",
          constants: { LOOKUP: lookup, ...drawn.constants },
          targets: [blends ? { format, blend: { color: over, alpha: keep } } : { format }],
        },
      });
    });
  }

  /** A pipeline that was made before, or is made now. */
  private kept(key: string, make: () => Promise<GPURenderPipeline>): Promise<GPURenderPipeline> {
    const found = this.pipelines.get(key) ?? make();
    this.pipelines.set(key, found);
    return found;
  }

  /** Parameters of a view, in a bind group. */
  private view(origin: [number, number], across: number, down: number, level: number, image: number, offset: [number, number]): [GPUBindGroup, GPUBuffer] {
    const buffer = this.device.createBuffer({ size: VIEW_BYTES, usage: GPUBufferUsage.UNIFORM, mappedAtCreation: true });
    const bytes = buffer.getMappedRange();
    new Float32Array(bytes).set([...origin, across, 0, 0, down, 1, 1, ...offset, level]);
    new Uint32Array(bytes).set([level, image], 11);
    buffer.unmap();
    const entries = [{ binding: 0, resource: { buffer } }];
    return [this.device.createBindGroup({ layout: this.viewLayout, entries }), buffer];
  }

  private render(pipeline: GPURenderPipeline, groups: GPUBindGroup[], target: GPUTexture, clear: number[] | null, area?: number[], level = 0): GPUCommandEncoder {
    const encoder = this.device.createCommandEncoder();
    const attachment: GPURenderPassColorAttachment = { view: target.createView({ baseMipLevel: level, mipLevelCount: 1 }), ...(clear ? { clearValue: clear } : {}), loadOp: clear ? "clear" : "load", storeOp: "store" };
    const pass = encoder.beginRenderPass({ colorAttachments: [attachment] });
    pass.setPipeline(pipeline);
    groups.forEach((group, number) => pass.setBindGroup(number, group));
    if (area) {
      pass.setScissorRect(area[0]!, area[1]!, area[2]!, area[3]!);
    }
    pass.draw(3);
    pass.end();
    return encoder;
  }

  /**
   * Draws an image into the current texture of a canvas that is configured for this device, or into any texture of a format that can be drawn to.
   * Values are drawn as they are stored. Resolves when the commands are submitted.
   */
  async draw(drawn: GpuTexture, context: GPUCanvasContext | GPUTexture, view: View = {}): Promise<void> {
    const image = view.image ?? 0, size = this.sizeOf(drawn, image);
    const scale = view.scale ?? 1, { x = 0, y = 0 } = view;
    // Levels that are still to be decoded are drawn from the finest that is there.
    const finest = drawn.finest[image] ?? 0;
    const level = view.level === undefined ? (finest > 0 && -Math.log2(scale) < finest ? finest : undefined) : Math.max(view.level, finest);
    const lookup = level !== undefined || view.nearest ? (view.nearest ? NEAREST : BILINEAR) : DRAW;
    const format = formatOf(context);
    const pipeline = await this.pipeline(drawn, lookup, format, true);
    // After waiting: a canvas's texture is of the current frame only.
    const target = targetOfContext(context);
    const binding = drawn.form.images[image]!;
    const origin: [number, number] = [x / size.width, y / size.height];
    const [group, buffer] = this.view(origin, 1 / scale / size.width, 1 / scale / size.height, level ?? 0, binding.image, [0, 0]);
    const left = Math.max(0, Math.round(-x * scale)), top = Math.max(0, Math.round(-y * scale));
    const right = Math.min(target.width, Math.round((size.width - x) * scale)), bottom = Math.min(target.height, Math.round((size.height - y) * scale));
    const first = Math.min(Math.max(left, view.from ?? 0), target.width);
    const area = [first, Math.min(top, target.height), Math.max(0, right - first), Math.max(0, bottom - top)];
    const clear = view.from || view.keep ? null : [...(view.background ?? [0, 0, 0]), 1];
    const encoder = this.render(pipeline, [drawn.groups[image]!, group], target, clear, area);
    this.device.queue.submit([encoder.finish()]);
    buffer.destroy();
  }

  /**
   * Draws a light field as a camera sees it, the nearest triangle in front, into the current texture of a canvas that is configured for this
   * device or into any texture that can be drawn to. Resolves when the commands are submitted.
   */
  async drawLight(drawn: GpuTexture, context: GPUCanvasContext | GPUTexture, camera: Camera): Promise<void> {
    const { device } = this, { module, form } = drawn, places = module.light;
    if (!places) {
      throw new GpuError("an image is no light field; draw it with draw()");
    }
    const format = formatOf(context);
    const pipeline = await this.kept(`light,${format}`, () => this.lightPipeline(module, format));
    const target = targetOfContext(context);
    const params = new DataView(form.uniforms.buffer, form.uniforms.byteOffset);
    const stored = params.getUint32(places.storedTerms, true);
    device.queue.writeBuffer(drawn.params[0]!, places.terms, Uint32Array.of(Math.min(camera.terms ?? stored, stored)));
    const scene = device.createBuffer({ size: SCENE_BYTES, usage: GPUBufferUsage.UNIFORM, mappedAtCreation: true });
    new Float32Array(scene.getMappedRange()).set([...Array.from(camera.viewProjection), ...camera.eye]);
    scene.unmap();
    const group = device.createBindGroup({ layout: this.viewLayout, entries: [{ binding: 0, resource: { buffer: scene } }] });
    const size = { width: target.width, height: target.height };
    const depth = device.createTexture({ size, format: DEPTH_FORMAT, usage: GPUTextureUsage.RENDER_ATTACHMENT });
    const [r, g, b, a = 1] = camera.background ?? [0, 0, 0, 1];
    const encoder = device.createCommandEncoder();
    const pass = encoder.beginRenderPass({
      colorAttachments: [{ view: target.createView(), clearValue: { r, g, b, a }, loadOp: "clear", storeOp: "store" }],
      depthStencilAttachment: { view: depth.createView(), depthClearValue: 1, depthLoadOp: "clear", depthStoreOp: "discard" },
    });
    pass.setPipeline(pipeline);
    pass.setBindGroup(0, drawn.groups[0]!);
    pass.setBindGroup(1, group);
    pass.draw(3 * params.getUint32(places.triangles, true));
    pass.end();
    device.queue.submit([encoder.finish()]);
    scene.destroy();
    depth.destroy();
  }

  private async lightPipeline(info: Module, format: GPUTextureFormat): Promise<GPURenderPipeline> {
    const { device } = this, module = device.createShaderModule({ code: await light(info) });
    return device.createRenderPipelineAsync({
      layout: device.createPipelineLayout({ bindGroupLayouts: [this.layoutOf(info), this.viewLayout] }),
      vertex: { module, entryPoint: "vertex_main" },
      fragment: { module, entryPoint: "fragment_main", targets: [{ format }] },
      depthStencil: { format: DEPTH_FORMAT, depthWriteEnabled: true, depthCompare: "less" },
    });
  }

  /**
   * Texels of a region, read back: by default all of level 0 of the first image.
   * @throws GpuError where there is no such image or level, or the region leaves it.
   */
  async decode(drawn: GpuTexture, region: Region = {}): Promise<Pixels> {
    const image = region.image ?? 0, level = region.level ?? 0, { x = 0, y = 0 } = region;
    const size = atLevel(this.sizeOf(drawn, image), level);
    const levels = drawn.layout!.levels;
    const { width = size.width - x, height = size.height - y } = region;
    const isWhole = [image, level, x, y, width, height].every((number) => Number.isInteger(number) && number >= 0);
    if (!isWhole || level >= levels || width < 1 || height < 1 || x + width > size.width || y + height > size.height) {
      throw new GpuError(`no such region; level ${level} of ${levels} has ${size.width}x${size.height} texels: cut it to them`);
    }
    const limit = this.device.limits.maxTextureDimension2D;
    if (width > limit || height > limit) {
      throw new GpuError(`a region of ${width}x${height} texels, the device draws ${limit} a side; decode it in parts`);
    }
    const format = "rgba8unorm";
    const pipeline = await this.pipeline(drawn, FETCH, format, false);
    const usage = GPUTextureUsage.RENDER_ATTACHMENT | GPUTextureUsage.COPY_SRC;
    const target = this.device.createTexture({ size: { width, height }, format, usage });
    const binding = drawn.form.images[image]!;
    const [group, buffer] = this.view([0, 0], 0, 0, level, binding.image, [x, y]);
    const encoder = this.render(pipeline, [drawn.groups[image]!, group], target, [0, 0, 0, 0]);
    const data = await this.readBack(encoder, target);
    buffer.destroy();
    target.destroy();
    return { width, height, data };
  }

  /**
   * Plain texels of an image with its mip levels, as a texture of its own that any engine on this device samples: `rgba8unorm`, or with `srgb`
   * (for colours that are stored as sRGB) `rgba8unorm-srgb`. The caller destroys it.
   * @throws GpuError where there is no such image.
   */
  async plain(drawn: GpuTexture, image = 0, srgb = false): Promise<GPUTexture> {
    const size = this.sizeOf(drawn, image);
    const levels = Math.min(drawn.layout!.levels, fullLevels(size)), format = "rgba8unorm";
    await drawn.complete;
    const pipeline = await this.pipeline(drawn, FETCH, format, false);
    const usage = GPUTextureUsage.RENDER_ATTACHMENT | GPUTextureUsage.COPY_SRC | GPUTextureUsage.COPY_DST | GPUTextureUsage.TEXTURE_BINDING;
    const descriptor = { size, mipLevelCount: levels, usage };
    const texture = this.device.createTexture({ ...descriptor, format });
    const stored = srgb ? this.device.createTexture({ ...descriptor, format: "rgba8unorm-srgb" }) : texture;
    for (let level = 0; level < levels; level++) {
      const place = drawn.form.images[image]!.image;
      const [group, buffer] = this.view([0, 0], 0, 0, level, place, [0, 0]);
      const encoder = this.render(pipeline, [drawn.groups[image]!, group], texture, [0, 0, 0, 0], undefined, level);
      if (srgb) {
        encoder.copyTextureToTexture({ texture, mipLevel: level }, { texture: stored, mipLevel: level }, atLevel(size, level));
      }
      this.device.queue.submit([encoder.finish()]);
      buffer.destroy();
    }
    if (srgb) {
      texture.destroy();
    }
    return stored;
  }

  /** Submits an encoder's commands; then the texels of an `rgba8unorm` texture. */
  async readBack(encoder: GPUCommandEncoder, texture: GPUTexture): Promise<Uint8ClampedArray<ArrayBuffer>> {
    const { width, height } = texture, row = Math.ceil((4 * width) / ROW_BYTES) * ROW_BYTES;
    const buffer = this.device.createBuffer({ size: row * height, usage: GPUBufferUsage.MAP_READ | GPUBufferUsage.COPY_DST });
    encoder.copyTextureToBuffer({ texture }, { buffer, bytesPerRow: row }, { width, height });
    this.device.queue.submit([encoder.finish()]);
    await buffer.mapAsync(GPUMapMode.READ);
    const mapped = new Uint8Array(buffer.getMappedRange());
    const data = new Uint8ClampedArray(4 * width * height);
    for (let y = 0; y < height; y++) {
      data.set(mapped.subarray(y * row, y * row + 4 * width), 4 * width * y);
    }
    buffer.destroy();
    return data;
  }

  private sizeOf(drawn: GpuTexture, image: number): Size {
    const size = drawn.layout?.images[image];
    if (!size) {
      throw new GpuError(`no image ${image}; the texture has ${drawn.layout?.images.length ?? 0} images`);
    }
    return size;
  }
}

/** Blocks by image, in the order of their numbers. */
function imagesOf(all: Blocks[]): Blocks[][] {
  const images: Blocks[][] = [];
  for (const blocks of all) {
    (images[blocks.image] ??= []).push(blocks);
  }
  return images;
}

/** The format that is drawn to. */
function formatOf(context: GPUCanvasContext | GPUTexture): GPUTextureFormat {
  return "format" in context ? context.format : context.getConfiguration()?.format ?? navigator.gpu.getPreferredCanvasFormat();
}

function targetOfContext(context: GPUCanvasContext | GPUTexture): GPUTexture {
  return "format" in context ? context : context.getCurrentTexture();
}

/** Each switch of a module, 1 where an image needs it. */
function constantsOf(module: Module, form: Form): Record<string, number> {
  const view = new DataView(form.uniforms.buffer, form.uniforms.byteOffset, form.uniforms.byteLength);
  const isNeeded = (offset: number, only?: number): boolean =>
    form.images.some(({ uniforms }) => {
      const value = view.getUint32(uniforms[0] + offset, true);
      return only === undefined ? value !== 0 : value === only;
    });
  return Object.fromEntries(module.switches.map(([name, offset, only]) => [name, isNeeded(offset, only) ? 1 : 0]));
}
