import assert from "node:assert/strict";
import { fileURLToPath } from "node:url";
import { after, test } from "node:test";
import { PNG } from "pngjs";
import { launch, open, serve } from "./browser.mjs";

const browser = await launch();
const server = await serve(fileURLToPath(new URL("../..", import.meta.url)));
const options = { skip: browser ? false : "no Chromium here" };
after(async () => {
  await browser?.close();
  server.close();
});

/** Share of the pixels of a page that differ from its ground, and the number of colours among them. */
async function shown(page) {
  const { data } = PNG.sync.read(await page.screenshot());
  const colours = new Set();
  let count = 0;
  for (let at = 0; at < data.length; at += 4) {
    if (data.subarray(at, at + 3).some((value) => Math.abs(value - 0x22) > 8)) {
      count++;
      colours.add(data.readUIntBE(at, 3));
    }
  }
  return { share: count / (data.length / 4), colours: colours.size };
}

test("three.js draws a texture on a box", options, async () => {
  const { page, faults } = await open(browser, `${server.url}web/examples/three.html`, { viewport: { width: 600, height: 400 } });
  await page.waitForFunction(() => globalThis.drawn > 2, null, { timeout: 60_000 });
  const { share, colours } = await shown(page);
  assert.ok(share > 0.1 && share < 0.5 && colours > 100, `${share} of the page in ${colours} colours`);
  assert.deepEqual(faults, []);
  await page.close();
});

test("three.js draws a packed scene of glTF, each map in its place", options, async () => {
  const { page, faults } = await open(browser, `${server.url}web/examples/gltf.html`, { viewport: { width: 600, height: 400 } });
  await page.waitForFunction(() => globalThis.drawn > 2, null, { timeout: 60_000 });
  const { share, colours } = await shown(page);
  assert.ok(share > 0.05 && share < 0.6 && colours > 100, `${share} of the page in ${colours} colours`);
  const maps = await page.evaluate(() => {
    const [{ map, normalMap, roughnessMap }] = globalThis.materials;
    return [map, normalMap, roughnessMap].map(({ name, wrapS, sourceTexture: { width, height, format, mipLevelCount } }) => ({ name, wrapS, width, height, format, mipLevelCount }));
  });
  assert.deepEqual(maps, [
    { name: "m_BaseColor", wrapS: 1001, width: 128, height: 128, format: "rgba8unorm-srgb", mipLevelCount: 8 },
    { name: "m_Normal", wrapS: 1001, width: 128, height: 128, format: "rgba8unorm", mipLevelCount: 8 },
    { name: "m_Height", wrapS: 1001, width: 96, height: 96, format: "rgba8unorm", mipLevelCount: 7 },
  ]);
  assert.deepEqual(faults, []);
  await page.close();
});

test("OpenSeadragon shows a zoom stack tile by tile", options, async () => {
  const { page, faults } = await open(browser, `${server.url}web/examples/openseadragon.html`, { viewport: { width: 600, height: 400 } });
  const isLoaded = () => globalThis.viewer?.world?.getItemAt(0)?.getFullyLoaded();
  await page.waitForFunction(isLoaded, null, { timeout: 60_000 });
  await page.waitForTimeout(500);
  const { share, colours } = await shown(page);
  // 296 x 488 texels, as high as the page.
  assert.ok(Math.abs(share - (400 * 296) / 488 / 600) < 0.02 && colours > 1000, `${share} of the page in ${colours} colours`);
  await page.evaluate(() => globalThis.viewer.viewport.zoomTo(4, undefined, true));
  await page.waitForFunction(isLoaded);
  await page.waitForTimeout(500);
  assert.ok((await shown(page)).share > 0.99);
  assert.deepEqual(faults, []);
  await page.close();
});
