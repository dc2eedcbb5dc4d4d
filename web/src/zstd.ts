// A decoder of zstd frames (RFC 8878) into a buffer of known length. Every loop is bounded by the lengths of frame and result, so that no
// bytes make it hang; what no encoder writes throws a `RangeError`. No dictionaries; the frame's own checksum is skipped, as sections have one.

const MAGIC = 0xfd2fb528;
const MAX_BLOCK = 1 << 17;
const LEAST_WINDOW = 1024;

function damaged(what: string): RangeError {
  return new RangeError(what);
}

/** Bits of a stream that is read from its end to its start; zeros before that. */
class BackwardBits {
  /** First bit that was read, counted from the start; below 0 where more were read than there are. */
  at: number;
  constructor(readonly bytes: Uint8Array, readonly start: number, end: number) {
    const last = end > start ? bytes[end - 1]! : 0;
    if (last === 0) {
      throw damaged("a stream without an end mark");
    }
    this.at = 8 * (end - start - 1) + 31 - Math.clz32(last);
  }
  /** The next `count` bits, at most 25. */
  read(count: number): number {
    this.at -= count;
    return this.peek(this.at, count);
  }
  /** `count` bits, at most 25, from bit `at` on. */
  peek(at: number, count: number): number {
    if (at < 0) {
      return at + count <= 0 ? 0 : this.peek(0, at + count) << -at;
    }
    const first = this.start + (at >> 3), { bytes } = this;
    // What lies behind the stream's bytes is masked.
    const word = bytes[first]! | (bytes[first + 1]! << 8) | (bytes[first + 2]! << 16) | (bytes[first + 3]! << 24);
    return (word >>> (at & 7)) & ((1 << count) - 1);
  }
}

/** A table of finite state entropy: for each state its symbol, the bits to read and what they are added to. */
interface States {
  log: number;
  symbols: Uint8Array;
  bits: Uint8Array;
  bases: Uint16Array;
}

function statesOf(log: number, counts: ArrayLike<number>): States {
  const size = 1 << log;
  const table: States = { log, symbols: new Uint8Array(size), bits: new Uint8Array(size), bases: new Uint16Array(size) };
  const next = new Uint16Array(counts.length);
  let high = size;
  for (let symbol = 0; symbol < counts.length; symbol++) {
    next[symbol] = Math.abs(counts[symbol]!);
    if (counts[symbol]! === -1) {
      table.symbols[--high] = symbol;
    }
  }
  const step = (size >> 1) + (size >> 3) + 3;
  let place = 0;
  for (let symbol = 0; symbol < counts.length; symbol++) {
    for (let i = 0; i < counts[symbol]!; i++) {
      table.symbols[place] = symbol;
      do {
        place = (place + step) & (size - 1);
      } while (place >= high);
    }
  }
  for (let state = 0; state < size; state++) {
    const rank = next[table.symbols[state]!]!++;
    const bits = log - (31 - Math.clz32(rank));
    table.bits[state] = bits;
    table.bases[state] = (rank << bits) - size;
  }
  return table;
}

function sameSymbol(symbol: number): States {
  return { log: 0, symbols: Uint8Array.of(symbol), bits: new Uint8Array(1), bases: new Uint16Array(1) };
}

