// KTX2 files that `texfold decompress --to` writes, as ktx-parse reads them.
import assert from "node:assert/strict";
import { mkdtempSync, readFileSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { after, test } from "node:test";
import { KHR_DF_MODEL_RGBSDA, KHR_DF_TRANSFER_SRGB, KHR_SUPERCOMPRESSION_NONE, KHR_SUPERCOMPRESSION_ZSTD, read, VK_FORMAT_BC7_SRGB_BLOCK, VK_FORMAT_R8G8B8A8_SRGB } from "ktx-parse";
import { texfold } from "./support.mjs";

// KHR_DF_MODEL_BC7 of the Khronos data format specification.
const MODEL_BC7 = 134;
const folder = mkdtempSync(join(tmpdir(), "texfold-ktx-"));

after(() => rmSync(folder, { recursive: true }));

for (const [to, format, model, bytes] of [["bc7", VK_FORMAT_BC7_SRGB_BLOCK, MODEL_BC7, 1], ["rgba8", VK_FORMAT_R8G8B8A8_SRGB, KHR_DF_MODEL_RGBSDA, 4]]) {
  for (const zstd of [false, true]) {
    test(`${to}${zstd ? " with Zstandard" : ""} is read`, () => {
      const out = join(folder, `${to}-${zstd}`), options = zstd ? ["--zstd"] : [];
      texfold("decompress", "fixtures/golden/dct_alpha.txf", "--to", to, ...options, "--out", out);
      const container = read(new Uint8Array(readFileSync(join(out, "dct_alpha.ktx2"))));
      assert.deepEqual([container.vkFormat, container.pixelWidth, container.pixelHeight, container.faceCount, container.layerCount], [format, 128, 128, 1, 0]);
      assert.equal(container.supercompressionScheme, zstd ? KHR_SUPERCOMPRESSION_ZSTD : KHR_SUPERCOMPRESSION_NONE);
      const [descriptor] = container.dataFormatDescriptor;
      assert.deepEqual([descriptor.colorModel, descriptor.transferFunction], [model, KHR_DF_TRANSFER_SRGB]);
      assert.equal(descriptor.bytesPlane[0], to === "bc7" ? 16 : 4);
      assert.match(container.keyValue.KTXwriter, /^Texfold /);
      // Blocks are of 4x4 texels.
      const sides = [0, 1, 2, 3, 4, 5, 6, 7].map((level) => (bytes === 1 ? Math.max(4, 128 >> level) : 128 >> level));
      assert.deepEqual(container.levels.map((level) => level.uncompressedByteLength), sides.map((side) => side * side * bytes));
      assert.ok(zstd || container.levels.every((level) => level.levelData.byteLength === level.uncompressedByteLength));
    });
  }
}
