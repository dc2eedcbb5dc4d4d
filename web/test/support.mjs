// Golden files, and what Rust loads them to.
import { readdirSync, readFileSync } from "node:fs";
import { checksum } from "../dist/test.js";

const folder = new URL("../../fixtures/golden/", import.meta.url);

export const golden = JSON.parse(readFileSync(new URL("golden.json", import.meta.url), "utf8"));

export function read(name) {
  return new Uint8Array(readFileSync(new URL(name, folder)));
}

export const names = readdirSync(folder).filter((name) => name.endsWith(".txf"));

const hash = (bytes) => checksum(new Uint8Array(bytes.buffer, bytes.byteOffset, bytes.byteLength)).toString(16).padStart(16, "0");

/** A texture as golden.json describes it. */
export function described({ form, layers, compressedBytes }) {
  return {
    compressed: 8 * compressedBytes,
    layers,
    form: {
      ...form,
      uniforms: hash(form.uniforms),
      planes: form.planes.map((plane) => ({ ...plane, data: hash(plane.data) })),
      blocks: form.blocks.map((blocks) => ({ ...blocks, words: hash(blocks.words), streams: hash(blocks.streams) })),
    },
  };
}

/** A file with other bytes in its sections, its checksums made right: as a forger writes it. */
export function resealed(bytes) {
  const file = bytes.slice();
  const view = new DataView(file.buffer);
  const count = view.getUint32(12, true);
  for (let entry = 32; entry < 32 + 40 * count; entry += 40) {
    const start = Number(view.getBigUint64(entry + 8, true)), length = Number(view.getBigUint64(entry + 16, true));
    view.setBigUint64(entry + 32, checksum(file.subarray(start, start + length)), true);
  }
  const summed = new Uint8Array([...file.subarray(0, 24), ...file.subarray(32, 32 + 40 * count)]);
  view.setBigUint64(24, checksum(summed), true);
  return file;
}
