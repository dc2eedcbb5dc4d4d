import { corrupt, type LoadError, truncated } from "./errors.js";

/** Reads the little-endian numbers of a section from front to back. */
export class Reader {
  at = 0;
  private readonly view: DataView;

  constructor(readonly section: string, readonly data: Uint8Array) {
    this.view = new DataView(data.buffer, data.byteOffset, data.byteLength);
  }

  /** The error of bytes that no writer writes, at the current place. */
  corrupt(what: string): LoadError {
    return corrupt(this.section, this.at, what);
  }

  /** Throws the error where `holds` is not true. */
  check(holds: boolean, what: string): void {
    if (!holds) {
      throw this.corrupt(what);
    }
  }

  /** Place of the next `count` bytes, which are passed over. */
  private pass(count: number): number {
    if (count > this.data.length - this.at) {
      throw truncated(this.section);
    }
    this.at += count;
    return this.at - count;
  }

  /** The next bytes, not copied. */
  bytes(count: number): Uint8Array {
    const start = this.pass(count);
    return this.data.subarray(start, start + count);
  }

  u8(): number {
    return this.view.getUint8(this.pass(1));
  }

  u16(): number {
    return this.view.getUint16(this.pass(2), true);
  }

  i16(): number {
    return this.view.getInt16(this.pass(2), true);
  }

  u32(): number {
    return this.view.getUint32(this.pass(4), true);
  }

  u64(): bigint {
    return this.view.getBigUint64(this.pass(8), true);
  }

  /** The next 32-bit float, which must be finite. */
  f32(): number {
    const value = this.view.getFloat32(this.pass(4), true);
    this.check(Number.isFinite(value), "a number that is not finite");
    return value;
  }

  /** Four letters. */
  id(): string {
    return String.fromCharCode(...this.bytes(4));
  }

  end(): void {
    this.check(this.at === this.data.length, "bytes after the end");
  }
}
