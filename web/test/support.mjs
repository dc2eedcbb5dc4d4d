// Golden files, and what Rust loads them to.
import { execFileSync } from "node:child_process";
import { existsSync, readdirSync, readFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import { checksum } from "../dist/test.js";

const folder = new URL("../../fixtures/golden/", import.meta.url);

export const golden = JSON.parse(readFileSync(new URL("golden.json", import.meta.url), "utf8"));

export function read(name) {
  return new Uint8Array(readFileSync(new URL(name, folder)));
}

export const names = readdirSync(folder).filter((name) => name.endsWith(".txf"));

/** Runs the program in the workspace's folder. Where that was built, it is there. */
export function texfold(...options) {
  const cwd = fileURLToPath(new URL("../..", import.meta.url)), built = `${cwd}target/debug/texfold`;
  const [program, ...first] = existsSync(built) ? [built] : ["cargo", "run", "--quiet", "--package", "texfold-cli", "--"];
  execFileSync(program, [...first, ...options], { cwd, stdio: ["ignore", "ignore", "inherit"] });
}

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

/** 32768x8 texels with mip levels, by `texfold compress long.png --codec dct --effort fast --mips`. */
export const LONG =
  "iVRYRg0KGgoCAAcABAAAALcDAAAAAAAAN2PodBSoEu5OT1RFAQAAAMAAAAAAAAAAlQAAAAAAAAC0AAAAAAAAAKAgRLMg0b0VTEFZTwAAAABVAQAAAAAAABwAAAAAAAAAHAAAAAAAAABg" +
  "5h262K/OYlJCQjABAAAAcQEAAAAAAAAmAgAAAAAAAIsGAAAAAAAAzPSnYQjAhShSQkQwAQAAAJcDAAAAAAAAIAAAAAAAAAAMDAAAAAAAAB8/ttgPUor8KLUv/SC0ZQQAwokeGWCtDkMM" +
  "/7TERlAtEAQBVOIC/1iahKQ0aAEPeS1JkKS5BbSFVXqFk6S47wqIfmiFz3aK4vGN7u0reTa058ySUkcKhxvD5dLC49sS9rylh3rmM9Hd0Yj2oXbV+fA40+XHc0RbziO9ubFEIcb+jF+L" +
  "Jcaeo3xsGUXGlhAFAEGJclQOBMrgTivKKk4DCAAAAAAAABAAAAABAAAAAQAAAACAAAAIAAAAKLUv/WCLBeUQALQYAv9/BwAIBdQIAAAAAQEDgABpAGMABAQFRgByDADR2jLGGGOMMRgA" +
  "cgCAMZn5WQG5GQJ52TkDmflZBLkZBXnZOQaZ+VkHuRkIedk5CZn5WQq5GQt52TkMDAAB3///X+AHP/h/Az/4wff//x8g8P///zcHNHz/H/iH/wO+f+Af/v97uO8H/MEPfvCDH/w9oPH/" +
  "A2jYlx6RSqxYsyv+jZ5v++z/81bJxKAegnAt2H+dgo5EElnlPpCQOE72/gRoA9x3Tax8SdJw7FBXHMz/wh9JCBGDKtN3lCUSpgIM2QH/DwAACAUUgQQWADgAc0oAf8D/H/D9A///f/8H" +
  "5P7/f/s/Ac7/Wt0AZ7wTiOzFh+y/03/4v0fQW8vf/Pif4AtodEdjDry89T8ifj1j+Qm6x5hZxyEw2dP/Af8BVAcNACEQJf8d/z/2/5wB5vxLblVdltM+ZupMix2bZK+suWKWHQPDTTkT" +
  "tygCPwCUBgIEBAAQKwP/9z8Z1lUj6zgMZQ8BB9QFAwQABwcBABSXAARPqIFcdSZpGSkqLKwBIGkmbcZCORSCGYjAgSCG4KZ4wqQtu24DOHvJCDt/BA/ecUWhbCBW1kruVIGx3RhC5hbp" +
  "PHtfYF9W6UklYd2i6vEPPAwMqpUWuac1gDCymQrH64hs98V80Q2UQdlDEEgUIrIXjv3CwDxgYZvTrgEonQrOadsVWucWqgomPT+zOX6EHyi1L/1gDAu1AAB49zYfIg/coSrvfwO5ATQA" +
  "AQD603dD";
