import assert from "node:assert/strict";
import { createHash } from "node:crypto";
import { readFileSync } from "node:fs";
import { createServer } from "node:http";
import { after, before, test } from "node:test";
import { launch, open } from "./browser.mjs";
import { read } from "./support.mjs";

const browser = await launch();
const options = { skip: browser ? false : "no Chromium here" };
const base64 = (bytes) => Buffer.from(bytes).toString("base64");
const image = (name) => base64(readFileSync(new URL(`../../fixtures/golden/${name}`, import.meta.url)));
const name = "a \"leaf\" </script> é.txf";
const items = [
  { name, data: base64(read("dct_alpha.txf")), originals: [image("dct_alpha.png")], still: image("dct_alpha-level1.png") },
  { name: "ball.txf", data: base64(read("lightfield_block.txf")), originals: [], sphere: { centre: [0, 0, 0], radius: 1 } },
  { name: "zoom.txf", data: base64(read("zipmap_block.txf")), originals: [] },
  { name: "broken.txf", data: base64(read("dct.txf").subarray(0, 300)), originals: [], still: image("dct.png") },
];

/** Encodings of one input, and a smaller image in the place of what another encoder makes of it. */
const alike = {
  items: ["dct_alpha", "zipmap_block"].map((file) => ({ name: file, data: base64(read(`${file}.txf`)), originals: [], group: "leaf.png" })),
  groups: { "leaf.png": { originals: [image("dct_alpha.png")], rivals: [{ name: "astc 8x8", data: image("dct_alpha-level1.png") }] } },
};

/** A bank of two tiles, of which the second is not there. */
const tile = (file, x) => ({ file, x, y: 0, width: 128, height: 128 });
const bank = { name: "leaves", width: 256, height: 128, fileBytes: 40000, compressedBytes: 40000, tiles: [tile("a b.txf", 0), tile("gone.txf", 128)] };

/** The page with these files, as the program writes it. */
function page(files, groups = {}) {
  const text = readFileSync(new URL("../../crates/cli/src/view/page.html", import.meta.url), "utf8");
  return text.replace("@DATA@", () => JSON.stringify({ items: files, groups, isServed: false }).replaceAll("<", "\\u003c"));
}

let server, url;
before(async () => {
  server = createServer((request, response) => {
    if (request.url.startsWith("/bank/0/")) {
      const isThere = request.url === "/bank/0/a%20b.txf";
      return response.writeHead(isThere ? 200 : 404).end(isThere ? read("dct_alpha.txf") : "");
    }
    if (request.url === "/map") {
      return response.writeHead(200, { "content-type": "text/html" }).end(page([{ name: "a bank", data: "", originals: [], bank: { images: [bank] } }, items[0]]));
    }
    const text = request.url === "/alike" ? page(alike.items, alike.groups) : page(items);
    response.writeHead(200, { "content-type": "text/html" }).end(text);
  });
  await new Promise((resolve) => server.listen(0, "127.0.0.1", resolve));
  url = `http://127.0.0.1:${server.address().port}/`;
});
after(async () => {
  await browser?.close();
  server.close();
});

/** Waits until something was drawn since `frames`. */
const drawn = (page, frames) => page.waitForFunction((frames) => globalThis.page?.frames > frames, frames, { timeout: 60_000 });
const frames = (page) => page.evaluate(() => globalThis.page?.frames ?? 0);

/** Does something and gives the pixels of the stage that come of it. */
async function shot(page, act) {
  const before = await frames(page);
  await act();
  await drawn(page, before);
  return picture(page);
}

/** What the stage shows, as a hash. */
async function picture(page) {
  return createHash("sha1").update(await page.locator("#stage").screenshot()).digest("hex");
}

test("between encodings of one input the view stays", options, async () => {
  const { page, faults } = await open(browser, `${url}alike#1`, { viewport: { width: 1000, height: 800 } });
  await drawn(page, 0);
  assert.equal(await page.locator("h1").textContent(), "zipmap_block");
  await page.locator("#view").focus();
  await shot(page, () => page.locator("#view").press("+"));
  await shot(page, () => page.locator("#view").press("ArrowLeft"));
  const rival = await shot(page, () => page.getByRole("button", { name: "astc 8x8" }).click());
  const original = await shot(page, () => page.getByRole("button", { name: "Original" }).click());
  assert.notEqual(rival, original);
  assert.equal(await shot(page, () => page.getByLabel("File", { exact: true }).selectOption("0")), original);
  assert.deepEqual(faults, []);
  await page.close();
});

