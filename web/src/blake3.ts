// BLAKE3, as far as checksums of files need it: the first 8 bytes of the hash of some bytes.
// Source: O'Connor, Aumasson, Neves, Wilcox-O'Hearn, "BLAKE3: one function, fast everywhere", 2020, section 2.

const IV = new Int32Array([
  0x6a09e667, 0xbb67ae85, 0x3c6ef372, 0xa54ff53a, 0x510e527f, 0x9b05688c, 0x1f83d9ab, 0x5be0cd19,
]);
const PERMUTATION = [2, 6, 3, 10, 7, 0, 4, 13, 1, 11, 12, 5, 9, 14, 15, 8];
const CHUNK = 1024;
const BLOCK = 64;
const ROUNDS = 7;
const CHUNK_START = 1;
const CHUNK_END = 2;
const PARENT = 4;
const ROOT = 8;

/** Places of the message's words in each round, one round behind the other. */
const SCHEDULE = (() => {
  let order = PERMUTATION.map((_, word) => word);
  const all: number[] = [];
  for (let round = 0; round < ROUNDS; round++) {
    all.push(...order);
    order = PERMUTATION.map((from) => order[from]!);
  }
  return new Uint8Array(all);
})();

/** Compresses a block of 16 words of `message` into the 8 words of `chain`. The state is in variables: engines keep them in registers. */
function compress(chain: Int32Array, message: Int32Array, counter: number, length: number, flags: number): void {
  let v0 = chain[0]!, v1 = chain[1]!, v2 = chain[2]!, v3 = chain[3]!, v4 = chain[4]!, v5 = chain[5]!, v6 = chain[6]!, v7 = chain[7]!;
  let v8 = IV[0]!, v9 = IV[1]!, v10 = IV[2]!, v11 = IV[3]!, v12 = counter | 0, v13 = (counter / 0x100000000) | 0, v14 = length, v15 = flags;
  for (let round = 0; round < 16 * ROUNDS; round += 16) {
    v0 = (v0 + v4 + message[SCHEDULE[round + 0]!]!) | 0;
    v12 ^= v0; v12 = (v12 >>> 16) | (v12 << 16);
    v8 = (v8 + v12) | 0;
    v4 ^= v8; v4 = (v4 >>> 12) | (v4 << 20);
    v0 = (v0 + v4 + message[SCHEDULE[round + 1]!]!) | 0;
    v12 ^= v0; v12 = (v12 >>> 8) | (v12 << 24);
    v8 = (v8 + v12) | 0;
    v4 ^= v8; v4 = (v4 >>> 7) | (v4 << 25);
    v1 = (v1 + v5 + message[SCHEDULE[round + 2]!]!) | 0;
    v13 ^= v1; v13 = (v13 >>> 16) | (v13 << 16);
    v9 = (v9 + v13) | 0;
    v5 ^= v9; v5 = (v5 >>> 12) | (v5 << 20);
    v1 = (v1 + v5 + message[SCHEDULE[round + 3]!]!) | 0;
    v13 ^= v1; v13 = (v13 >>> 8) | (v13 << 24);
    v9 = (v9 + v13) | 0;
    v5 ^= v9; v5 = (v5 >>> 7) | (v5 << 25);
    v2 = (v2 + v6 + message[SCHEDULE[round + 4]!]!) | 0;
    v14 ^= v2; v14 = (v14 >>> 16) | (v14 << 16);
    v10 = (v10 + v14) | 0;
    v6 ^= v10; v6 = (v6 >>> 12) | (v6 << 20);
    v2 = (v2 + v6 + message[SCHEDULE[round + 5]!]!) | 0;
    v14 ^= v2; v14 = (v14 >>> 8) | (v14 << 24);
    v10 = (v10 + v14) | 0;
    v6 ^= v10; v6 = (v6 >>> 7) | (v6 << 25);
    v3 = (v3 + v7 + message[SCHEDULE[round + 6]!]!) | 0;
    v15 ^= v3; v15 = (v15 >>> 16) | (v15 << 16);
    v11 = (v11 + v15) | 0;
    v7 ^= v11; v7 = (v7 >>> 12) | (v7 << 20);
    v3 = (v3 + v7 + message[SCHEDULE[round + 7]!]!) | 0;
    v15 ^= v3; v15 = (v15 >>> 8) | (v15 << 24);
    v11 = (v11 + v15) | 0;
    v7 ^= v11; v7 = (v7 >>> 7) | (v7 << 25);
    v0 = (v0 + v5 + message[SCHEDULE[round + 8]!]!) | 0;
    v15 ^= v0; v15 = (v15 >>> 16) | (v15 << 16);
    v10 = (v10 + v15) | 0;
    v5 ^= v10; v5 = (v5 >>> 12) | (v5 << 20);
    v0 = (v0 + v5 + message[SCHEDULE[round + 9]!]!) | 0;
    v15 ^= v0; v15 = (v15 >>> 8) | (v15 << 24);
    v10 = (v10 + v15) | 0;
    v5 ^= v10; v5 = (v5 >>> 7) | (v5 << 25);
    v1 = (v1 + v6 + message[SCHEDULE[round + 10]!]!) | 0;
    v12 ^= v1; v12 = (v12 >>> 16) | (v12 << 16);
    v11 = (v11 + v12) | 0;
    v6 ^= v11; v6 = (v6 >>> 12) | (v6 << 20);
    v1 = (v1 + v6 + message[SCHEDULE[round + 11]!]!) | 0;
    v12 ^= v1; v12 = (v12 >>> 8) | (v12 << 24);
    v11 = (v11 + v12) | 0;
    v6 ^= v11; v6 = (v6 >>> 7) | (v6 << 25);
    v2 = (v2 + v7 + message[SCHEDULE[round + 12]!]!) | 0;
    v13 ^= v2; v13 = (v13 >>> 16) | (v13 << 16);
    v8 = (v8 + v13) | 0;
    v7 ^= v8; v7 = (v7 >>> 12) | (v7 << 20);
    v2 = (v2 + v7 + message[SCHEDULE[round + 13]!]!) | 0;
    v13 ^= v2; v13 = (v13 >>> 8) | (v13 << 24);
    v8 = (v8 + v13) | 0;
    v7 ^= v8; v7 = (v7 >>> 7) | (v7 << 25);
    v3 = (v3 + v4 + message[SCHEDULE[round + 14]!]!) | 0;
    v14 ^= v3; v14 = (v14 >>> 16) | (v14 << 16);
    v9 = (v9 + v14) | 0;
    v4 ^= v9; v4 = (v4 >>> 12) | (v4 << 20);
    v3 = (v3 + v4 + message[SCHEDULE[round + 15]!]!) | 0;
    v14 ^= v3; v14 = (v14 >>> 8) | (v14 << 24);
    v9 = (v9 + v14) | 0;
    v4 ^= v9; v4 = (v4 >>> 7) | (v4 << 25);
  }
  chain[0] = v0 ^ v8;
  chain[1] = v1 ^ v9;
  chain[2] = v2 ^ v10;
  chain[3] = v3 ^ v11;
  chain[4] = v4 ^ v12;
  chain[5] = v5 ^ v13;
  chain[6] = v6 ^ v14;
  chain[7] = v7 ^ v15;
}