/** A table from the counts that are stored at `at`, and the first byte behind them (RFC 8878, 4.1.1). */
function readStates(bytes: Uint8Array, at: number, end: number, maxLog: number, maxSymbol: number): [States, number] {
  let bit = 8 * at;
  const take = (count: number): number => {
    let value = 0;
    for (let i = 0; i < count; i++, bit++) {
      value |= ((bit >> 3 < end ? bytes[bit >> 3]! >> (bit & 7) : 0) & 1) << i;
    }
    return value;
  };
  const log = take(4) + 5;
  if (log > maxLog) {
    throw damaged("a table that is too fine");
  }
  const counts: number[] = [];
  let left = (1 << log) + 1;
  while (left > 1 && counts.length <= maxSymbol) {
    // A value below `few` takes a bit less.
    const width = 32 - Math.clz32(left);
    const few = (1 << width) - 1 - left;
    let value = take(width - 1);
    if (value >= few) {
      value |= take(1) << (width - 1);
      if (value >= 1 << (width - 1)) {
        value -= few;
      }
    }
    const count = value - 1;
    counts.push(count);
    left -= Math.abs(count);
    for (let more = count === 0 ? 3 : 0; more === 3; ) {
      more = take(2);
      for (let i = 0; i < more && counts.length <= maxSymbol + 1; i++) {
        counts.push(0);
      }
      if (counts.length > maxSymbol + 1) {
        break;
      }
    }
  }
  const behind = (bit + 7) >> 3;
  if (left !== 1 || counts.length > maxSymbol + 1 || behind > end) {
    throw damaged("counts that no encoder writes");
  }
  return [statesOf(log, counts), behind];
}

/** A table of Huffman codes: symbol and length by the next `log` bits. */
interface Codes {
  log: number;
  symbols: Uint8Array;
  lengths: Uint8Array;
}

function readCodes(bytes: Uint8Array, at: number, end: number): [Codes, number] {
  if (at >= end) {
    throw damaged("no table of codes");
  }
  const head = bytes[at++]!;
  const weights: number[] = [];
  let behind: number;
  if (head >= 128) {
    const count = head - 127;
    behind = at + ((count + 1) >> 1);
    for (let i = 0; i < count; i++) {
      const byte = bytes[at + (i >> 1)]!;
      weights.push(i % 2 === 0 ? byte >> 4 : byte & 15);
    }
  } else {
    behind = at + head;
    if (behind <= end) {
      readWeights(bytes, at, behind, weights);
    }
  }
  if (behind > end) {
    throw damaged("a table of codes beyond its block");
  }
  return [codesOf(weights), behind];
}

function readWeights(bytes: Uint8Array, at: number, end: number, weights: number[]): void {
  const [table, start] = readStates(bytes, at, end, 6, 255);
  const bits = new BackwardBits(bytes, start, end);
  const states = [bits.read(table.log), bits.read(table.log)];
  for (let turn = 0; weights.length < 255; turn ^= 1) {
    const state = states[turn]!;
    weights.push(table.symbols[state]!);
    const count = table.bits[state]!;
    if (bits.at < count) {
      // The other state's symbol is the last.
      weights.push(table.symbols[states[turn ^ 1]!]!);
      return;
    }
    states[turn] = table.bases[state]! + bits.read(count);
  }
  throw damaged("too many weights");
}

function codesOf(weights: number[]): Codes {
  let sum = 0;
  for (const weight of weights) {
    if (weight > 12) {
      throw damaged("a code that is too long");
    }
    sum += weight > 0 ? 1 << (weight - 1) : 0;
  }
  const log = 32 - Math.clz32(sum);
  const rest = (1 << log) - sum;
  if (sum === 0 || log > 11 || (rest & (rest - 1)) !== 0 || weights.length > 255) {
    throw damaged("codes that no encoder writes");
  }
  weights.push(32 - Math.clz32(rest));
  const codes: Codes = { log, symbols: new Uint8Array(1 << log), lengths: new Uint8Array(1 << log) };
  let place = 0;
  for (let weight = 1; weight <= log; weight++) {
    weights.forEach((other, symbol) => {
      if (other === weight) {
        const next = place + (1 << (weight - 1));
        codes.symbols.fill(symbol, place, next);
        codes.lengths.fill(log + 1 - weight, place, next);
        place = next;
      }
    });
  }
  return codes;
}

function readStream(codes: Codes, bytes: Uint8Array, start: number, end: number, out: Uint8Array): void {
  const bits = new BackwardBits(bytes, start, end);
  const { log, symbols, lengths } = codes;
  let at = bits.at;
  for (let i = 0; i < out.length; i++) {
    const slot = bits.peek(at - log, log);
    out[i] = symbols[slot]!;
    at -= lengths[slot]!;
  }
  if (at !== 0) {
    throw damaged("a stream of another length");
  }
}

