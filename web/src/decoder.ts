// Textures in blocks of variable length, decoded by compute passes into plain textures: the counterpart of `texfold_gpu::DctDecoder`.

import type { BlockLayout, Blocks, Channel } from "./form.js";
import { levelsOf, MAX_SCRATCH, type Plan, plansOf, type Rect, reduced } from "./plan.js";
import { blocks as blockShader } from "./shaders.js";

/** Distance of the passes' parameters in their buffer: what every device allows. */
const PASS_STRIDE = 256;
/** Passes that are bound at once. */
const PASSES = 6;
const OUTPUT_WORDS = 36;
/** Bytes of scratch memory of a part that is decoded between two frames: some 300,000 texels of three axes. */
const PART_SCRATCH = 4 << 20;
/** texfold_shaders::BLOCK_STREAMS. */
const STREAMS = 8;
const BLOCKS = 64;
const TEXELS = 8;

type Target = "rgba8unorm" | "rgba32float";

/** The format that a texture in blocks is decoded to. */
export const targetOf = (layout: BlockLayout): Target => (layout.depth > 8 ? "rgba32float" : "rgba8unorm");

/** The channels as an image shows them: gray or colours, and alpha. */
export function channelsOf({ channels, shift, depth }: BlockLayout): Channel[] {
  const one: Channel = { mean: (2 ** depth - 1) * 2 ** shift, firstAxis: 0, weights: [0, 0, 0, 0] };
  const of = (number: number): Channel => channels[number] ?? one;
  return channels.length < 3 ? [of(0), of(0), of(0), of(1)] : [of(0), of(1), of(2), of(3)];
}

interface Writer {
  layout: GPUBindGroupLayout;
  pipeline: GPUComputePipeline;
}

/** Pipelines that decode blocks, and their scratch memory. */
export class Decoder {
  private scratch: GPUBuffer | undefined;
  private writers = new Map<Target, Promise<Writer>>();

  private constructor(
    private readonly device: GPUDevice,
    private readonly layout: GPUBindGroupLayout,
    private readonly read: GPUComputePipeline,
    private readonly transform: GPUComputePipeline,
    private readonly predict: GPUComputePipeline,
    private readonly deblock: GPUComputePipeline[],
  ) {}

  static async create(device: GPUDevice): Promise<Decoder> {
    const buffer = (binding: number, type: GPUBufferBindingType, hasDynamicOffset = false): GPUBindGroupLayoutEntry => ({
      binding,
      visibility: GPUShaderStage.COMPUTE,
      buffer: { type, hasDynamicOffset },
    });
    const entries = [buffer(0, "uniform", true), buffer(1, "read-only-storage"), buffer(2, "read-only-storage"), buffer(3, "storage")];
    const layout = device.createBindGroupLayout({ entries });
    const module = device.createShaderModule({ code: blockShader("rgba8unorm") });
    const pipeline = (entryPoint: string): Promise<GPUComputePipeline> =>
      device.createComputePipelineAsync({
        layout: device.createPipelineLayout({ bindGroupLayouts: [layout] }),
        compute: { module, entryPoint },
      });
    const names = ["read_superblocks", "transform_blocks", "predict_blocks", "deblock_columns", "deblock_rows"];
    const [read, transform, predict, ...deblock] = await Promise.all(names.map(pipeline));
    return new Decoder(device, layout, read!, transform!, predict!, deblock);
  }

  private writer(target: Target): Promise<Writer> {
    let found = this.writers.get(target);
    if (!found) {
      found = this.makeWriter(target);
      this.writers.set(target, found);
    }
    return found;
  }

  private async makeWriter(target: Target): Promise<Writer> {
    const { device } = this;
    const layout = device.createBindGroupLayout({
      entries: [
        { binding: 0, visibility: GPUShaderStage.COMPUTE, buffer: { type: "uniform" } },
        { binding: 1, visibility: GPUShaderStage.COMPUTE, storageTexture: { format: target } },
      ],
    });
    const module = device.createShaderModule({ code: blockShader(target) });
    const pipeline = await device.createComputePipelineAsync({
      layout: device.createPipelineLayout({ bindGroupLayouts: [this.layout, layout] }),
      compute: { module, entryPoint: "write_texels" },
    });
    return { layout, pipeline };
  }

