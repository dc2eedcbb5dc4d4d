import assert from "node:assert/strict";
import { copyFileSync, mkdirSync, mkdtempSync, rmSync } from "node:fs";
import { basename, join } from "node:path";
import { fileURLToPath } from "node:url";
import { after, before, test } from "node:test";
import { launch, open, serve } from "./browser.mjs";
import { LONG, texfold } from "./support.mjs";

const root = fileURLToPath(new URL("../..", import.meta.url));
const browser = await launch();
const options = { skip: browser ? false : "no Chromium here" };
/** Columns and rows of a view. */
const VIEW = 64;
/** Updates within which all tiles of a view are there. */
const UPDATES = 3;
let server, page, faults, folder;

before(async () => {
  if (browser) {
    mkdirSync(join(root, "target"), { recursive: true });
    folder = mkdtempSync(join(root, "target/tiles-"));
    server = await serve(root);
    ({ page, faults } = await open(browser, `${server.url}web/test/page.html`));
  }
});

after(async () => {
  await browser?.close();
  server?.close();
  if (folder) {
    rmSync(folder, { recursive: true });
  }
});

const file = (name) => `/fixtures/golden/${name}.txf`;
const cache = (urls, options = {}) => page.evaluate(([urls, options]) => window.cache(urls, options), [urls, { poolBytes: 1 << 22, stride: 1, textures: 16, ...options }]);
const frame = async (...view) => {
  const { data, ...report } = await page.evaluate((view) => window.frame(...view), view);
  return { ...report, texels: Buffer.from(data, "base64") };
};

/** A view once all of its tiles are there. */
async function settled(...view) {
  for (let update = 0; update < UPDATES; update++) {
    await frame(...view);
  }
  const { missing, bias, texels } = await frame(...view);
  assert.deepEqual([missing, bias], [0, 0]);
  return texels;
}

/** The largest difference between a view of a texture and decoded texels of a region. */
function difference(view, { width, height, data }) {
  const texels = Buffer.from(data, "base64");
  let largest = 0;
  for (let y = 0; y < height; y++) {
    for (let at = 0; at < 4 * width; at++) {
      largest = Math.max(largest, Math.abs(view[4 * VIEW * y + at] - texels[4 * width * y + at]));
    }
  }
  return largest;
}

/** Levels of the long image that the browser's device cannot hold whole, so that its texels are not decoded to be compared with. */
const TOO_LONG = 3;

test("tiles of all codecs of images equal decoded texels", options, async () => {
  const files = ["dct", "dct_alpha", "bc_bc7", "vq_bc1_mips", "epitome_block", "epitome_errors", "progressive", "zipmap_block", "zipmap_means"].map(file);
  const urls = [...files, `data:;base64,${LONG}`];
  const textures = await cache(urls);
  for (const [number, url] of urls.entries()) {
    const { images: [size], levels } = await page.evaluate(async (url) => (await window.openFile(url)).layout, url);
    const skipped = url.startsWith("data") ? TOO_LONG : 0;
    const views = Array.from({ length: levels - skipped }, (_, number) => {
      const level = number + skipped, [width, height] = [size.width, size.height].map((side) => Math.max(1, side >> level));
      // Across a border of tiles where there is one.
      const [x, y] = [width, height].map((side) => Math.max(0, Math.min(side - VIEW, 90)));
      const region = { level: number, x, y, width: Math.min(VIEW, width), height: Math.min(VIEW, height) };
      return { region, view: [level, [x, y], [width, height]] };
    });
    const wanted = await page.evaluate(([url, regions]) => window.decoded(url, regions), [url, views.map(({ region }) => region)]);
    for (const [at, { view }] of views.entries()) {
      const found = difference(await settled(textures[number], ...view), wanted[at]);
      assert.ok(found <= 1, `${url.slice(0, 60)}, level ${view[0]}: ${found}`);
    }
  }
  assert.deepEqual(faults, []);
});

