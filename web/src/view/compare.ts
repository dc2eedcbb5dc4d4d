// The difference of two pictures, around middle gray.

const SHADER = `
@group(0) @binding(0) var first: texture_2d<f32>;
@group(0) @binding(1) var second: texture_2d<f32>;
const GAIN = 8.0;
@vertex fn corner(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {
  return vec4f(vec2f(vec2u(index & 1u, index >> 1u)) * 4.0 - 1.0, 0.0, 1.0);
}
@fragment fn difference(@builtin(position) at: vec4f) -> @location(0) vec4f {
  let place = vec2u(at.xy);
  let value = textureLoad(first, place, 0) - textureLoad(second, place, 0);
  return vec4f(0.5 + GAIN * value.rgb, 1.0);
}`;

/** Draws the error of one picture against another. */
export class Difference {
  private readonly pipeline: GPURenderPipeline;
  private pictures: GPUTexture[] = [];

  constructor(private readonly device: GPUDevice, private readonly format: GPUTextureFormat) {
    const module = device.createShaderModule({ code: SHADER });
    this.pipeline = device.createRenderPipeline({ layout: "auto", vertex: { module }, fragment: { module, targets: [{ format }] } });
  }

  /** Two pictures of that size to draw into: decoded, then original. */
  targets(width: number, height: number): [GPUTexture, GPUTexture] {
    if (this.pictures[0]?.width !== width || this.pictures[0].height !== height) {
      this.pictures.forEach((picture) => picture.destroy());
      const usage = GPUTextureUsage.RENDER_ATTACHMENT | GPUTextureUsage.TEXTURE_BINDING | GPUTextureUsage.COPY_SRC;
      this.pictures = [0, 1].map(() => this.device.createTexture({ size: { width, height }, format: this.format, usage }));
    }
    return this.pictures as [GPUTexture, GPUTexture];
  }

  /** Draws the difference of the pictures. */
  draw(target: GPUTexture): void {
    const entries = this.pictures.map((picture, binding) => ({ binding, resource: picture.createView() }));
    const encoder = this.device.createCommandEncoder();
    const pass = encoder.beginRenderPass({ colorAttachments: [{ view: target.createView(), loadOp: "clear", storeOp: "store" }] });
    pass.setPipeline(this.pipeline);
    pass.setBindGroup(0, this.device.createBindGroup({ layout: this.pipeline.getBindGroupLayout(0), entries }));
    pass.draw(3);
    pass.end();
    this.device.queue.submit([encoder.finish()]);
  }
}