  /**
   * Decodes a texture in blocks and the levels that are made of it into `texture`, from its mip level and row on. In parts, each of which is
   * done before the next begins, frames can be drawn in between.
   */
  async decode(blocks: Blocks, texture: GPUTexture, inParts: boolean): Promise<void> {
    const { device } = this, { layout } = blocks;
    const writer = await this.writer(targetOf(layout));
    const words = this.buffer(blocks.words, blocks.words.byteLength, GPUBufferUsage.STORAGE);
    // The shader reads bytes as parts of two words.
    const streams = this.buffer(blocks.streams, 4 * Math.ceil(blocks.streams.length / 4) + 8, GPUBufferUsage.STORAGE);
    const whole = { level: 0, x: 0, y: 0, ...layout.size };
    for (const plan of plansOf(layout, whole, inParts ? PART_SCRATCH : MAX_SCRATCH)) {
      const encoder = device.createCommandEncoder();
      const held = this.passes(encoder, plan, words, streams);
      const pass = held.pass;
      pass.setPipeline(writer.pipeline);
      const outputs = Array.from({ length: Math.min(blocks.levels, levelsOf(layout.size)) }, (_, level) => {
        const rect = reduced(plan.rect, layout.size, level);
        const view = texture.createView({ baseMipLevel: blocks.level + level, mipLevelCount: 1 });
        const output = this.output(layout, rect, [rect.x, rect.y + blocks.row]);
        const entries = [{ binding: 0, resource: { buffer: output } }, { binding: 1, resource: view }];
        if (rect.width > 0 && rect.height > 0) {
          pass.setBindGroup(1, device.createBindGroup({ layout: writer.layout, entries }));
          pass.dispatchWorkgroups(Math.ceil(rect.width / TEXELS), Math.ceil(rect.height / TEXELS));
        }
        return output;
      });
      pass.end();
      device.queue.submit([encoder.finish()]);
      [held.params, ...outputs].forEach((buffer) => buffer.destroy());
      if (inParts) {
        await device.queue.onSubmittedWorkDone();
      }
    }
    words.destroy();
    streams.destroy();
  }

  /** Passes of a plan, and the open pass that goes on with what they decode. */
  private passes(encoder: GPUCommandEncoder, plan: Plan, words: GPUBuffer, streams: GPUBuffer): { pass: GPUComputePassEncoder; params: GPUBuffer } {
    const { device } = this, scratch = this.scratchOf(4 * plan.words);
    // Behind the last pass what is bound with it.
    const numbers = new Int32Array((PASS_STRIDE / 4) * (plan.passes.length + PASSES - 1));
    plan.passes.forEach((pass, number) => numbers.set(pass.words, (number * PASS_STRIDE) / 4));
    const params = this.buffer(numbers, numbers.byteLength, GPUBufferUsage.UNIFORM);
    encoder.clearBuffer(scratch, 0, 4 * plan.words);
    const buffers: GPUBufferBinding[] = [{ buffer: params, size: PASSES * PASS_STRIDE }, { buffer: words }, { buffer: streams }, { buffer: scratch }];
    const entries = buffers.map((resource, binding) => ({ binding, resource }));
    const group = device.createBindGroup({ layout: this.layout, entries });
    const compute = encoder.beginComputePass();
    const most = Math.max(...plan.passes.map(({ superblocks }) => superblocks));
    compute.setBindGroup(0, group, [0]);
    compute.setPipeline(this.read);
    compute.dispatchWorkgroups(Math.ceil(most / STREAMS), plan.passes.length);
    plan.passes.forEach((pass, number) => {
      compute.setBindGroup(0, group, [number * PASS_STRIDE]);
      const dispatch = (pipeline: GPUComputePipeline, columns: number, rows = 1): void => {
        compute.setPipeline(pipeline);
        compute.dispatchWorkgroups(columns, rows);
      };
      const blocks = Math.ceil(pass.blocks / BLOCKS);
      dispatch(this.transform, blocks);
      if (pass.predicts) {
        dispatch(this.predict, Math.ceil(pass.superblocks / STREAMS), pass.axes);
      }
      if (pass.deblocks) {
        this.deblock.forEach((pipeline) => dispatch(pipeline, blocks));
      }
    });
    return { pass: compute, params };
  }

  private output(layout: BlockLayout, rect: Rect, place: [number, number]): GPUBuffer {
    const channels = channelsOf(layout);
    const words = Int32Array.from([
      rect.width, rect.height, rect.x, rect.y, ...place, layout.shift, 2 ** layout.depth - 1,
      ...channels.map(({ mean }) => mean), ...channels.map(({ firstAxis }) => firstAxis), ...channels.flatMap(({ weights }) => weights),
      layout.size.width - 1, layout.size.height - 1, rect.level, (layout.isLight ? 1 : 0) | (layout.isWeighted ? 2 : 0),
    ]);
    return this.buffer(words, 4 * OUTPUT_WORDS, GPUBufferUsage.UNIFORM);
  }

  private scratchOf(bytes: number): GPUBuffer {
    if (!this.scratch || this.scratch.size < bytes) {
      this.scratch?.destroy();
      this.scratch = this.device.createBuffer({ size: bytes, usage: GPUBufferUsage.STORAGE | GPUBufferUsage.COPY_DST });
    }
    return this.scratch;
  }

  private buffer(data: ArrayBufferView, size: number, usage: number): GPUBuffer {
    const buffer = this.device.createBuffer({ size, usage, mappedAtCreation: true });
    new Uint8Array(buffer.getMappedRange()).set(new Uint8Array(data.buffer, data.byteOffset, data.byteLength));
    buffer.unmap();
    return buffer;
  }
}