const LITERAL_LENGTHS = statesOf(6, [
  4, 3, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 1, 1, 1, 2, 2, 2, 2, 2, 2, 2, 2, 2, 3, 2, 1, 1, 1, 1, 1, -1, -1, -1, -1,
]);
const MATCH_LENGTHS = statesOf(6, [
  1, 4, 3, 2, 2, 2, 2, 2, 2, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1,
  1, 1, 1, 1, 1, 1, 1, -1, -1, -1, -1, -1, -1, -1,
]);
const OFFSETS = statesOf(5, [1, 1, 1, 1, 1, 1, 2, 2, 2, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, -1, -1, -1, -1, -1]);

/** What lengths of a code begin with, from the bits that each code adds. */
function starts(first: number, bits: Uint8Array): Uint32Array {
  let next = first;
  return Uint32Array.from(bits, (count) => (next += 2 ** count) - 2 ** count);
}
const bitsFrom = (plain: number, rest: number[]): Uint8Array => Uint8Array.of(...new Array<number>(plain).fill(0), ...rest);
const LITERAL_BITS = bitsFrom(16, [1, 1, 1, 1, 2, 2, 3, 3, 4, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16]);
const LITERAL_STARTS = starts(0, LITERAL_BITS);
const MATCH_BITS = bitsFrom(32, [1, 1, 1, 1, 2, 2, 3, 3, 4, 4, 5, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16]);
const MATCH_STARTS = starts(3, MATCH_BITS);

/** A frame that is being decoded. */
class Frame {
  written = 0;
  private codes: Codes | null = null;
  private tables: (States | null)[] = [null, null, null];
  private recent = [1, 4, 8];
  private literals: Uint8Array = new Uint8Array(0);

  constructor(private readonly bytes: Uint8Array, private readonly out: Uint8Array) {}

  result(): Uint8Array {
    return this.out;
  }

  plain(at: number, size: number): void {
    this.room(size);
    this.out.set(this.bytes.subarray(at, at + size), this.written);
    this.written += size;
  }

  repeated(byte: number, size: number): void {
    this.room(size);
    this.out.fill(byte, this.written, this.written + size);
    this.written += size;
  }

  private room(size: number): void {
    if (size > this.out.length - this.written) {
      throw damaged("more bytes than stated");
    }
  }

  compressed(at: number, end: number): void {
    at = this.readLiterals(at, end);
    const { bytes } = this;
    if (at >= end) {
      throw damaged("a block without sequences");
    }
    let count = bytes[at++]!;
    if (count >= 128) {
      const long = count === 255;
      count = long ? bytes[at]! + (bytes[at + 1]! << 8) + 0x7f00 : ((count - 128) << 8) + bytes[at]!;
      at += long ? 2 : 1;
    }
    if (count === 0) {
      if (at !== end) {
        throw damaged("bytes behind a block");
      }
      this.append(this.literals, 0, this.literals.length);
      return;
    }
    const modes = at < end ? bytes[at++]! : 3;
    if ((modes & 3) !== 0) {
      throw damaged("reserved bits");
    }
    at = this.table(0, modes >> 6, LITERAL_LENGTHS, 9, 35, at, end);
    at = this.table(1, (modes >> 4) & 3, OFFSETS, 8, 31, at, end);
    at = this.table(2, (modes >> 2) & 3, MATCH_LENGTHS, 9, 52, at, end);
    this.sequences(count, new BackwardBits(bytes, at, end));
  }

  private table(kind: number, mode: number, usual: States, maxLog: number, maxSymbol: number, at: number, end: number): number {
    if (mode === 0) {
      this.tables[kind] = usual;
    } else if (mode === 1) {
      if (at >= end || this.bytes[at]! > maxSymbol) {
        throw damaged("a symbol that does not exist");
      }
      this.tables[kind] = sameSymbol(this.bytes[at++]!);
    } else if (mode === 2) {
      [this.tables[kind], at] = readStates(this.bytes, at, end, maxLog, maxSymbol);
    } else if (!this.tables[kind]) {
      throw damaged("a table before the first");
    }
    return at;
  }

