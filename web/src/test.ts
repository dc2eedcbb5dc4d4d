// What the tests of the package look into.
export { checksum } from "./blake3.js";
export * from "./index.js";
export { decompress } from "./zstd.js";