test("a pool that is too small shows coarser levels, and says so", options, async () => {
  const [texture] = await cache([`data:;base64,${LONG}`], { poolBytes: 1 << 20 });
  // The view reads 64 of 274 tiles of level 0; 15 fit beside the tails.
  let report;
  for (let update = 0; update < 12; update++) {
    report = await frame(texture, 0, [0, 0], [64, 64]);
  }
  assert.ok(report.bias > 0, JSON.stringify(report));
  assert.ok(report.texels.some((value) => value > 0));
  assert.deepEqual(faults, []);
});

test("textures come, are replaced and go, and a full cache is an error that names its option", options, async () => {
  const [first, second] = await cache([file("dct"), file("vq_bc1_mips")], { textures: 2, streamBytes: 1 << 18 });
  const view = [[0, 0], [32, 32]];
  const old = await settled(first, 0, ...view);
  const run = (action) => page.evaluate(action, [first, second, file("dct_alpha"), file("epitome_block")]);
  const full = await run(async ([, , url]) => window.tiles.add(await window.openFile(url)).catch((error) => error.message));
  assert.match(full, /cache of tiles is full: all textures are in use; raise textures or remove textures/);
  assert.deepEqual(await settled(first, 0, ...view), old);
  await run(async ([first, , url]) => window.tiles.replace([first], await window.openFile(url)));
  assert.notDeepEqual(await settled(first, 0, ...view), old);
  await run(([, second]) => window.tiles.remove(second));
  assert.ok((await frame(second, 0, ...view)).texels.every((value) => value === 0));
  // Whatever is removed leaves its room to others.
  const bytes = await run(async ([, , url, other]) => {
    for (let turn = 0; turn < 40; turn++) {
      const [number] = await window.tiles.add(await window.openFile(turn % 2 ? other : url));
      window.tiles.remove(number);
    }
    await window.tiles.add(await window.openFile(other));
    return window.tiles.bytes;
  });
  assert.ok(bytes > 1 << 22);
  assert.deepEqual(faults, []);
});

test("maps of a material from one lookup equal decoded texels", options, async () => {
  const url = file("dct_maps");
  const [material] = await cache([url], { contents: "materials" });
  const { images: [size], maps } = await page.evaluate(async (url) => (await window.openFile(url)).layout, url);
  // Of each map the layer that the page's shader shows, its first channel there, and how many there are.
  const places = { color: [1, 0, 4], normal: [2, 0, 3], height: [2, 3, 1], roughness: [3, 1, 1] };
  for (const level of [0, 1, 3]) {
    const [width, height] = [size.width, size.height].map((side) => side >> level);
    // Across a border of tiles on level 0.
    const [x, y] = [width, height].map((side) => Math.max(0, Math.min(side - VIEW, 90)));
    const region = { level, x, y, width: Math.min(VIEW, width), height: Math.min(VIEW, height) };
    const wanted = await page.evaluate(([url, regions]) => window.decoded(url, regions), [url, maps.map((_, image) => ({ ...region, image }))]);
    for (const [image, { kind }] of maps.entries()) {
      const [layer, channel, count] = places[kind];
      const view = await settled(material, level, [x, y], [width, height], layer), texels = Buffer.from(wanted[image].data, "base64");
      let largest = 0;
      for (let at = 0; at < region.width * region.height; at++) {
        const [column, row] = [at % region.width, Math.floor(at / region.width)];
        for (let own = 0; own < count; own++) {
          largest = Math.max(largest, Math.abs(view[4 * (VIEW * row + column) + channel + own] - texels[4 * at + own]));
        }
      }
      assert.ok(largest <= 1, `${kind}, level ${level}: ${largest}`);
    }
    // Maps that are missing.
    const view = await settled(material, level, [x, y], [width, height], 3);
    assert.deepEqual([view[0], view[2], view[3]], [255, 255, 255]);
  }
  // What follows under its number is looked up by itself.
  await page.evaluate(async ([material, url]) => {
    window.tiles.remove(material);
    await window.tiles.add(await window.openFile(url), { srgb: false });
  }, [material, file("dct")]);
  const [wanted] = await page.evaluate(([url]) => window.decoded(url, [{ level: 0, x: 0, y: 0, width: 32, height: 32 }]), [file("dct")]);
  const { images: [{ width, height }] } = await page.evaluate(async (url) => (await window.openFile(url)).layout, file("dct"));
  assert.ok(difference(await settled(material, 0, [0, 0], [width, height]), wanted) <= 1);
  const refused = (url) => page.evaluate(async (url) => window.tiles.addMaterial(await window.openFile(url)).then(() => "added", (error) => error.message), url);
  assert.match(await refused(file("dct_material")), /the sides of a map are not those of the largest, halves, quarters or eighths; add\(\) looks its maps up one by one/);
  assert.match(await refused(file("dct")), /the texture has no maps/);
  await cache([]);
  assert.match(await refused(url), /the cache has no layers for such a map; make it for materials/);
  assert.deepEqual(faults, []);
});