/** The chaining value of a chunk; with `root` the hash of bytes that are one chunk. */
function chunkValue(bytes: Uint8Array, start: number, end: number, number: number, root: number, message: Int32Array): Int32Array {
  const chain = IV.slice();
  const words = new Uint8Array(message.buffer);
  let at = start;
  do {
    const length = Math.min(BLOCK, end - at);
    words.set(bytes.subarray(at, at + length));
    if (length < BLOCK) {
      words.fill(0, length);
    }
    const last = at + length === end;
    const flags = (at === start ? CHUNK_START : 0) | (last ? CHUNK_END | root : 0);
    compress(chain, message, number, length, flags);
    at += length;
  } while (at < end);
  return chain;
}

/** The first 8 bytes of the BLAKE3 of `bytes`, as a number of 64 bits (the first byte lowest). Little-endian machines only, as all that run browsers. */
export function checksum(bytes: Uint8Array): bigint {
  const chunks = Math.max(1, Math.ceil(bytes.length / CHUNK));
  const message = new Int32Array(16);
  // Subtrees that are whole, the largest first; a new chunk joins those of its size.
  const open: Int32Array[] = [];
  for (let number = 0; number < chunks; number++) {
    const end = Math.min(bytes.length, (number + 1) * CHUNK);
    let value = chunkValue(bytes, number * CHUNK, end, number, chunks === 1 ? ROOT : 0, message);
    // As many joins as the number of chunks so far has factors of 2, but the root's are left for the end.
    for (let total = number + 1; total % 2 === 0 && number + 1 < chunks; total /= 2) {
      value = parent(open.pop()!, value, 0, message);
    }
    open.push(value);
  }
  let value = open.pop()!;
  while (open.length > 0) {
    value = parent(open.pop()!, value, open.length === 0 ? ROOT : 0, message);
  }
  return (BigInt(value[1]! >>> 0) << 32n) | BigInt(value[0]! >>> 0);
}

function parent(left: Int32Array, right: Int32Array, root: number, message: Int32Array): Int32Array {
  const chain = IV.slice();
  message.set(left);
  message.set(right, 8);
  compress(chain, message, 0, BLOCK, PARENT | root);
  return chain;
}
