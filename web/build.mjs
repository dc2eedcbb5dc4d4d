// Bundles the package: dist/index.js, one minified ES module, and its types.
import { execFileSync } from "node:child_process";
import { build } from "esbuild";

await build({
  entryPoints: ["src/index.ts", ...(process.argv.includes("--test") ? ["src/test.ts"] : [])],
  outdir: "dist",
  bundle: true,
  splitting: true,
  chunkNames: "texfold-[name]-[hash]",
  minify: true,
  format: "esm",
  target: "es2022",
  legalComments: "none",
});
if (!process.argv.includes("--test")) {
  execFileSync("npx", ["tsc", "--emitDeclarationOnly"], { stdio: "inherit" });
}
