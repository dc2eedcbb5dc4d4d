// Texfold for C. Written by cbindgen from crates/ffi/src; not to be edited.
//
// Functions that can fail return a TexfoldStatus and write their result to the place of their last parameter, which stays as it was
// where they fail; texfold_error() then has a text. Pointers may not be null unless a parameter's description allows it: null gives
// TEXFOLD_STATUS_ARGUMENT. Objects may be read by any number of threads at once. Texels are as stored: sRGB images give sRGB.

#ifndef TEXFOLD_H
#define TEXFOLD_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

// Outcome of a function.
typedef enum TexfoldStatus {
  // The result is there.
  TEXFOLD_STATUS_OK = 0,
  // A null pointer, a wrong length, an unknown name or a number out of range.
  TEXFOLD_STATUS_ARGUMENT = 1,
  // Not a file of textures of images, or damaged.
  TEXFOLD_STATUS_FILE = 2,
  // More texels or bytes than the limits allow.
  TEXFOLD_STATUS_LIMIT = 3,
  // There is no such image or level, or the region leaves it.
  TEXFOLD_STATUS_REGION = 4,
  // The images cannot be encoded so.
  TEXFOLD_STATUS_ENCODE = 5,
  // Cancelled by the caller.
  TEXFOLD_STATUS_CANCELLED = 6,
  // A fault of the library; its state stays usable. Please report it.
  TEXFOLD_STATUS_FAULT = 7,
} TexfoldStatus;

// Cancels an encoder from another thread.
typedef struct TexfoldCancel TexfoldCancel;

// Planes, parameters and textures in blocks of a texture: copies, which outlive it.
typedef struct TexfoldGpu TexfoldGpu;

// Calls of the block decoder's functions, with all their parameters.
typedef struct TexfoldProgram TexfoldProgram;

// A texture of one image, a set, or the maps of a material.
typedef struct TexfoldTexture TexfoldTexture;

// Limits of what opening a file allocates.
typedef struct TexfoldLimits {
  // Texels of all images and mip levels.
  uint64_t texels;
  // Bytes of memory.
  uint64_t bytes;
} TexfoldLimits;

// Description of a texture. Strings live as long as the texture.
typedef struct TexfoldInfo {
  // Name of the codec.
  const char *codec;
  // Images.
  uint32_t images;
  // Mip levels of each image; 1 where there is level 0 alone.
  uint32_t levels;
  // Layers that were in the file, of `layers` that a whole file has.
  uint32_t layers_loaded;
  // Layers of a whole file.
  uint32_t layers;
  // Bytes of the compressed form on a GPU.
  uint64_t compressed_bytes;
  // Bytes on a GPU while it is drawn, decoded where the codec is read by block.
  uint64_t resident_bytes;
} TexfoldInfo;

// Description of an image of a texture. Strings live as long as the texture.
typedef struct TexfoldImageInfo {
  // Columns of level 0. Level l has max(1, width >> l).
  uint32_t width;
  // Rows of level 0.
  uint32_t height;
  // 1 gray, 2 gray and alpha, 3 RGB, 4 RGB and alpha.
  uint32_t channels;
  // Bits of a channel of the source, 8 or 16.
  uint32_t bits;
  // "srgb", "linear" or "normal".
  const char *color;
  // Meaning of the second or fourth channel: "opaque", "straight", "cutout" or "band".
  const char *alpha;
  // Least alpha that is drawn, 0 to 1, where alpha is "cutout".
  float cutout;
  // Name of the map; null but in a material.
  const char *map;
  // Kind of the map, such as "color", "normal", "orm"; null but in a material.
  const char *map_kind;
} TexfoldImageInfo;

// A rectangle of a mip level of an image.
typedef struct TexfoldRegion {
  // Number of the image.
  uint32_t image;
  // Mip level.
  uint32_t level;
  // First column.
  uint32_t x;
  // First row.
  uint32_t y;
  // Columns; 0 for all from x on.
  uint32_t width;
  // Rows; 0 for all from y on.
  uint32_t height;
} TexfoldRegion;