for (const [width, height, colorScheme] of [[1400, 900, "light"], [400, 800, "dark"]]) {
  test(`files are shown at ${width} pixels, ${colorScheme}`, options, async () => {
    const { page, faults } = await open(browser, url, { viewport: { width, height }, colorScheme });
    await drawn(page, 0);
    assert.equal(await page.locator("h1").textContent(), name);
    await page.locator("#view").focus();
    const pictures = [await picture(page)];
    for (const mode of ["Side by side", "Error x8"]) {
      pictures.push(await shot(page, () => page.getByRole("button", { name: mode }).click()));
    }
    await shot(page, () => page.getByRole("button", { name: "Decoded" }).click());
    pictures.push(await shot(page, () => page.getByLabel("Map of bits").check()));
    await shot(page, () => page.getByLabel("Map of bits").uncheck());
    await page.locator("#view").press("Shift");
    pictures.push(await shot(page, () => page.locator("#view").press("+")));
    pictures.push(await shot(page, () => page.locator("#view").press("ArrowLeft")));
    assert.equal(await shot(page, () => page.locator("#view").press("0")), pictures[0], "0 shows the whole image again");
    pictures.push(await shot(page, () => page.getByLabel("Mip level").selectOption("6")));
    for (const file of ["1", "2"]) {
      pictures.push(await shot(page, () => page.getByLabel("File", { exact: true }).selectOption(file)));
      pictures.push(await shot(page, async () => {
        const { x, y } = await page.locator("#view").boundingBox();
        await page.mouse.move(x + 150, y + 150);
        await page.mouse.down();
        await page.mouse.move(x + 220, y + 180);
        await page.mouse.up();
      }));
    }
    assert.equal(new Set(pictures).size, pictures.length, "pictures that should differ are the same");
    const sideways = await page.evaluate(() => document.documentElement.scrollWidth - innerWidth);
    assert.ok(sideways <= 0, "the page is wider than its window");
    assert.deepEqual(faults, []);
    await page.close();
  });
}

test("a file that cannot be read is told, and shown as a picture", options, async () => {
  const { page, faults } = await open(browser, url);
  await drawn(page, 0);
  await page.getByLabel("File", { exact: true }).selectOption("3");
  await page.getByText("fetch the rest of it").waitFor();
  assert.equal(await page.locator("#still img").count(), 1);
  assert.deepEqual(faults, []);
  await page.close();
});

test("a GPU that is lost is told", options, async () => {
  const { page, faults } = await open(browser, url);
  await drawn(page, 0);
  await page.evaluate(() => globalThis.page.gpu.device.destroy());
  await page.getByText("the GPU was lost; load the page again").waitFor();
  assert.deepEqual(faults, []);
  await page.close();
});

test("without WebGPU a picture and the reason are shown", options, async () => {
  const context = await browser.newContext();
  await context.addInitScript(() => Object.defineProperty(Navigator.prototype, "gpu", { value: undefined }));
  const page = await context.newPage();
  await page.goto(url);
  await page.getByText("no WebGPU here").waitFor();
  assert.equal(await page.locator("#still img").count(), 1);
  assert.match(await page.locator("#facts").textContent(), /Bits a texel in memory/);
  await context.close();
});

test("a bank is a map of its tiles; those that cannot be shown are named", options, async () => {
  const { page, faults } = await open(browser, `${url}map`, { viewport: { width: 1000, height: 800 } });
  await page.getByRole("alert").waitFor();
  assert.match(await page.getByRole("alert").textContent(), /gone\.txf: the server answers 404/);
  await page.waitForFunction(() => globalThis.page.bank.held.size === 1);
  await page.locator("#view").focus();
  const whole = await picture(page);
  const pictures = [whole, await shot(page, () => page.locator("#view").press("+")), await shot(page, () => page.locator("#view").press("ArrowRight"))];
  assert.equal(new Set(pictures).size, 3);
  assert.equal(await shot(page, () => page.locator("#view").press("0")), whole);
  await shot(page, () => page.getByLabel("File", { exact: true }).selectOption("1"));
  assert.equal(await page.locator("h1").textContent(), name);
  assert.deepEqual(faults.filter((fault) => !fault.includes("404")), []);
  await page.close();
});

test("a file that is dropped is shown beside those that are there", options, async () => {
  const { page, faults } = await open(browser, url);
  await drawn(page, 0);
  const before = await frames(page);
  const chooser = page.getByLabel("Image or .txf file");
  await chooser.setInputFiles({ name: "mine.txf", mimeType: "", buffer: Buffer.from(read("vq_bc1_mips.txf")) });
  await drawn(page, before);
  assert.equal(await page.locator("h1").textContent(), "mine.txf");
  assert.equal(await page.getByLabel("File", { exact: true }).locator("option").count(), items.length + 1);
  await chooser.setInputFiles({ name: "photo.png", mimeType: "image/png", buffer: Buffer.from("x") });
  await page.getByText("start texfold view --serve to encode images").waitFor();
  assert.deepEqual(faults, []);
  await page.close();
});
