// Images as OpenSeadragon shows them: tiles that are decoded when they come into view.

import { atLevel } from "./container.js";
import type { Gpu, GpuTexture } from "./gpu.js";

/** What OpenSeadragon hands over for a tile (its `ImageJob`), as far as it is used. */
interface Job {
  tile: { level: number; x: number; y: number };
  finish(data: unknown, request: unknown, kind: string): void;
  fail(message: string, request: unknown): void;
}

/** Options of a viewer's `tileSources` for an image of a texture: `OpenSeadragon({ tileSources: tileSource(gpu, texture), … })`. */
export function tileSource(gpu: Gpu, texture: GpuTexture, image = 0, tileSize = 256): object {
  const layout = texture.layout!, { width, height } = layout.images[image]!;
  const maxLevel = Math.ceil(Math.log2(Math.max(width, height)));
  const minLevel = Math.max(0, maxLevel - layout.levels + 1);
  const decode = async ({ level, x, y }: Job["tile"]): Promise<CanvasRenderingContext2D> => {
    const mip = maxLevel - level, size = atLevel({ width, height }, mip);
    // Levels are rounded up there and down here: tiles begin inside, and are as large as there is room.
    const left = Math.min(x * tileSize, size.width - 1), top = Math.min(y * tileSize, size.height - 1);
    const part = { width: Math.min(tileSize, size.width - left), height: Math.min(tileSize, size.height - top) };
    const pixels = await gpu.decode(texture, { image, level: mip, x: left, y: top, ...part });
    if ((layout.maps?.[image]?.pixels.alpha ?? layout.alpha) === "band") {
      for (let at = 3; at < pixels.data.length; at += 4) {
        pixels.data[at] = 255;
      }
    }
    const context = Object.assign(document.createElement("canvas"), part).getContext("2d")!;
    context.putImageData(new ImageData(pixels.data, pixels.width, pixels.height), 0, 0);
    return context;
  };
  return {
    width, height, tileSize, minLevel, maxLevel,
    getTileUrl: (level: number, x: number, y: number): string => `texfold:${image}/${level}/${x}/${y}`,
    downloadTileStart(job: Job): void {
      decode(job.tile).then(
        (context) => job.finish(context, null, "context2d"),
        (error: unknown) => job.fail(`${error}`, null),
      );
    },
    downloadTileAbort(): void {},
  };
}