// Numbers of planes, images and blocks of a texture, and its parameters. Pointers live as long as the object.
typedef struct TexfoldGpuInfo {
  // Name of the shader that reads its texels: `texfold shaders <module>` writes it.
  const char *module;
  // Textures to upload.
  uint32_t planes;
  // Images, each with a binding.
  uint32_t images;
  // Textures in blocks to upload and decode; 0 where texels are read from the planes.
  uint32_t blocks;
  // Textures that the blocks are decoded to. Of codec "dct" they are the images; of others their texels are made of them by the shader.
  uint32_t decoded;
  // Parameters of all images.
  const uint8_t *uniforms;
  // Bytes of the parameters.
  size_t uniforms_size;
} TexfoldGpuInfo;

// A texture to upload. Pointers live as long as the object.
typedef struct TexfoldPlaneInfo {
  // Columns of level 0.
  uint32_t width;
  // Rows of level 0.
  uint32_t height;
  // Mip levels in `data`.
  uint32_t levels;
  // Format by its name in WebGPU, such as "rgba8unorm", "r32uint" or "bc7-rgba-unorm".
  const char *format;
  // The levels one after the other, largest first, rows without padding.
  const uint8_t *data;
  // Bytes of `data`.
  size_t size;
} TexfoldPlaneInfo;

// Bindings of an image. Pointers live as long as the object.
typedef struct TexfoldBindingInfo {
  // Numbers of textures in the order of the shader's bindings: planes, and from the number of planes on those that blocks are decoded to.
  const uint32_t *textures;
  // How many there are.
  size_t count;
  // First byte of the image's parameters in `uniforms`.
  uint64_t uniform_offset;
  // Bytes of the image's parameters.
  uint64_t uniform_size;
  // Argument `image` of the shader's functions.
  uint32_t image;
} TexfoldBindingInfo;

// A texture in blocks of variable length. Pointers live as long as the object.
typedef struct TexfoldBlocksInfo {
  // Columns.
  uint32_t width;
  // Rows.
  uint32_t height;
  // Number of the decoded texture that it belongs to.
  uint32_t decoded;
  // First mip level of the decoded texture that it gives.
  uint32_t level;
  // Mip levels that it gives.
  uint32_t levels;
  // Name of the shader that decodes it, as `texfold shaders dct` writes it: "dct-unorm8" or "dct-uint16".
  const char *shader;
  // Storage buffer of group 0, binding 1.
  const uint32_t *words;
  // Number of words.
  size_t words_count;
  // Storage buffer of group 0, binding 2.
  const uint8_t *streams;
  // Bytes of the streams, a multiple of 4.
  size_t streams_size;
} TexfoldBlocksInfo;

// A texture that blocks are decoded to.
typedef struct TexfoldDecodedInfo {
  // Columns of level 0.
  uint32_t width;
  // Rows of level 0.
  uint32_t height;
  // Mip levels.
  uint32_t levels;
  // Bits of a channel: 8 in format rgba8unorm, 16 in rgba16uint. Both have the values of texfold_decode_rgba8 and texfold_decode_rgba16 where
  // the codec is "dct".
  uint32_t bits;
} TexfoldDecodedInfo;

// A dispatch of a program.
typedef struct TexfoldDispatch {
  // Name of the function. A static string.
  const char *entry;
  // Bind group 0, binding 0 to TexfoldProgramInfo.pass_size from this byte of `passes` on.
  uint32_t pass_offset;
  // Bind group 1, binding 0 to TexfoldProgramInfo.output_size from this byte of `outputs` on; of write_texels alone.
  uint32_t output_offset;
  // Mip level to bind in group 1, binding 1, counted from the first that is written; of write_texels alone.
  uint32_t level;
  // Workgroups.
  uint32_t groups[3];
  // True where scratch memory is filled with zeros before it.
  bool clears;
  // True of write_texels.
  bool writes;
} TexfoldDispatch;

