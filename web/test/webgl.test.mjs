// Shaders in GLSL ES 3.00, as `texfold shaders --lang essl` writes them, draw golden files by WebGL 2.
import assert from "node:assert/strict";
import { mkdtempSync, readFileSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { fileURLToPath } from "node:url";
import { after, before, test } from "node:test";
import { launch, open, serve, WEBGL } from "./browser.mjs";
import { open as openFile } from "../dist/test.js";
import { names, read, texfold } from "./support.mjs";

const root = fileURLToPath(new URL("../..", import.meta.url));
const browser = await launch(), webgl = await launch(WEBGL);
const options = { skip: browser ? false : "no Chromium here" };
const folder = mkdtempSync(join(tmpdir(), "texfold-essl-"));
let server;

before(async () => {
  if (browser) {
    server = await serve(root);
    texfold("shaders", "--lang", "essl", "--out", folder);
  }
});

after(async () => {
  await browser?.close();
  await webgl?.close();
  server?.close();
  rmSync(folder, { recursive: true });
});

/** Sources of a module, and the names of its bindings. */
function shaderOf(module) {
  const text = (ending) => readFileSync(join(folder, `${module}.${ending}`), "utf8");
  const bindings = JSON.parse(text("json")).bindings.map(({ place, ...binding }) => ({ ...binding, names: place.split(" ").slice(1) }));
  return [{ vertex: text("vertex_main.vert"), fragment: text("fragment_main.frag") }, bindings];
}

test("golden files are drawn by WebGL as by WebGPU", options, async () => {
  const { page: gpu } = await open(browser, `${server.url}web/test/page.html`);
  const { page, faults } = await open(webgl, `${server.url}web/test/webgl.html`);
  const drawn = new Set();
  for (const name of names) {
    const { form, layout } = await openFile(read(name)), url = `/fixtures/golden/${name}`;
    if (form.blocks.length > 0 || form.module === "lightfield" || (await page.evaluate((url) => window.lacks(url), url)).length > 0) {
      continue;
    }
    for (const image of new Set([0, layout.images.length - 1])) {
      for (const level of new Set([0, Math.min(2, layout.levels - 1), layout.levels - 1])) {
        const found = await page.evaluate((all) => window.drawnByWebGl(...all), [url, ...shaderOf(form.module), image, level]);
        const view = [url, { image, scale: 2 ** -level }, found.width, found.height];
        const wanted = Buffer.from(await gpu.evaluate((view) => window.drawn(...view), view), "base64");
        // The canvas shows texels on black.
        const shown = found.pixels.map((value, at) => (at % 4 === 3 ? 255 : Math.round((value * found.pixels[at | 3]) / 255)));
        const apart = shown.reduce((most, value, at) => Math.max(most, Math.abs(value - wanted[at])), 0);
        assert.ok(apart <= 1, `${name}, image ${image}, level ${level}: apart by ${apart}`);
        drawn.add(form.module);
      }
    }
  }
  assert.deepEqual([...drawn].sort(), ["bc", "epitome", "epitome-errors", "progressive", "vq", "zipmap"]);
  assert.deepEqual(faults, []);
});