  private readLiterals(at: number, end: number): number {
    const { bytes } = this;
    if (end - at < 1) {
      throw damaged("an empty block");
    }
    const head = bytes[at]!, kind = head & 3, form = (head >> 2) & 3;
    const number = (first: number, count: number): number => {
      let value = 0;
      for (let i = 0; i < count; i++) {
        value += (bytes[first + i] ?? 0) * 2 ** (8 * i);
      }
      return value;
    };
    if (kind < 2) {
      const length = form % 2 === 0 ? 1 : form === 1 ? 2 : 3;
      const size = form % 2 === 0 ? head >> 3 : number(at, length) >> 4;
      at += length;
      const stored = kind === 0 ? size : 1;
      if (size > MAX_BLOCK || stored > end - at) {
        throw damaged("literals beyond their block");
      }
      this.literals = kind === 0 ? bytes.subarray(at, at + size) : new Uint8Array(size).fill(bytes[at]!);
      return at + stored;
    }
    const length = form < 2 ? 3 : form + 2, width = form < 2 ? 10 : form === 2 ? 14 : 18;
    const fields = Math.floor(number(at, length) / 16), mask = 2 ** width;
    const size = fields % mask, stored = Math.floor(fields / mask) % mask;
    at += length;
    if (size > MAX_BLOCK || stored > end - at) {
      throw damaged("literals beyond their block");
    }
    const behind = at + stored;
    if (kind === 2) {
      [this.codes, at] = readCodes(bytes, at, behind);
    }
    if (!this.codes) {
      throw damaged("codes before the first");
    }
    this.literals = new Uint8Array(size);
    if (form === 0) {
      readStream(this.codes, bytes, at, behind, this.literals);
    } else {
      this.fourStreams(this.codes, at, behind);
    }
    return behind;
  }

  private fourStreams(codes: Codes, at: number, end: number): void {
    const { bytes, literals } = this;
    const part = (literals.length + 3) >> 2;
    let start = at + 6;
    if (start > end || 3 * part > literals.length) {
      throw damaged("streams beyond their block");
    }
    for (let i = 0; i < 4; i++) {
      const stop = i < 3 ? start + bytes[at + 2 * i]! + (bytes[at + 2 * i + 1]! << 8) : end;
      if (stop > end) {
        throw damaged("streams beyond their block");
      }
      readStream(codes, bytes, start, stop, literals.subarray(i * part, i < 3 ? (i + 1) * part : undefined));
      start = stop;
    }
  }

  private sequences(count: number, bits: BackwardBits): void {
    const [lengths, offsets, matches] = this.tables as [States, States, States];
    let a = bits.read(lengths.log), b = bits.read(offsets.log), c = bits.read(matches.log);
    let literal = 0;
    for (let left = count; left > 0; left--) {
      const code = offsets.symbols[b]!;
      // Up to 31 bits, in two parts.
      const high = bits.read(Math.max(code - 16, 0)), low = bits.read(Math.min(code, 16));
      const value = 2 ** code + high * 65536 + low;
      const match = matches.symbols[c]!, length = lengths.symbols[a]!;
      const matched = MATCH_STARTS[match]! + bits.read(MATCH_BITS[match]!);
      const literals = LITERAL_STARTS[length]! + bits.read(LITERAL_BITS[length]!);
      if (left > 1) {
        a = lengths.bases[a]! + bits.read(lengths.bits[a]!);
        c = matches.bases[c]! + bits.read(matches.bits[c]!);
        b = offsets.bases[b]! + bits.read(offsets.bits[b]!);
      }
      if (bits.at < 0 || literals > this.literals.length - literal) {
        throw damaged("a sequence beyond its block");
      }
      this.append(this.literals, literal, literals);
      literal += literals;
      this.copy(this.offset(value, literals), matched);
    }
    if (bits.at !== 0) {
      throw damaged("bits behind the sequences");
    }
    this.append(this.literals, literal, this.literals.length - literal);
  }

