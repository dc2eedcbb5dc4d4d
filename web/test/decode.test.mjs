import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";
import { PNG } from "pngjs";
import { Budget, checksum, decodeBlocks, LIMITS, open, Reader, readStage } from "../dist/test.js";
import { golden, read } from "./support.mjs";

const picture = (name) => PNG.sync.read(readFileSync(new URL(`../../fixtures/golden/${name}.png`, import.meta.url)));

/** The stages of a golden file, the finest first. */
async function stages(name, length = Infinity) {
  const { form } = await open(read(name).subarray(0, length));
  return form.blocks;
}

/** All of a level. */
function whole({ layout }, level = 0) {
  const [width, height] = [layout.size.width, layout.size.height].map((texels) => Math.max(1, texels >> level));
  return { level, x: 0, y: 0, width, height };
}

function same(found, name) {
  const { data } = picture(name);
  assert.ok(Buffer.from(found.buffer).equals(data), name);
}

/** The texture of block_deblocked.bin: one stage, as Rust gave its bytes. */
function deblocked() {
  const reader = new Reader("BIN", read("block_deblocked.bin"));
  const { blocks, base, detailBytes } = readStage(reader, new Budget(LIMITS), { image: 0, level: 0, levels: 1 }, { colour: "srgb", channels: 4 });
  const streams = new Uint8Array(base.length + detailBytes);
  streams.set(base);
  streams.set(reader.bytes(detailBytes), base.length);
  reader.end();
  return { ...blocks, streams, layout: { ...blocks.layout, streamBytes: streams.length } };
}

test("blocks decode to the texels of Rust", async () => {
  const [first, second] = await stages("dct.txf");
  const [alpha] = await stages("dct_alpha.txf");
  same(decodeBlocks(first, whole(first)), "dct");
  same(decodeBlocks(first, whole(first, 2)), "dct-level2");
  same(decodeBlocks(second, whole(second, 1)), "dct-level4");
  same(decodeBlocks(alpha, whole(alpha)), "dct_alpha");
  same(decodeBlocks(alpha, whole(alpha, 1)), "dct_alpha-level1");
});

test("borders of blocks are filtered as Rust does", () => {
  const blocks = deblocked();
  assert.ok(blocks.layout.deblocking > 0);
  same(decodeBlocks(blocks, whole(blocks)), "block_deblocked");
});

/** A texture of 20x18 texels of gray and alpha, 16 bits each, with all mip levels, and checksums of what Rust decodes its levels to in 8 bits. */
const DEEP = "iVRYRg0KGgoCAAcABAAAABICAAAAAAAAlCQFF4YzdtxOT1RFAQAAAMAAAAAAAAAAowAAAAAAAADKAAAAAAAAAJNUfSKGmjWlTEFZTwAAAABjAQAAAAAAABwAAAAAAAAAHAAAAAAAAADw" +
  "fV10bdNQQVJCQjABAAAAfwEAAAAAAACBAAAAAAAAAKIAAAAAAAAAHvExzpcxNbFSQkQwAAAAAAACAAAAAAAAEgAAAAAAAAASAAAAAAAAAB5xN/l45X5FKLUv/SDK1QQA4kohGWCvDpCX" +
  "EL7vXnwTqBqGyZjo9MSDQIAFdGyMozDNoTjtAAKmbtZPV0F52QJCwdYd49i3TGV0L883raj3aylr+U9HSXKMDaX1xjguXwcdUvdrGTqOp/ITx35EvbWlQD5MvrjvfltCb60VCZBNV3Xl" +
  "Z7n+Sdt8q5yS1woRxPvBP4bUIwigCAYALSUjqAuPSocAZVHFIgOXCQIQAAEAAAAABQAAAAEAAAABAAAAFAAAABIAAAAotS/9IKLFAwBkBgITABEAEAV7EQwAAAECAWiEAAQBe38ABAYE" +
  "AD4AcQMA/1+qJVK8NfHai1Yg3rseGNiD3QOYNP7CX2Aw1qf9n95GuDQ0cFODFnRGPBB88///QQEBAAEAEAW7EAwAAAIBfY8DBAAFBQYAZugCMgFySAMsAf5oAE5bngFoamGp9+E9+nEl" +
  "hv0J0W4=";
const DEEP_LEVELS = [0xb077d4827bf6a19en, 0x30353f23e1ef1b6cn, 0x7381876c7e726632n, 0x7b7f8e058e75c0den, 0x0a9680bdeb40e41cn];

test("samples of 16 bits decode to those of Rust, divided to 8", async () => {
  const { form } = await open(new Uint8Array(Buffer.from(DEEP, "base64")));
  const found = form.blocks.flatMap((blocks) => {
    assert.equal(blocks.layout.depth, 16);
    return Array.from({ length: blocks.levels }, (_, level) => checksum(new Uint8Array(decodeBlocks(blocks, whole(blocks, level)).buffer)));
  });
  assert.deepEqual(found, DEEP_LEVELS);
});

test("without their own streams images are what the bases say", async () => {
  const { bytes } = golden["dct.txf"].prefixes.find(({ form }) => form);
  const [first] = await stages("dct.txf", bytes);
  same(decodeBlocks(first, whole(first)), "dct-base");
});

/** A generator of numbers below a limit. */
function numbers(seed) {
  let state = seed;
  return (limit) => {
    state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
    return Math.floor((state / 2 ** 32) * limit);
  };
}

test("rectangles equal the same part of the whole", async () => {
  const next = numbers(3);
  for (const blocks of [...(await stages("dct.txf")), ...(await stages("dct_alpha.txf")), deblocked()]) {
    for (let level = 0; level < 3; level++) {
      const all = whole(blocks, level), texels = decodeBlocks(blocks, all);
      for (let round = 0; round < 20; round++) {
        const x = next(all.width), y = next(all.height);
        const rect = { level, x, y, width: 1 + next(all.width - x), height: 1 + next(all.height - y) };
        const found = decodeBlocks(blocks, rect);
        for (let row = 0; row < rect.height; row++) {
          const start = 4 * ((y + row) * all.width + x), line = 4 * rect.width;
          assert.deepEqual(found.subarray(row * line, (row + 1) * line), texels.subarray(start, start + line), JSON.stringify(rect));
        }
      }
      assert.equal(decodeBlocks(blocks, { ...all, width: 0 }).length, 0);
    }
  }
});

test("any bytes of streams and index decode", async () => {
  const next = numbers(11);
  const all = [...(await stages("dct.txf")), ...(await stages("dct_alpha.txf")), deblocked()];
  for (let round = 0; round < 1000; round++) {
    const blocks = all[round % all.length], rect = whole(blocks, next(3));
    const streams = blocks.streams.map(() => next(256)).subarray(0, round % 2 ? next(blocks.streams.length + 1) : undefined);
    const words = blocks.words.slice();
    for (let flips = round % 4 === 3 ? 4 : 0; flips > 0; flips--) {
      words[blocks.layout.index + next(words.length - blocks.layout.index)] = next(2 ** 32);
    }
    const start = performance.now();
    assert.equal(decodeBlocks({ ...blocks, words, streams }, rect).length, 4 * rect.width * rect.height);
    assert.ok(performance.now() - start < 1000, `round ${round}`);
  }
});
