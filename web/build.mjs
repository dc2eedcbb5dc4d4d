// Bundles the package: dist/ holds minified ES modules, their types and conformance.html, crates/cli/src/view/page.html the page of `texfold view`.
// With --test also what tests need, and the page is compared, not written.
import { execFileSync } from "node:child_process";
import { mkdirSync, readdirSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { build } from "esbuild";
import { goldenItems } from "./golden.mjs";

const { version } = JSON.parse(readFileSync("package.json", "utf8"));
const isTest = process.argv.includes("--test");
const options = { bundle: true, minify: true, format: "esm", target: "es2022", legalComments: "none" };

// Chunks of former builds.
mkdirSync("dist", { recursive: true });
readdirSync("dist").filter((name) => name.startsWith("texfold-")).forEach((name) => rmSync(`dist/${name}`));

await build({
  ...options,
  entryPoints: ["src/index.ts", "src/tiles.ts", "src/gltf.ts", ...(isTest ? ["src/test.ts"] : [])],
  outdir: "dist",
  splitting: true,
  chunkNames: "texfold-[name]-[hash]",
});

/** A page with its code in it. */
async function paged(folder) {
  const made = await build({ ...options, entryPoints: [`${folder}/main.ts`], write: false });
  const code = made.outputFiles[0].text.replaceAll("</script", "<\\/script").replace("@VERSION@", version);
  return readFileSync(`${folder}/page.html`, "utf8").replace("@CODE@", () => code.trim());
}

writeFileSync("dist/conformance.html", (await paged("src/conformance")).replace("@DATA@", () => JSON.stringify(goldenItems())));
const page = await paged("src/view");
writeFileSync("dist/try.html", page.replace("@DATA@", JSON.stringify({ items: [], isServed: false })));
const place = "../crates/cli/src/view/page.html";
if (!isTest) {
  writeFileSync(place, page);
  execFileSync("npx", ["tsc", "--emitDeclarationOnly"], { stdio: "inherit" });
} else if (readFileSync(place, "utf8") !== page) {
  throw new Error("crates/cli/src/view/page.html is not what the code gives; run npm run build in web/");
}
