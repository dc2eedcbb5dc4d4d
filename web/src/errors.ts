/** Why a file cannot be opened, in the words of the Rust library: what is wrong, then what to do. */
export class LoadError extends Error {
  override name = "LoadError";
  /** First section that is missing where the file only ends too early: fetch more of it. */
  readonly missing: string | undefined;

  constructor(message: string, missing?: string) {
    super(message);
    this.missing = missing;
  }
}

export function truncated(section: string): LoadError {
  return new LoadError(`the file ends before section '${section}' is whole; fetch the rest of it`, section);
}

export function corrupt(section: string, offset: number, what: string): LoadError {
  return new LoadError(`section '${section}' at byte ${offset}: ${what}; fetch or write the file again`);
}

/** Most bytes and texels that a file may ask for. */
export interface Limits {
  bytes: number;
  texels: number;
  sections: number;
}

export const LIMITS: Limits = { bytes: 2 ** 31, texels: 2 ** 32, sections: 4096 };

/** Counts what is allocated for a file, before it is allocated. */
export class Budget {
  private held = 0;
  constructor(readonly limits: Limits) {}

  take(bytes: number): void {
    this.held += bytes;
    this.check("bytes", this.held, this.limits.bytes);
  }

  texels(count: number): void {
    this.check("texels", count, this.limits.texels);
  }

  check(what: string, needed: number, allowed: number): void {
    if (needed > allowed) {
      throw new LoadError(`${what}: ${needed} needed, ${allowed} allowed; raise the limit if the source can be trusted`);
    }
  }
}
