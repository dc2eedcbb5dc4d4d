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

/** Columns, then diagonals, of the state. */
const LANES = new Uint8Array([
  0, 4, 8, 12, 1, 5, 9, 13, 2, 6, 10, 14, 3, 7, 11, 15, 0, 5, 10, 15, 1, 6, 11, 12, 2, 7, 8, 13, 3, 4, 9, 14,
]);

const state = new Int32Array(16);

/** Compresses a block of 16 words of `message` into the 8 words of `chain`. */
function compress(chain: Int32Array, message: Int32Array, counter: number, length: number, flags: number): void {
  const v = state;
  for (let i = 0; i < 8; i++) {
    v[i] = chain[i]!;
  }
  v[8] = IV[0]!;
  v[9] = IV[1]!;
  v[10] = IV[2]!;
  v[11] = IV[3]!;
  v[12] = counter;
  v[13] = counter / 0x100000000;
  v[14] = length;
  v[15] = flags;
  for (let round = 0; round < 16 * ROUNDS; round += 16) {
    for (let lane = 0; lane < 8; lane++) {
      const ia = LANES[4 * lane]!, ib = LANES[4 * lane + 1]!, ic = LANES[4 * lane + 2]!, id = LANES[4 * lane + 3]!;
      let a = v[ia]!, b = v[ib]!, c = v[ic]!, d = v[id]!;
      a = (a + b + message[SCHEDULE[round + 2 * lane]!]!) | 0;
      d ^= a;
      d = (d >>> 16) | (d << 16);
      c = (c + d) | 0;
      b ^= c;
      b = (b >>> 12) | (b << 20);
      a = (a + b + message[SCHEDULE[round + 2 * lane + 1]!]!) | 0;
      d ^= a;
      d = (d >>> 8) | (d << 24);
      c = (c + d) | 0;
      b ^= c;
      b = (b >>> 7) | (b << 25);
      v[ia] = a;
      v[ib] = b;
      v[ic] = c;
      v[id] = d;
    }
  }
  for (let i = 0; i < 8; i++) {
    chain[i] = v[i]! ^ v[i + 8]!;
  }
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
