// What a GPU needs to draw a texture: the counterpart of `texfold_core::GpuForm`, equal to it byte for byte.

import type { Size } from "./container.js";

/** Bytes of a block and texels along its side, by format. */
export const FORMATS = {
  "rg8uint": [2, 1],
  "r32uint": [4, 1],
  "rgba32uint": [16, 1],
  "r8unorm": [1, 1],
  "rg8unorm": [2, 1],
  "rgba8unorm": [4, 1],
  "bc1-rgba-unorm": [8, 4],
  "bc3-rgba-unorm": [16, 4],
  "bc4-r-unorm": [8, 4],
  "bc5-rg-unorm": [16, 4],
  "bc7-rgba-unorm": [16, 4],
} as const;

/** How the texels of a plane are stored. */
export type PlaneFormat = keyof typeof FORMATS;

/** Bytes of `width` x `height` texels, whole blocks. */
export function planeBytes(format: PlaneFormat, width: number, height: number): number {
  const [bytes, side] = FORMATS[format];
  return Math.ceil(width / side) * Math.ceil(height / side) * bytes;
}

/** One texture. */
export interface Plane {
  /** Which part of the footprint it belongs to. */
  part: string;
  format: PlaneFormat;
  width: number;
  height: number;
  /** Mip levels in `data`, largest first, rows without padding. */
  levels: number;
  data: Uint8Array;
}

/** What to bind to draw one image. */
export interface ImageBinding {
  /** Numbers of planes in the order of the shader's bindings; from the number of planes on those that blocks decode to. */
  planes: number[];
  /** First and end byte of the shader's parameters. */
  uniforms: [number, number];
  /** The `image` argument of the shader's functions. */
  image: number;
}

/** A channel of a texture in blocks: the sum of a mean and of up to four weighted axes. */
export interface Channel {
  mean: number;
  firstAxis: number;
  weights: number[];
}

/** How the planes of a texture in blocks are cut, and what its words hold. */
export interface BlockLayout {
  size: Size;
  depth: number;
  superblockLog2: number;
  /** The same of the planes behind the image. */
  baseLog2: number;
  ranks: number[];
  channels: Channel[];
  shift: number;
  offsets: [number, number];
  isDependent: boolean;
  /** Whether blocks of the image have intra modes. */
  hasModes: boolean;
  steps: number;
  index: number;
  indexBits: number;
  streamBytes: number;
  isLight: boolean;
  isWeighted: boolean;
  deblocking: number;
}

/** Both reconstruction offsets as shaders read them, 8 bits each; bit 16 where quantisers are dependent, bit 17 where blocks have intra modes. */
export function packedOffsets({ offsets, isDependent, hasModes }: BlockLayout): number {
  return offsets[0] | (offsets[1] << 8) | (isDependent ? 1 << 16 : 0) | (hasModes ? 1 << 17 : 0);
}

/** A texture in blocks of variable length. */
export interface Blocks {
  layout: BlockLayout;
  words: Uint32Array;
  streams: Uint8Array;
  /** Bytes of header, index and tables. */
  headBytes: number;
  image: number;
  level: number;
  levels: number;
  /** First row of the image's level that it holds. */
  row: number;
}

/** Planes and parameters of a texture, and the shader module that reads them. */
export interface Form {
  module: string;
  planes: Plane[];
  uniforms: Uint8Array;
  images: ImageBinding[];
  blocks: Blocks[];
}

/** Parameters of images, one behind the other: 32-bit numbers, little-endian. */
export class Uniforms {
  private readonly words: number[] = [];

  /** Adds numbers; where they lie in bytes. */
  add(...numbers: number[]): [number, number] {
    const start = 4 * this.words.length;
    this.words.push(...numbers);
    return [start, 4 * this.words.length];
  }

  bytes(): Uint8Array {
    return new Uint8Array(new Uint32Array(this.words).buffer);
  }
}

/** The bits of a 32-bit float. */
export function floatBits(value: number): number {
  return new Uint32Array(Float32Array.of(value).buffer)[0]!;
}
