// Loads pages in headless Chromium at two widths, light and dark, writes screenshots and checks what can be checked: errors of scripts, images that
// are empty, text that is cut off or of low contrast, content wider than the window.
//
//     node pages.mjs SCREENSHOTS PAGE.html…
import { mkdirSync } from "node:fs";
import { basename, dirname, join, resolve } from "node:path";
import { launch, open, serve } from "./test/browser.mjs";

const WIDTHS = [1400, 400];
const SCHEMES = ["light", "dark"];
/** Least contrast of text, and of large text (WCAG 2.2, 1.4.3). */
const LEAST = 4.5;
const LEAST_LARGE = 3;
/** Smallest text, in pixels. */
const SMALLEST = 9;

/** In the page: what is wrong with it. */
function faultsOfPage([least, leastLarge, smallest]) {
  const faults = [];
  const name = (element) => `<${element.tagName.toLowerCase()}> "${(element.textContent ?? "").trim().slice(0, 40)}"`;
  const wide = document.documentElement.scrollWidth - innerWidth;
  if (wide > 0) {
    faults.push(`the page is ${wide} pixels wider than its window`);
  }
  for (const image of document.images) {
    if (image.naturalWidth === 0 || image.getBoundingClientRect().width === 0) {
      faults.push(`an image is empty: ${image.alt}`);
    }
  }
  const channels = (text) => {
    const canvas = new OffscreenCanvas(1, 1).getContext("2d");
    canvas.fillStyle = text;
    canvas.fillRect(0, 0, 1, 1);
    return [...canvas.getImageData(0, 0, 1, 1).data];
  };
  const luminance = (colour) => {
    const [r, g, b] = colour.map((value) => (value / 255 <= 0.04045 ? value / 255 / 12.92 : ((value / 255 + 0.055) / 1.055) ** 2.4));
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const ground = (element) => {
    const under = [];
    for (let at = element; at; at = at.parentElement) {
      const [r, g, b, a] = channels(getComputedStyle(at).backgroundColor);
      under.push([r, g, b, a / 255]);
      if (a === 255) {
        break;
      }
    }
    const isDark = matchMedia("(prefers-color-scheme: dark)").matches && getComputedStyle(document.documentElement).colorScheme.includes("dark");
    return under.reverse().reduce((below, [r, g, b, a]) => [r, g, b].map((value, i) => value * a + below[i] * (1 - a)), isDark ? [18, 18, 18] : [255, 255, 255]);
  };
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let node = walker.nextNode(); node; node = walker.nextNode()) {
    const element = node.parentElement, style = getComputedStyle(element);
    const isText = node.textContent.trim() && !["SCRIPT", "STYLE", "OPTION", "TITLE"].includes(element.tagName);
    if (!isText || style.visibility === "hidden" || element.getClientRects().length === 0) {
      continue;
    }
    const isSvg = element instanceof SVGElement;
    const shown = parseFloat(style.fontSize) * (isSvg ? element.getScreenCTM().a : 1);
    if (shown < smallest) {
      faults.push(`text of ${shown.toFixed(1)} pixels: ${name(element)}`);
    }
    const [r, g, b, a] = channels(isSvg ? style.fill : style.color), below = ground(element);
    const ink = [r, g, b].map((value, i) => (value * a) / 255 + below[i] * (1 - a / 255));
    const [high, low] = [luminance(ink), luminance(below)].sort((one, other) => other - one);
    const contrast = (high + 0.05) / (low + 0.05), size = parseFloat(style.fontSize);
    if (contrast < (size >= 24 || (size >= 18.66 && +style.fontWeight >= 700) ? leastLarge : least)) {
      faults.push(`contrast ${contrast.toFixed(2)}: ${name(element)}`);
    }
    if (!isSvg && style.overflow !== "visible" && element.scrollWidth > element.clientWidth + 1 && style.overflowX === "hidden") {
      faults.push(`cut off: ${name(element)}`);
    }
  }
  return [...new Set(faults)];
}

const [out, ...files] = process.argv.slice(2);
if (files.length === 0) {
  console.error("error: no page is given; node pages.mjs SCREENSHOTS PAGE.html…");
  process.exit(2);
}
const browser = await launch();
if (!browser) {
  console.error("error: there is no Chromium; install it, on Debian: apt-get install chromium");
  process.exit(1);
}
mkdirSync(out, { recursive: true });
let count = 0;
for (const file of files) {
  const server = await serve(dirname(resolve(file)));
  for (const width of WIDTHS) {
    for (const colorScheme of SCHEMES) {
      const { page, faults } = await open(browser, server.url + encodeURIComponent(basename(file)), { viewport: { width, height: 900 }, colorScheme });
      await page.waitForTimeout(1000);
      faults.push(...(await page.evaluate(faultsOfPage, [LEAST, LEAST_LARGE, SMALLEST])));
      const name = `${basename(dirname(resolve(file)))}-${basename(file, ".html")}-${width}-${colorScheme}.png`;
      await page.screenshot({ path: join(out, name), fullPage: true });
      faults.forEach((fault) => console.error(`error: ${file} at ${width} pixels, ${colorScheme}: ${fault}`));
      count += faults.length;
      await page.close();
    }
  }
  server.close();
}
await browser.close();
console.log(`${files.length} pages, ${count} faults; screenshots in ${out}`);
process.exit(count > 0 ? 1 : 0);
