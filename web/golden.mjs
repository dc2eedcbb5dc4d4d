// Golden files with their pictures, as conformance.html takes them.
import { existsSync, readdirSync, readFileSync } from "node:fs";

const folder = new URL("../fixtures/golden/", import.meta.url);
/** Files whose texels are decoded in integers or read as they are stored. */
const EXACT = ["bc_bc7", "dct", "dct_alpha", "vq_raw_sequence"];
/** Largest difference of others, in 8-bit steps: hardware may round BC1 to BC5 differently (Direct3D 11.3, 19.5), and filters in floats. */
const ROUNDING = 2;

export function goldenItems() {
  const golden = JSON.parse(readFileSync(new URL("test/golden.json", import.meta.url), "utf8"));
  const base64 = (name) => readFileSync(new URL(name, folder)).toString("base64");
  const files = readdirSync(folder).filter((name) => name.endsWith(".txf"));
  return files.map((file) => {
    const name = file.replace(".txf", "");
    const levels = [1, 2, 3, 4, 5].map((level) => [`-level${level}`, { level }]);
    const images = [0, 1, 2, 3, 4].map((image) => [`-00${image}`, { image }]);
    const regions = [["", {}], ...levels, ...images].filter(([suffix]) => existsSync(new URL(`${name}${suffix}.png`, folder)));
    const pictures = regions.map(([suffix, region]) => ({ suffix, region, data: base64(`${name}${suffix}.png`) }));
    return { name, data: base64(file), allowed: EXACT.includes(name) ? 0 : ROUNDING, camera: golden[file].camera, pictures };
  });
}