  /** The distance that an offset value stands for, which becomes the most recent one. */
  private offset(value: number, literals: number): number {
    const { recent } = this;
    if (value > 3) {
      this.recent = [value - 3, recent[0]!, recent[1]!];
      return value - 3;
    }
    const which = literals === 0 ? value : value - 1;
    const distance = which === 3 ? recent[0]! - 1 : recent[which]!;
    if (which > 0) {
      this.recent = [distance, recent[0]!, recent[which === 1 ? 2 : 1]!];
    }
    return distance;
  }

  private append(from: Uint8Array, first: number, count: number): void {
    this.room(count);
    const { out } = this;
    if (count < 32) {
      for (let i = 0; i < count; i++) {
        out[this.written + i] = from[first + i]!;
      }
    } else {
      out.set(from.subarray(first, first + count), this.written);
    }
    this.written += count;
  }

  private copy(distance: number, count: number): void {
    this.room(count);
    const { out, written } = this;
    if (distance < 1 || distance > written) {
      throw damaged("a match before the start");
    }
    if (distance >= count && count > 32) {
      out.copyWithin(written, written - distance, written - distance + count);
    } else {
      for (let i = 0; i < count; i++) {
        out[written + i] = out[written - distance + i]!;
      }
    }
    this.written += count;
  }
}

/**
 * The `length` bytes that a frame holds.
 * @throws RangeError where the frame is damaged, holds another number of bytes or has a window that is larger.
 */
export function decompress(bytes: Uint8Array, length: number): Uint8Array {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  if (bytes.length < 6 || view.getUint32(0, true) !== MAGIC) {
    throw damaged("no zstd frame");
  }
  const head = bytes[4]!;
  const single = (head & 32) !== 0;
  if ((head & 8) !== 0 || (head & 3) !== 0) {
    throw damaged("a reserved bit or a dictionary");
  }
  const sizeBytes = [single ? 1 : 0, 2, 4, 8][head >> 6]!;
  let at = 5 + (single ? 0 : 1) + sizeBytes;
  if (at > bytes.length) {
    throw damaged("a frame that is cut");
  }
  // The length, where the frame states it; 2 bytes stand for 256 more.
  let stated = 0;
  for (let i = sizeBytes - 1; i >= 0; i--) {
    stated = 256 * stated + bytes[at - sizeBytes + i]!;
  }
  if (sizeBytes > 0 && stated + (sizeBytes === 2 ? 256 : 0) !== length) {
    throw damaged("another number of bytes than stated");
  }
  const window = single ? length : 2 ** (10 + (bytes[5]! >> 3)) * (1 + (bytes[5]! & 7) / 8);
  if (window > Math.max(length, LEAST_WINDOW)) {
    throw damaged("a window larger than the result");
  }
  const frame = new Frame(bytes, new Uint8Array(length));
  for (let last = false; !last; ) {
    if (at + 3 > bytes.length) {
      throw damaged("a frame that is cut");
    }
    const block = bytes[at]! + (bytes[at + 1]! << 8) + (bytes[at + 2]! << 16);
    at += 3;
    last = (block & 1) !== 0;
    const kind = (block >> 1) & 3, size = block >> 3, stored = kind === 1 ? 1 : size;
    if (size > MAX_BLOCK || stored > bytes.length - at || kind === 3) {
      throw damaged("a block that is cut, too long or of no kind");
    }
    if (kind === 0) {
      frame.plain(at, size);
    } else if (kind === 1) {
      frame.repeated(bytes[at]!, size);
    } else {
      frame.compressed(at, at + size);
    }
    at += stored;
  }
  if (frame.written !== length || at + ((head & 4) !== 0 ? 4 : 0) !== bytes.length) {
    throw damaged("another number of bytes than stated");
  }
  return frame.result();
}
