import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { createServer } from "node:http";
import { test } from "node:test";
import { arriving, checksum, decompress, open, openLayers, LoadError } from "../dist/test.js";
import { described, golden, names, read, resealed } from "./support.mjs";

test("golden files load to what Rust loads them to, whole and cut", async () => {
  assert.deepEqual(names.toSorted(), Object.keys(golden).toSorted());
  for (const name of names) {
    const bytes = read(name), expected = golden[name];
    assert.deepEqual(described(await open(bytes)), expected.form, name);
    for (const { bytes: length, form, error } of expected.prefixes) {
      const cut = bytes.subarray(0, length);
      if (error) {
        await assert.rejects(open(cut), { name: "LoadError", message: error }, `${name}, ${length} bytes`);
      } else {
        assert.deepEqual(described(await open(cut)), form, `${name}, ${length} bytes`);
      }
    }
  }
});

test("files that are no .txf, of another version or with a flipped byte are errors that say what to do", async () => {
  const bytes = read("dct.txf");
  const cases = [
    [new Uint8Array(0), /not a \.txf file; give a file that Texfold wrote/],
    [new TextEncoder().encode("PNG"), /not a \.txf file/],
    [bytes.subarray(0, 20), /the file ends before section 'head' is whole/],
    [Uint8Array.from(bytes, (byte, at) => (at === 8 ? 9 : byte)), /format version 9, this reader knows 2; update Texfold/],
    [Uint8Array.from(bytes, (byte, at) => (at === bytes.length - 3 ? byte ^ 1 : byte)), /do not match its checksum; fetch or write the file again/],
  ];
  for (const [data, message] of cases) {
    await assert.rejects(open(data), message);
  }
  const other = resealed(Uint8Array.from(bytes, (byte, at) => (at === 10 ? 99 : byte)));
  await assert.rejects(open(other), /codec number 99; open it with a Texfold that has that codec/);
  await assert.rejects(open(bytes, { bytes: 100 }), /bytes: \d+ needed, 100 allowed; raise the limit/);
});

/** A generator of numbers below a limit: every run forges the same files. */
function numbers(seed) {
  let state = seed;
  return (limit) => {
    state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
    return Math.floor((state / 2 ** 32) * limit);
  };
}

test("10,000 forged files give a texture or an error of ours, none of them slowly", async () => {
  const next = numbers(1);
  const files = names.map(read);
  let loaded = 0;
  for (let round = 0; round < 10_000; round++) {
    const file = files[round % files.length].slice();
    const table = 32 + 40 * new DataView(file.buffer).getUint32(12, true);
    for (let flips = 1 + next(4); flips > 0; flips--) {
      // In one of four the table is forged, too: lengths and kinds of sections.
      const first = round % 4 === 0 ? 32 : table;
      file[first + next(file.length - first)] = next(256);
    }
    const start = performance.now();
    try {
      await open(round % 4 === 0 ? file : resealed(file));
      loaded++;
    } catch (error) {
      assert.ok(error instanceof LoadError, `${names[round % files.length]}, round ${round}: ${error.stack}`);
    }
    assert.ok(performance.now() - start < 2000, `${names[round % files.length]}, round ${round}`);
  }
  assert.ok(loaded > 500, `${loaded} of 10,000 load`);
});

test("a file that arrives in pieces is given again with each layer", async (context) => {
  const bytes = read("dct.txf");
  const server = createServer(async (request, response) => {
    if (request.url === "/none") {
      return response.writeHead(404).end();
    }
    const end = request.url === "/cut" ? 100 : bytes.length;
    for (let at = 0; at < end; at += 90) {
      response.write(bytes.subarray(at, Math.min(at + 90, end)));
      await new Promise((resolve) => setTimeout(resolve, 5));
    }
    response.end();
  });
  await new Promise((resolve) => server.listen(0, "127.0.0.1", resolve));
  const address = `http://127.0.0.1:${server.address().port}`;
  const layers = async (path) => {
    const found = [];
    for await (const texture of arriving(address + path)) {
      found.push([texture.layers, texture.form.blocks[0].streams.length]);
    }
    return found;
  };
  context.after(() => server.close());
  const base = golden["dct.txf"].prefixes.find(({ form }) => form).form.form.blocks[0].layout.streamBytes;
  assert.deepEqual(await layers("/whole"), [[[1, 2], base], [[2, 2], golden["dct.txf"].form.form.blocks[0].layout.streamBytes]]);
  assert.deepEqual(described(await open(`${address}/whole`)), golden["dct.txf"].form);
  await assert.rejects(layers("/cut"), /the file ends before section '.*' is whole; fetch the rest of it/);
  await assert.rejects(open(`${address}/none`), /the server answers 404 to .*; check the address/);
});

