// Decodes all golden files on the visitor's GPU and compares them with their pictures.

import { type Camera, Gpu, type GpuTexture, open, type Region } from "../index.js";
import { bytesOf, element, make } from "../view/data.js";

/** A golden file with its pictures, all in base 64. */
interface Item {
  name: string;
  data: string;
  /** Largest difference that is allowed, of 255. */
  allowed: number;
  /** Camera and size of the picture of a light field. */
  camera?: Camera & { size: [number, number] };
  pictures: { suffix: string; region: Region; data: string }[];
}

/** How many pixels at the rim of a mesh may be inside on one side and outside on the other. */
const RIM = 1 / 500;

const gpuOfPage = Gpu.create();

async function picture(gpu: Gpu, data: string): Promise<Uint8ClampedArray> {
  const blob = new Blob([bytesOf(data)], { type: "image/png" });
  const image = await createImageBitmap(blob, { colorSpaceConversion: "none", premultiplyAlpha: "none" });
  const uploaded = gpu.uploadImage(image);
  const { data: texels } = await gpu.decode(uploaded);
  uploaded.destroy();
  return texels;
}

/** The picture of a light field. */
async function drawn(gpu: Gpu, texture: GpuTexture, camera: NonNullable<Item["camera"]>): Promise<Uint8ClampedArray> {
  const [width, height] = camera.size, format = "rgba8unorm";
  const usage = GPUTextureUsage.RENDER_ATTACHMENT | GPUTextureUsage.COPY_SRC;
  const target = gpu.device.createTexture({ size: { width, height }, format, usage });
  await gpu.drawLight(texture, target, { ...camera, background: [0, 0, 0, 0] });
  const pixels = await gpu.readBack(gpu.device.createCommandEncoder(), target);
  target.destroy();
  return pixels;
}

/** Differences of two pictures, the largest last. */
function differences(one: Uint8ClampedArray, other: Uint8ClampedArray): Uint8Array {
  return Uint8Array.from(one, (value, at) => Math.abs(value - other[at]!)).sort();
}

async function check(gpu: Gpu, item: Item): Promise<{ suffix: string; largest: number; holds: boolean }[]> {
  const texture = await gpu.upload(await open(bytesOf(item.data)), { blocks: "gpu" });
  const found = [];
  for (const { suffix, region, data } of item.pictures) {
    const wanted = await picture(gpu, data);
    const texels = item.camera ? await drawn(gpu, texture, item.camera) : (await gpu.decode(texture, region)).data;
    const sorted = differences(texels, wanted), skipped = item.camera ? Math.ceil(sorted.length * RIM) : 0;
    const largest = texels.length === wanted.length ? sorted[sorted.length - 1 - skipped]! : 255;
    found.push({ suffix, largest, holds: largest <= item.allowed });
  }
  texture.destroy();
  return found;
}

async function run(): Promise<void> {
  const items = JSON.parse(element("data").textContent!) as Item[];
  const gpu = await gpuOfPage;
  const { vendor, architecture, device, description } = gpu.device.adapterInfo;
  const adapter = [vendor, architecture, device, description].filter((part) => part).join(" ") || "an adapter without a name";
  let all = 0, good = 0;
  for (const item of items) {
    for (const { suffix, largest, holds } of await check(gpu, item)) {
      const cells = [item.name + suffix, `${largest}`, `${item.allowed}`].map((text) => make("td", {}, text));
      element("rows").append(make("tr", {}, ...cells, make("td", { class: holds ? "good" : "bad" }, holds ? "same" : "differs")));
      all++;
      good += holds ? 1 : 0;
    }
  }
  element("state").replaceChildren(make("strong", { class: good === all ? "good" : "bad" }, `${good} of ${all} pictures are the same`), ` on ${adapter}.`);
  element("line").textContent = `texfold @VERSION@: ${good} of ${all} on ${adapter}; ${navigator.userAgent}`;
}

run().catch((error: unknown) => {
  element("state").replaceChildren(make("strong", { class: "bad" }, error instanceof Error ? error.message : `${error}`));
});