test("maps of half and quarter the sides are enlarged where they lack a level", options, async () => {
  for (const [name, kind] of [["facade", "BaseColor"], ["normal_map", "Normal"], ["constant", "Roughness"], ["black", "Metallic"]]) {
    copyFileSync(join(root, `fixtures/images/${name}.png`), join(folder, `wall_${kind}.png`));
  }
  texfold("compress", folder, "--as", "material", "--bpp", "4", "--effort", "fast", "--mips", "--out", folder);
  const url = `/target/${basename(folder)}/wall.txf`, sides = { color: 256, normal: 128 };
  const [material] = await cache([url], { contents: "materials" });
  const { maps } = await page.evaluate(async (url) => (await window.openFile(url)).layout, url);
  for (const [kind, layer] of [["color", 1], ["normal", 2]]) {
    const image = maps.findIndex((map) => map.kind === kind), halvings = Math.log2(256 / sides[kind]);
    for (const level of [0, 1, 3]) {
      const side = 256 >> level, own = Math.max(level - halvings, 0), few = sides[kind] >> own, at = Math.max(0, Math.min(side - VIEW, 90));
      const [{ data }] = await page.evaluate(([url, region]) => window.decoded(url, [region]), [url, { image, level: own, x: 0, y: 0, width: few, height: few }]);
      const view = await settled(material, level, [at, at], [side, side], layer), texels = Buffer.from(data, "base64");
      const taps = (place) => {
        const found = ((place + 0.5) * few) / side - 0.5, low = Math.floor(found);
        return [[(low + few) % few, 1 - (found - low)], [(low + 1) % few, found - low]];
      };
      let largest = 0;
      for (let place = 0; place < Math.min(VIEW, side) ** 2; place++) {
        const [column, row] = [place % Math.min(VIEW, side), Math.floor(place / Math.min(VIEW, side))];
        for (let channel = 0; channel < 3; channel++) {
          let wanted = 0;
          for (const [y, one] of taps(at + row)) {
            for (const [x, other] of taps(at + column)) {
              wanted += one * other * texels[4 * (y * few + x) + channel];
            }
          }
          largest = Math.max(largest, Math.abs(view[4 * (VIEW * row + column) + channel] - wanted));
        }
      }
      assert.ok(largest <= 1.01, `${kind}, level ${level}: ${largest}`);
    }
  }
  assert.deepEqual(faults, []);
});

test("sizes that a device does not have are refused with its limit", options, async () => {
  const refused = (options) => page.evaluate((options) => window.cache([], options).then(() => "made", (error) => error.message), options);
  assert.match(await refused({ streamBytes: 2 ** 40 }), /maxStorageBufferBindingSize of 1099511627776, the device was made with \d+/);
  assert.match(await refused({ poolBytes: 1 << 20, textures: 1000 }), /fill half of the pool; raise poolBytes/);
  assert.deepEqual(faults, []);
});