// A program. Each dispatch reads what those before it wrote to scratch memory; those of write_texels do not depend on one another. Pointers live as long as the object.
typedef struct TexfoldProgramInfo {
  // Uniform buffer with the parameters of passes; offsets are multiples of 256.
  const uint8_t *passes;
  // Its bytes.
  size_t passes_size;
  // Bytes of it that each dispatch binds.
  size_t pass_size;
  // Uniform buffer with the parameters of write_texels; offsets are multiples of 256.
  const uint8_t *outputs;
  // Its bytes.
  size_t outputs_size;
  // Bytes of it that a dispatch binds.
  size_t output_size;
  // Bytes of scratch memory: storage buffer of group 0, binding 3. More than was allowed only where one superblock needs more alone.
  uint64_t scratch_size;
  // Dispatches in their order.
  const struct TexfoldDispatch *dispatches;
  // How many there are.
  size_t dispatch_count;
} TexfoldProgramInfo;

// A callback with the name of an encoder's stage and the share of the work that is done, 0 to 1; called from one thread at a time. False cancels.
typedef bool (*TexfoldProgress)(const char *stage, float done, void *user);

// Options of texfold_encode; texfold_encode_options() has the usual values.
typedef struct TexfoldEncodeOptions {
  // "dct", "vq", "epitome", "progressive", "bc"; null or "auto": the codec that answers the goal best.
  const char *codec;
  // "psnr" in dB, "bpp" in bits a texel, or "tolerance", the largest RMS error of a block in 8-bit units.
  const char *goal;
  // Value of the goal.
  double value;
  // "fast", "normal" or "high"; null: "normal".
  const char *effort;
  // "psnr" or "perceptual"; null: what suits the goal.
  const char *metric;
  // "block" or "texel"; null: whichever needs fewer bits.
  const char *access;
  // True to store mip levels.
  bool mips;
  // Threads; 0 for as many as there are cores.
  uint32_t threads;
  // Called while it is encoded; null for nothing.
  TexfoldProgress progress;
  // Passed to `progress`.
  void *user;
  // Cancels from another thread; null for nothing.
  const struct TexfoldCancel *cancel;
} TexfoldEncodeOptions;

// An image to encode.
typedef struct TexfoldSource {
  // Values row by row from the top, the channels of a texel side by side: bytes, or 16-bit values in the machine's byte order.
  const void *pixels;
  // Bytes at `pixels`.
  size_t size;
  // Columns.
  uint32_t width;
  // Rows.
  uint32_t height;
  // Bytes from the start of a row to that of the next; 0 for rows without padding.
  size_t row_bytes;
  // 1 gray, 2 gray and alpha, 3 RGB, 4 RGB and alpha.
  uint32_t channels;
  // Bits of a value, 8 or 16.
  uint32_t bits;
  // "srgb", "linear" or "normal"; null: "srgb", or that of the map's kind.
  const char *color;
  // "straight", or "band" where the second or fourth channel counts as colours do, as near infrared; null: "straight".
  const char *alpha;
  // Name of a map of a material, such as "color", "normal", "roughness", "orm"; null for images of one kind.
  const char *map;
} TexfoldSource;

// A file, to be freed by texfold_bytes_free.
typedef struct TexfoldBytes {
  // Its bytes.
  uint8_t *data;
  // How many there are.
  size_t size;
} TexfoldBytes;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// Text of the last failure of a function that this thread called, with its remedy; empty before the first one. It is valid until the
// thread's next failure.
const char *texfold_error(void);

// Opens a file of `size` bytes at `data`, which are not needed afterwards. `limits` may be null: 4 gigatexels and 8 GiB.
enum TexfoldStatus texfold_open(const uint8_t *data,
                                size_t size,
                                const struct TexfoldLimits *limits,
                                struct TexfoldTexture **texture);

// Frees a texture; null is allowed.
void texfold_close(struct TexfoldTexture *texture);

// Describes a texture.
enum TexfoldStatus texfold_info(const struct TexfoldTexture *texture, struct TexfoldInfo *info);

