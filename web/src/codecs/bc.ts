import { atLevel, fullLevels } from "../container.js";
import { type Form, Uniforms } from "../form.js";
import { CLAMP, formatsOf, readContent, readPlanes, withLevels } from "./content.js";
import { type Codec, images } from "./codec.js";

const MAX_REDUCE_LOG2 = 3;

/** Images as planes of blocks. FORMAT.md, "bc". */
export const bc: Codec = images((file, layout) => {
  const head = file.read("BCFM");
  const content = readContent(head);
  const reduceLog2 = head.u8();
  head.check(reduceLog2 <= MAX_REDUCE_LOG2, "a log2 downscale above 3");
  head.end();
  const { formats, swizzle } = formatsOf(content, layout);
  const blocks = file.read("BLKS");
  const uniforms = new Uniforms();
  const form: Form = { module: "bc", planes: [], uniforms: new Uint8Array(0), images: [], blocks: [] };
  for (const size of layout.images) {
    const stored = atLevel(size, reduceLog2);
    const levels = Array.from({ length: layout.levels }, (_, level) => {
      const { width, height } = atLevel(size, reduceLog2 + level);
      return readPlanes(blocks, "blocks", formats, width, height);
    });
    const first = form.planes.length;
    // Levels beyond 1x1 repeat the last.
    form.planes.push(...withLevels(levels.slice(0, fullLevels(stored))));
    const params = [size.width, size.height, stored.width, stored.height, layout.levels, CLAMP, swizzle, reduceLog2 > 0 ? 1 : 0];
    form.images.push({ planes: [first, form.planes.length - 1], uniforms: uniforms.add(...params), image: 0 });
  }
  blocks.end();
  form.uniforms = uniforms.bytes();
  return { form, layers: [1, 1] };
});
