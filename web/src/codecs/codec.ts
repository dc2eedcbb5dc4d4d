import type { Budget } from "../errors.js";
import type { Form } from "../form.js";
import { type Layout, readLayout, type Sections } from "../container.js";

/** What a file holds, apart from its notes. */
export interface Loaded {
  /** Sizes of the images; none of light fields. */
  layout: Layout | null;
  form: Form;
  /** Layers that are loaded, of those that the whole file has. */
  layers: [number, number];
}

/** How the files of a codec are read. */
export type Codec = (file: Sections, budget: Budget) => Loaded;

/** A codec of images: reads their layout first. */
export function images(read: (file: Sections, layout: Layout, budget: Budget) => Omit<Loaded, "layout">): Codec {
  return (file, budget) => {
    const layout = readLayout(file, budget);
    return { layout, ...read(file, layout, budget) };
  };
}
