import assert from "node:assert/strict";
import { fileURLToPath } from "node:url";
import { readFileSync } from "node:fs";
import { after, before, test } from "node:test";
import { PNG } from "pngjs";
import { launch, open, serve } from "./browser.mjs";
import { golden, names } from "./support.mjs";

/** Largest difference in 8-bit steps by content of planes: hardware may round BC1 to BC5 differently (Direct3D 11.3, 19.5), and filters in floats. */
const BOUNDS = { dct: 0, vq_raw_sequence: 0, bc_bc7: 0 };
const ROUNDING = 2;

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

/** Pictures of a file: suffix, image, level, bytes of the file. */
function pictures(name) {
  const folder = new URL("../../fixtures/golden/", import.meta.url);
  const found = [];
  const add = (suffix, region) => {
    try {
      found.push([PNG.sync.read(readFileSync(new URL(`${name}${suffix}.png`, folder))), region, suffix]);
    } catch (error) {
      assert.equal(error.code, "ENOENT");
    }
  };
  add("", {});
  for (let level = 1; level < 6; level++) {
    add(`-level${level}`, { level });
  }
  for (let image = 0; image < 5; image++) {
    add(`-00${image}`, { image });
  }
  return found;
}

test("golden files are decoded on the GPU to the texels of the CPU", options, async () => {
  for (const file of names.filter((name) => !name.startsWith("lightfield"))) {
    const name = file.replace(".txf", "");
    const wanted = pictures(name);
    assert.ok(wanted.length > 0, name);
    const found = await page.evaluate(
      ([file, regions]) => window.decoded(`/fixtures/golden/${file}`, regions),
      [file, wanted.map(([, region]) => region)],
    );
    wanted.forEach(([picture, , suffix], number) => {
      const { width, height, data } = found[number];
      assert.deepEqual([width, height], [picture.width, picture.height], name + suffix);
      const bytes = Buffer.from(data, "base64");
      let largest = 0;
      for (let i = 0; i < bytes.length; i++) {
        largest = Math.max(largest, Math.abs(bytes[i] - picture.data[i]));
      }
      assert.ok(largest <= (BOUNDS[name] ?? ROUNDING), `${name}${suffix} differs by ${largest}`);
    });
  }
  assert.deepEqual(faults, []);
});

test("light fields are drawn on their mesh as by the CPU", options, async () => {
  for (const file of names.filter((name) => name.startsWith("lightfield"))) {
    const { size: [width, height], ...camera } = golden[file].camera;
    const name = file.replace(".txf", "");
    const wanted = PNG.sync.read(readFileSync(new URL(`../../fixtures/golden/${name}.png`, import.meta.url)));
    const drawn = (terms) => page.evaluate(
      ([file, camera, width, height]) => window.drawn(`/fixtures/golden/${file}`, camera, width, height),
      [file, { ...camera, background: [0, 0, 0, 0], terms }, width, height],
    );
    const found = Buffer.from(await drawn(8), "base64");
    assert.equal(found.length, wanted.data.length, name);
    // A pixel at the rim may be inside on one side and outside on the other.
    const off = found.filter((byte, at) => Math.abs(byte - wanted.data[at]) > ROUNDING).length;
    assert.ok(off <= found.length / 500, `${name}: ${off} of ${found.length} values differ by more than ${ROUNDING}`);
    assert.notEqual(await drawn(0), found.toString("base64"), `${name} without terms`);
  }
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