test("of a file's first layers nothing behind them is fetched, where the server knows ranges", async (context) => {
  const bytes = read("lightfield.txf");
  let sent = 0;
  const server = createServer((request, response) => {
    const [, first, last] = /^bytes=(\d+)-(\d+)$/.exec(request.headers.range).map(Number);
    const end = request.url === "/cut" ? 5000 : bytes.length;
    const knows = request.url !== "/whole";
    const part = knows ? bytes.subarray(first, Math.min(last + 1, end)) : bytes;
    sent += part.length;
    response.writeHead(knows ? 206 : 200, knows ? { "content-range": `bytes ${first}-${first + part.length - 1}/${end}` } : {}).end(part);
  });
  await new Promise((resolve) => server.listen(0, "127.0.0.1", resolve));
  context.after(() => server.close());
  const address = `http://127.0.0.1:${server.address().port}`;
  const loaded = async (path, layers) => {
    sent = 0;
    return { ...described(await openLayers(address + path, layers)), sent };
  };
  const prefix = golden["lightfield.txf"].prefixes.find(({ form }) => form);
  const { sent: ofFirst, ...first } = await loaded("/ranges", 1);
  assert.deepEqual(first, prefix.form);
  assert.ok(ofFirst < bytes.length, `${ofFirst} of ${bytes.length} bytes`);
  for (const path of ["/ranges", "/whole"]) {
    const { sent: ofAll, ...all } = await loaded(path, 9);
    assert.deepEqual([all, ofAll], [golden["lightfield.txf"].form, bytes.length], path);
  }
  await assert.rejects(openLayers(`${address}/cut`, 9), /the file ends before section '.*' is whole/);
});

test("checksums are those of the BLAKE3 test vectors", () => {
  // The first 8 bytes of the hash of so many bytes that count up to 250 (test_vectors.json of the reference implementation).
  const vectors = { 0: "af1349b9f5f9a1a6", 1: "2d3adedff11b61f1", 1023: "10108970eeda3eb9", 1024: "42214739f095a406", 1025: "d00278ae47eb27b3", 2049: "5f4d72f40d7a5f82", 102400: "bc3e3d41a1146b06" };
  for (const [length, hash] of Object.entries(vectors)) {
    const bytes = Uint8Array.from({ length: +length }, (_, i) => i % 251);
    const found = Buffer.alloc(8);
    found.writeBigUInt64LE(checksum(bytes));
    assert.equal(found.toString("hex"), hash, `${length} bytes`);
  }
});

function zstd(raw, ...options) {
  try {
    return new Uint8Array(execFileSync("zstd", ["-q", "-c", "--no-check", `--stream-size=${raw.length}`, ...options], { input: raw, maxBuffer: 1 << 28 }));
  } catch {
    return null;
  }
}

test("zstd frames of every kind of block are decoded", (context) => {
  const next = numbers(7);
  const inputs = [
    new Uint8Array(100_000).fill(7),
    Uint8Array.from({ length: 300_000 }, () => next(256)),
    Uint8Array.from({ length: 300_000 }, (_, i) => (next(10) === 0 ? next(256) : (i * i) >> 7)),
    new TextEncoder().encode("some words come again and again, and some words do not ".repeat(3000)),
    Uint8Array.from({ length: 1000 }, () => next(3)),
  ];
  if (!zstd(inputs[0])) {
    return context.skip("no program zstd here");
  }
  for (const raw of inputs) {
    for (const level of ["-1", "-3", "-12", "-19"]) {
      const frame = zstd(raw, level);
      assert.deepEqual(decompress(frame, raw.length), raw);
      assert.throws(() => decompress(frame, raw.length - 1), RangeError);
      assert.throws(() => decompress(frame.subarray(0, frame.length - 1), raw.length), RangeError);
    }
  }
});
