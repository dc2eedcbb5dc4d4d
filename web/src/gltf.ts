// Scenes of glTF whose textures name maps of .txf files, as `texfold pack` writes them: a plugin of three.js' GLTFLoader.

import { pixelsOf } from "./container.js";
import { LoadError } from "./errors.js";
import type { Gpu } from "./gpu.js";
import { open } from "./texture.js";

const NAME = "TEXFOLD_texture";

/** What is used of three.js' textures. */
interface EngineTexture {
  name: string;
  flipY: boolean;
  generateMipmaps: boolean;
  magFilter: number;
  minFilter: number;
  wrapS: number;
  wrapT: number;
}

/** What is used of GLTFLoader's parser. */
interface Parser {
  json: {
    textures?: { sampler?: number; name?: string; extensions?: Record<string, { uri?: unknown; map?: unknown }> }[];
    samplers?: { magFilter?: number; minFilter?: number; wrapS?: number; wrapT?: number }[];
  };
  options: { path?: string };
  associations: Map<unknown, unknown>;
}

/** Constants of three.js by those of glTF. */
const FILTERS: Record<number, number> = { 9728: 1003, 9729: 1006, 9984: 1004, 9985: 1007, 9986: 1005, 9987: 1008 };
const WRAPS: Record<number, number> = { 33071: 1001, 33648: 1002, 10497: 1000 };
const LINEAR = 1006, LINEAR_MIPMAP_LINEAR = 1008, REPEAT = 1000;

/** Maps of a file by their names. */
type Maps = Map<string, GPUTexture>;

/**
 * What GLTFLoader registers: `loader.register(textures(gpu, THREE.ExternalTexture))` draws the maps of packed scenes on the device of the
 * renderer, `new Gpu(renderer.backend.device)`. The textures of the device are the caller's to destroy, as `ExternalTexture.sourceTexture`.
 */
export function textures<T extends EngineTexture>(gpu: Gpu, ExternalTexture: new (texture: GPUTexture) => T) {
  return (parser: Parser) => {
    const files = new Map<string, Promise<Maps>>();
    return {
      name: NAME,
      loadTexture(index: number): Promise<T> | null {
        const texture = parser.json.textures?.[index], place = texture?.extensions?.[NAME];
        if (!texture || !place) {
          return null;
        }
        const address = `${parser.options.path ?? ""}${fileName(place.uri)}`;
        const maps = files.get(address) ?? load(gpu, address);
        files.set(address, maps);
        return maps.then((found) => {
          const plain = found.get(`${place.map}`);
          if (!plain) {
            throw new LoadError(`${address} has no map ${place.map}; pack the scene again`);
          }
          const made = new ExternalTexture(plain), sampler = parser.json.samplers?.[texture.sampler ?? -1] ?? {};
          made.name = texture.name ?? `${place.map}`;
          made.flipY = false;
          made.generateMipmaps = false;
          made.magFilter = FILTERS[sampler.magFilter ?? 0] ?? LINEAR;
          made.minFilter = FILTERS[sampler.minFilter ?? 0] ?? LINEAR_MIPMAP_LINEAR;
          made.wrapS = WRAPS[sampler.wrapS ?? 0] ?? REPEAT;
          made.wrapT = WRAPS[sampler.wrapT ?? 0] ?? REPEAT;
          parser.associations.set(made, { textures: index });
          return made;
        });
      },
    };
  };
}

/** The name of a file in the scene's folder. */
function fileName(uri: unknown): string {
  if (typeof uri !== "string" || uri === "" || /[/\\:]|^\.\.?$/.test(uri)) {
    throw new LoadError(`a texture of the scene names the file ${uri}, which is no name of a file in its folder; pack the scene again`);
  }
  return encodeURIComponent(uri);
}

/** All maps of a file as plain textures of the device; those of sRGB are converted where they are sampled. */
async function load(gpu: Gpu, address: string): Promise<Maps> {
  const texture = await open(address), { layout } = texture;
  const loaded = await gpu.upload(texture), maps: Maps = new Map();
  try {
    for (const [image, { name }] of (layout?.maps ?? []).entries()) {
      maps.set(name, await gpu.plain(loaded, image, pixelsOf(layout!, image).colour === "srgb"));
    }
  } finally {
    loaded.destroy();
  }
  return maps;
}
