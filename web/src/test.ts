// What the tests of the package look into.
export { checksum } from "./blake3.js";
export { readStage } from "./codecs/dct.js";
export { decodeBlocks } from "./codecs/dct_cpu.js";
export { Budget, LIMITS } from "./errors.js";
export * from "./index.js";
export { Reader } from "./reader.js";
export { TileCache } from "./tiles.js";
export { decompress } from "./zstd.js";