// Describes an image of a texture.
enum TexfoldStatus texfold_image_info(const struct TexfoldTexture *texture,
                                      uint32_t image,
                                      struct TexfoldImageInfo *info);

// Decodes a region to RGBA of 8 bits a channel, row by row from the top, each `row_bytes` after the one before; 0 for rows without
// padding. Gray is in red, green and blue; alpha that is not there is 255. `size` is the number of bytes at `pixels`.
enum TexfoldStatus texfold_decode_rgba8(const struct TexfoldTexture *texture,
                                        struct TexfoldRegion region,
                                        uint8_t *pixels,
                                        size_t size,
                                        size_t row_bytes);

// As texfold_decode_rgba8 to 16 bits a channel, in the machine's byte order; `row_bytes` is even, `size` still in bytes.
enum TexfoldStatus texfold_decode_rgba16(const struct TexfoldTexture *texture,
                                         struct TexfoldRegion region,
                                         uint16_t *pixels,
                                         size_t size,
                                         size_t row_bytes);

// Copies the planes, parameters and blocks of a texture.
enum TexfoldStatus texfold_gpu_new(const struct TexfoldTexture *texture, struct TexfoldGpu **gpu);

// Frees what texfold_gpu_new made; null is allowed.
void texfold_gpu_free(struct TexfoldGpu *gpu);

// Describes all of it.
enum TexfoldStatus texfold_gpu_info(const struct TexfoldGpu *gpu, struct TexfoldGpuInfo *info);

// Describes a texture to upload.
enum TexfoldStatus texfold_gpu_plane(const struct TexfoldGpu *gpu, uint32_t plane, struct TexfoldPlaneInfo *info);

// Describes the bindings of an image.
enum TexfoldStatus texfold_gpu_binding(const struct TexfoldGpu *gpu, uint32_t image, struct TexfoldBindingInfo *info);

// Describes a texture in blocks.
enum TexfoldStatus texfold_gpu_blocks(const struct TexfoldGpu *gpu, uint32_t blocks, struct TexfoldBlocksInfo *info);

// Describes a texture that blocks are decoded to.
enum TexfoldStatus texfold_gpu_decoded(const struct TexfoldGpu *gpu, uint32_t decoded, struct TexfoldDecodedInfo *info);

// Dispatches that decode a texture in blocks within `max_scratch` bytes of scratch memory (0: 128 MiB, what every WebGPU device binds;
// large textures are faster within more): all of its levels, `x` and `y` being 0; or where `region` is not null that rectangle (levels
// counted from that of the blocks, `image` 0), whose first texel goes to column `x` and row `y` of the target. The functions are in the
// shader that TexfoldBlocksInfo names.
enum TexfoldStatus texfold_program_new(const struct TexfoldGpu *gpu,
                                       uint32_t blocks,
                                       const struct TexfoldRegion *region,
                                       uint32_t x,
                                       uint32_t y,
                                       uint64_t max_scratch,
                                       struct TexfoldProgram **program);

// Frees a program; null is allowed.
void texfold_program_free(struct TexfoldProgram *program);

// Describes a program.
enum TexfoldStatus texfold_program_info(const struct TexfoldProgram *program, struct TexfoldProgramInfo *info);

// An object that cancels encoders.
struct TexfoldCancel *texfold_cancel_new(void);

// Cancels the encoders that have the object among their options, now and later. Null is allowed.
void texfold_cancel(const struct TexfoldCancel *cancel);

// Frees an object that no encoder has any more; null is allowed.
void texfold_cancel_free(struct TexfoldCancel *cancel);

// The usual options: the best codec at 1 bit a texel, without mip levels.
struct TexfoldEncodeOptions texfold_encode_options(void);

// Encodes an image, a set of images, or the maps of a material, of which each has a name.
enum TexfoldStatus texfold_encode(const struct TexfoldSource *sources,
                                  size_t count,
                                  const struct TexfoldEncodeOptions *options,
                                  struct TexfoldBytes *file);

// Frees the bytes of a file; null is allowed.
void texfold_bytes_free(struct TexfoldBytes file);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* TEXFOLD_H */
