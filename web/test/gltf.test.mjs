import assert from "node:assert/strict";
import { mkdtempSync, readdirSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { after, test } from "node:test";
import validator from "gltf-validator";
import { PNG } from "pngjs";
import { texfold } from "./support.mjs";

const place = mkdtempSync(join(tmpdir(), "texfold-gltf-"));
after(() => rmSync(place, { recursive: true }));

/** What the validator of Khronos finds wrong with a file beside others: errors and warnings, and the extensions that it does not know. */
async function faults(folder, name) {
  const bytes = (file) => new Uint8Array(readFileSync(join(folder, file)));
  const report = await validator.validateBytes(bytes(name), { uri: name, externalResourceFunction: async (uri) => bytes(decodeURIComponent(uri)) });
  const { messages } = report.issues;
  const isUnknown = ({ code }) => code === "UNSUPPORTED_EXTENSION";
  return {
    wrong: messages.filter((message) => message.severity < 2 && !isUnknown(message)),
    unknown: messages.filter(isUnknown).map(({ message }) => message),
    images: report.info.resources.filter(({ image }) => image).map(({ mimeType, image: { width, height } }) => [mimeType, width, height]),
  };
}

/** Writes a scene of a triangle: colours, normals and roughness beside metalness in files, with a name that is not plain. */
function writeScene() {
  const values = [0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 1].map(Math.fround);
  const buffer = Buffer.from(new Float32Array(values).buffer);
  const image = (name, texel) => {
    const png = new PNG({ width: 512, height: 512 });
    for (let at = 0; at < 512 * 512; at++) png.data.set([...texel(at % 512, at >> 9), 255], 4 * at);
    writeFileSync(join(place, name), PNG.sync.write(png, { colorType: 2 }));
    return { uri: encodeURIComponent(name) };
  };
  const scene = {
    asset: { version: "2.0" },
    buffers: [{ uri: `data:application/octet-stream;base64,${buffer.toString("base64")}`, byteLength: buffer.length }],
    bufferViews: [{ buffer: 0, byteOffset: 0, byteLength: 36 }, { buffer: 0, byteOffset: 36, byteLength: 24 }],
    accessors: [
      { bufferView: 0, componentType: 5126, count: 3, type: "VEC3", min: [0, 0, 0], max: [1, 1, 0] },
      { bufferView: 1, componentType: 5126, count: 3, type: "VEC2" },
    ],
    images: [
      image("my colours.png", (x, y) => [x >> 1, y >> 1, (x ^ y) & 255]),
      image("normals.png", (x) => [128 + (x & 31), 128, 240]),
      image("rough.png", (x, y) => [255, (x + y) >> 2, 0]),
    ],
    textures: [{ source: 0 }, { source: 1 }, { source: 2 }],
    materials: [
      {
        pbrMetallicRoughness: { baseColorTexture: { index: 0, extensions: { KHR_texture_transform: { scale: [2, 2] } } }, metallicRoughnessTexture: { index: 2 } },
        normalTexture: { index: 1 },
      },
    ],
    extensionsUsed: ["KHR_texture_transform"],
    meshes: [{ primitives: [{ attributes: { POSITION: 0, TEXCOORD_0: 1 }, material: 0 }] }],
    nodes: [{ mesh: 0 }],
    scenes: [{ nodes: [0] }],
    scene: 0,
  };
  writeFileSync(join(place, "scene.gltf"), JSON.stringify(scene));
}

test("the validator of glTF finds nothing wrong with scenes that are packed and unpacked", async () => {
  writeScene();
  // One warning: tangents are left to whoever draws it.
  const { wrong: known } = await faults(place, "scene.gltf");
  assert.deepEqual(known.map(({ code }) => code), ["MESH_PRIMITIVE_GENERATED_TANGENT_SPACE"]);
  const of = { small: [3, "image/jpeg", 256], original: [3, "image/png", 512], none: [0] };
  for (const [fallback, [count, type, side]] of Object.entries(of)) {
    const folder = join(place, fallback), plain = join(place, `${fallback}-plain`);
    texfold("pack", join(place, "scene.gltf"), "--out", folder, "--effort", "fast", "--fallback", fallback);
    const packed = await faults(folder, "scene.glb");
    assert.deepEqual(packed.wrong, known, fallback);
    assert.equal(packed.unknown.length, 1, "the extension of textures");
    assert.deepEqual(packed.images, Array(count).fill([type, side, side]), fallback);
    assert.equal(readdirSync(folder).filter((name) => name.endsWith(".txf")).length, 1);
    texfold("unpack", join(folder, "scene.glb"), "--out", plain);
    const { wrong, unknown, images } = await faults(plain, "scene.glb");
    assert.deepEqual([wrong, unknown, images], [known, [], Array(3).fill(["image/png", 512, 512])], fallback);
  }
});
