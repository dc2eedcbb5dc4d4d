// A bank as a map: of the tiles in view those that are missing are fetched, the middle ones first, and held from the mip level on that the zoom
// needs.

import { type Gpu, type GpuTexture, open } from "../index.js";
import type { Window } from "./camera.js";

/** A tile: its file, its place and size in the image. */
interface Tile {
  file: string;
  x: number;
  y: number;
  width: number;
  height: number;
}

/** An image of a bank, in tiles. */
export interface BankImage {
  name: string;
  width: number;
  height: number;
  fileBytes: number;
  compressedBytes: number;
  tiles: Tile[];
}

/** Tiles that are fetched at a time. */
const MOST_LOADING = 4;
/** Bytes of tiles on the GPU, beyond which those are freed that were in view longest ago. */
const MOST_BYTES = 256 << 20;
/** Tiles of a view, the middle ones. */
const MOST_TILES = 1024;

interface Held {
  drawn: GpuTexture;
  /** Frame in which it was in view last. */
  seen: number;
}

/** Tiles of a bank on the GPU. */
export class BankMap {
  private readonly held = new Map<Tile, Held>();
  private readonly loading = new Set<Tile>();
  private readonly broken = new Set<Tile>();
  private frame = 0;
  private isOver = false;

  constructor(
    private readonly gpu: Gpu,
    readonly images: BankImage[],
    /** Address of the files. */
    private readonly folder: string,
    /** Called when there is more to draw. */
    private readonly changed: () => void,
    /** Called with the reason why a tile cannot be shown. */
    private readonly failed: (why: string) => void,
  ) {}

  /** Draws what is there of the tiles in view, and fetches what is missing. */
  async draw(target: GPUTexture, number: number, { x, y, scale }: Window, background: [number, number, number]): Promise<void> {
    this.frame++;
    const right = x + target.width / scale, bottom = y + target.height / scale;
    const distance = (tile: Tile): number => Math.hypot(tile.x + tile.width / 2 - (x + right) / 2, tile.y + tile.height / 2 - (y + bottom) / 2);
    const isSeen = (tile: Tile): boolean => tile.x < right && tile.y < bottom && tile.x + tile.width > x && tile.y + tile.height > y;
    const seen = this.images[number]!.tiles.filter(isSeen).sort((one, other) => distance(one) - distance(other)).slice(0, MOST_TILES);
    const finest = Math.max(0, Math.floor(-Math.log2(scale)));
    let keep = false;
    for (const tile of seen) {
      const held = this.held.get(tile);
      if (held) {
        held.seen = this.frame;
        const less = 2 ** held.drawn.skippedLevels;
        const view = { x: (x - tile.x) / less, y: (y - tile.y) / less, scale: scale * less, background, keep, nearest: scale >= 2 };
        await this.gpu.draw(held.drawn, target, view);
        keep = true;
      }
      if ((!held || held.drawn.skippedLevels > finest) && this.loading.size < MOST_LOADING && !this.loading.has(tile) && !this.broken.has(tile)) {
        void this.load(tile, finest);
      }
    }
  }

  private async load(tile: Tile, finest: number): Promise<void> {
    this.loading.add(tile);
    try {
      const drawn = await this.gpu.upload(await open(new URL(this.folder + encodeURIComponent(tile.file), location.href)), { finest });
      this.held.get(tile)?.drawn.destroy();
      this.held.set(tile, { drawn, seen: this.frame });
      if (this.isOver) {
        this.destroy();
      }
      this.free();
    } catch (error) {
      this.broken.add(tile);
      this.failed(`${tile.file}: ${error instanceof Error ? error.message : error}`);
    }
    this.loading.delete(tile);
    this.changed();
  }

  /** Frees tiles that are out of view. */
  private free(): void {
    let bytes = [...this.held.values()].reduce((sum, { drawn }) => sum + drawn.residentBytes, 0);
    for (const [tile, { drawn, seen }] of [...this.held].sort(([, one], [, other]) => one.seen - other.seen)) {
      if (bytes <= MOST_BYTES || seen === this.frame) {
        return;
      }
      bytes -= drawn.residentBytes;
      drawn.destroy();
      this.held.delete(tile);
    }
  }

  /** Frees all tiles. */
  destroy(): void {
    this.isOver = true;
    this.held.forEach(({ drawn }) => drawn.destroy());
    this.held.clear();
  }
}
