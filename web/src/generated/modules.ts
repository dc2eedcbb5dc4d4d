// Written by `cargo xtask web`; changes are lost.

/** A file of WGSL, and of the first one of a module the functions that entry points call. */
interface File {
  text: string;
  entry?: string;
}

/** What to bind for a codec, and its WGSL. */
export interface Module {
  /** Bytes of a uniform buffer, or the samples of a texture. */
  bindings: readonly (number | "uint" | "float")[];
  /** Bytes of the parameters at which mip levels and address mode lie; none of light fields. */
  levels?: number;
  addressMode?: number;
  /** Bytes of the parameters of a light field. */
  light?: { triangles: number; terms: number; storedTerms: number };
  /** Constants that a pipeline may set to 0: name, byte of a member, the value of it that needs the constant (else any but 0). */
  switches: readonly (readonly [string, number, number?])[];
  /** Files, with the first binding of each. */
  files: readonly (readonly [() => Promise<File>, number])[];
}

export const modules: Record<string, Module> = {
  "bc": {
    bindings: [32, "float", "float"],
    levels: 16, addressMode: 20,
    switches: [["Tfe", 28]],
    files: [[() => import("./source0.js"), 0]],
  },
  "vq": {
    bindings: [96, "uint", "float", "float"],
    levels: 8, addressMode: 12,
    switches: [],
    files: [[() => import("./source1.js"), 0]],
  },
  "epitome": {
    bindings: [112, "uint", "float", "float", "float"],
    levels: 8, addressMode: 12,
    switches: [],
    files: [[() => import("./source2.js"), 0], [() => import("./source3.js"), 0]],
  },
  "epitome-errors": {
    bindings: [112, "uint", "float", "float", "float", 208, "uint", "float", "float"],
    levels: 8, addressMode: 12,
    switches: [["Tde", 128, 4], ["Tbe", 148]],
    files: [[() => import("./source2.js"), 0], [() => import("./source4.js"), 0], [() => import("./source5.js"), 5]],
  },
  "lightfield": {
    bindings: [48, "uint", "float", "float", "float", "float", "float", "float"],
    light: { triangles: 4, terms: 8, storedTerms: 12 },
    switches: [],
    files: [[() => import("./source6.js"), 0]],
  },
  "progressive": {
    bindings: [48, "uint", "float", "float", 208, "uint", "float", "float"],
    levels: 8, addressMode: 12,
    switches: [["Tb1", 16], ["Tay", 20], ["Tb0", 88], ["Tde", 64, 4], ["Tbe", 84]],
    files: [[() => import("./source7.js"), 0], [() => import("./source5.js"), 4]],
  },
  "zipmap": {
    bindings: [64, "uint", "float", "float", "float"],
    levels: 8, addressMode: 12,
    switches: [["Ted", 28, 4]],
    files: [[() => import("./source8.js"), 0]],
  },
};
