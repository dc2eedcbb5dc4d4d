import assert from "node:assert/strict";
import { fileURLToPath } from "node:url";
import { after, before, test } from "node:test";
import { launch, open, serve } from "./browser.mjs";
import { goldenItems } from "../golden.mjs";
import { decodeBlocks, open as openFile } from "../dist/test.js";
import { golden, LONG } from "./support.mjs";

const root = fileURLToPath(new URL("../..", import.meta.url));
const browser = await launch();
const options = { skip: browser ? false : "no Chromium here" };
let server, page, faults;

before(async () => {
  if (browser) {
    server = await serve(root);
    ({ page, faults } = await open(browser, `${server.url}web/test/page.html`));
  }
});

after(async () => {
  await browser?.close();
  server?.close();
});

test("all golden files are the same on the GPU as on the CPU", options, async () => {
  const { page, faults } = await open(browser, `${server.url}web/dist/conformance.html`, { viewport: { width: 1400, height: 900 } });
  await page.locator("strong").waitFor({ timeout: 60_000 });
  const items = goldenItems(), pictures = items.reduce((sum, item) => sum + item.pictures.length, 0);
  assert.ok(items.every((item) => item.pictures.length > 0));
  const line = await page.locator("#line").textContent();
  assert.ok(line.startsWith(`texfold 0.1.0: ${pictures} of ${pictures} on `), `${line}\n${await page.locator("#rows").innerText()}`);
  for (const width of [1400, 400]) {
    await page.setViewportSize({ width, height: 900 });
    const sideways = await page.evaluate(() => document.documentElement.scrollWidth - innerWidth);
    assert.ok(sideways <= 0, `the page is wider than ${width} pixels`);
  }
  assert.deepEqual(faults, []);
  await page.close();
});

test("a light field without terms is its mean", options, async () => {
  const { size: [width, height], ...camera } = golden["lightfield.txf"].camera;
  const drawn = (terms) =>
    page.evaluate(
      ([camera, width, height]) => window.drawn("/fixtures/golden/lightfield.txf", camera, width, height),
      [{ ...camera, terms }, width, height],
    );
  assert.notEqual(await drawn(0), await drawn(1));
  assert.equal(await drawn(1), await drawn(9));
  assert.deepEqual(faults, []);
});

test("blocks are decoded on the CPU to the texels of the GPU, whole and in parts", options, async () => {
  for (const file of ["dct", "dct_alpha", "zipmap_means"]) {
    const levels = [0, 1, 2, 3, 4].map((level) => ({ level }));
    const decoded = (options) =>
      page.evaluate(([file, levels, options]) => window.decoded(`/fixtures/golden/${file}.txf`, levels, options), [file, levels, options]);
    const wanted = await decoded({ blocks: "gpu" });
    for (const options of [{ blocks: "cpu" }, { coarseFirst: true }, { coarseFirst: true, blocks: "gpu" }]) {
      assert.deepEqual(await decoded(options), wanted, `${file} ${JSON.stringify(options)}`);
    }
  }
  assert.deepEqual(faults, []);
});

test("of images that the device cannot hold coarser levels are drawn", options, async () => {
  const [, stage] = (await openFile(Buffer.from(LONG, "base64"))).form.blocks;
  assert.deepEqual([stage.level, stage.layout.size], [3, { width: 4096, height: 1 }]);
  const wanted = decodeBlocks(stage, { level: 0, x: 0, y: 0, width: 4096, height: 1 });
  const [found] = await page.evaluate((data) => window.decoded(`data:;base64,${data}`, [{}], { blocks: "gpu" }), LONG);
  assert.deepEqual([found.width, found.height], [4096, 1]);
  assert.deepEqual(Buffer.from(found.data, "base64"), Buffer.from(wanted));
  assert.deepEqual(faults, []);
});

test("regions beyond a level are errors that say what to do", options, async () => {
  const message = await page.evaluate(() => window.decoded("/fixtures/golden/dct.txf", [{ x: 30, width: 8 }]).catch((error) => error.message));
  assert.match(message, /no such region; level 0 of \d has 37x61 texels: cut it to them/);
});

test("a view is drawn where it says, over its background", options, async () => {
  const pixels = await page.evaluate(() => window.drawn("/fixtures/golden/dct.txf", { x: -10, y: -10, scale: 2, background: [0, 0, 1] }, 100, 100));
  const at = (x, y) => [...Buffer.from(pixels, "base64").subarray(4 * (100 * y + x), 4 * (100 * y + x) + 3)];
  assert.deepEqual([at(19, 50), at(50, 19), at(95, 50)], [[0, 0, 255], [0, 0, 255], [0, 0, 255]]);
  assert.notDeepEqual(at(20, 50), [0, 0, 255]);
  assert.notDeepEqual(at(93, 50), [0, 0, 255]);
  assert.deepEqual(faults, []);
});
