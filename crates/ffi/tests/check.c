/* Reads textures in all ways and misuses the library: check FILE.txf... . Prints a hash of the texels of each level of each image, of
 * 8 and of 16 bits, then one line for each misuse. Ends with 1 where the library does other than it should. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <texfold.h>

static int wrong;

#define EXPECT(condition) \
    do { \
        if (!(condition)) { \
            fprintf(stderr, "line %d: %s: %s\n", __LINE__, #condition, texfold_error()); \
            wrong = 1; \
        } \
    } while (0)

static uint64_t hash_of(const void *data, size_t size) {
    uint64_t hash = 14695981039346656037u;
    for (size_t i = 0; i < size; i++) hash = (hash ^ ((const unsigned char *)data)[i]) * 1099511628211u;
    return hash;
}

/* The bytes of a file, as many as there are: a read beyond them is seen. */
static unsigned char *contents(const char *name, size_t *size) {
    FILE *in = fopen(name, "rb");
    if (!in || fseek(in, 0, SEEK_END)) return perror(name), exit(1), NULL;
    *size = (size_t)ftell(in);
    unsigned char *data = malloc(*size);
    rewind(in);
    if (!data || fread(data, 1, *size, in) != *size) return perror(name), exit(1), NULL;
    fclose(in);
    return data;
}

static void read_levels(const TexfoldTexture *texture, const char *name) {
    TexfoldInfo info;
    EXPECT(texfold_info(texture, &info) == TEXFOLD_STATUS_OK);
    for (uint32_t image = 0; image < info.images; image++) {
        TexfoldImageInfo about;
        EXPECT(texfold_image_info(texture, image, &about) == TEXFOLD_STATUS_OK);
        for (uint32_t level = 0; level < info.levels; level++) {
            uint32_t width = about.width >> level ? about.width >> level : 1;
            uint32_t height = about.height >> level ? about.height >> level : 1;
            size_t texels = (size_t)width * height;
            TexfoldRegion whole = {.image = image, .level = level};
            uint8_t *eight = malloc(4 * texels);
            uint16_t *sixteen = malloc(8 * texels);
            EXPECT(texfold_decode_rgba8(texture, whole, eight, 4 * texels, 0) == TEXFOLD_STATUS_OK);
            EXPECT(texfold_decode_rgba16(texture, whole, sixteen, 8 * texels, 0) == TEXFOLD_STATUS_OK);
            printf("%s %s %u %u %ux%u %016llx %016llx\n", name, info.codec, image, level, width, height,
                   (unsigned long long)hash_of(eight, 4 * texels), (unsigned long long)hash_of(sixteen, 8 * texels));
            /* One byte less than needed. */
            EXPECT(texfold_decode_rgba8(texture, whole, eight, 4 * texels - 1, 0) == TEXFOLD_STATUS_ARGUMENT);
            EXPECT(texfold_decode_rgba16(texture, whole, sixteen, 8 * texels - 1, 0) == TEXFOLD_STATUS_ARGUMENT);
            EXPECT(texfold_decode_rgba8(texture, whole, eight, 4 * texels, 4 * width - 1) == TEXFOLD_STATUS_ARGUMENT);
            EXPECT(texfold_decode_rgba16(texture, whole, sixteen, 8 * texels, 8 * width + 1) == TEXFOLD_STATUS_ARGUMENT);
            whole.width = width + 1;
            EXPECT(texfold_decode_rgba8(texture, whole, eight, 4 * texels, 0) == TEXFOLD_STATUS_REGION);
            whole.width = 0xffffffff, whole.x = 0xffffffff;
            EXPECT(texfold_decode_rgba8(texture, whole, eight, 4 * texels, 0) == TEXFOLD_STATUS_REGION);
            free(eight), free(sixteen);
        }
    }
    TexfoldRegion none = {.image = info.images};
    uint8_t texel[4];
    EXPECT(texfold_decode_rgba8(texture, none, texel, 4, 0) == TEXFOLD_STATUS_REGION);
    TexfoldRegion beyond = {.level = 4000000000u};
    EXPECT(texfold_decode_rgba8(texture, beyond, texel, 4, 0) == TEXFOLD_STATUS_REGION);
    EXPECT(texfold_decode_rgba8(texture, (TexfoldRegion){.width = 1, .height = 1}, NULL, 4, 0) == TEXFOLD_STATUS_ARGUMENT);
}

/* Everything that a GPU gets; each byte is read. */
static void read_gpu(const TexfoldTexture *texture) {
    TexfoldGpu *gpu;
    TexfoldGpuInfo info;
    EXPECT(texfold_gpu_new(texture, &gpu) == TEXFOLD_STATUS_OK);
    EXPECT(texfold_gpu_info(gpu, &info) == TEXFOLD_STATUS_OK);
    uint64_t hash = hash_of(info.uniforms, info.uniforms_size);
    for (uint32_t number = 0; number < info.planes; number++) {
        TexfoldPlaneInfo plane;
        EXPECT(texfold_gpu_plane(gpu, number, &plane) == TEXFOLD_STATUS_OK);
        hash ^= hash_of(plane.data, plane.size) ^ strlen(plane.format);
    }
    for (uint32_t number = 0; number < info.images; number++) {
        TexfoldBindingInfo binding;
        EXPECT(texfold_gpu_binding(gpu, number, &binding) == TEXFOLD_STATUS_OK);
        EXPECT(binding.uniform_offset + binding.uniform_size <= info.uniforms_size);
        hash ^= hash_of(binding.textures, 4 * binding.count);
    }
    for (uint32_t number = 0; number < info.blocks; number++) {
        TexfoldBlocksInfo blocks;
        TexfoldProgram *program;
        TexfoldProgramInfo calls;
        EXPECT(texfold_gpu_blocks(gpu, number, &blocks) == TEXFOLD_STATUS_OK);
        EXPECT(blocks.streams_size % 4 == 0);
        hash ^= hash_of(blocks.words, 4 * blocks.words_count) ^ hash_of(blocks.streams, blocks.streams_size);
        EXPECT(texfold_program_new(gpu, number, NULL, 0, 0, 0, &program) == TEXFOLD_STATUS_OK);
        EXPECT(texfold_program_info(program, &calls) == TEXFOLD_STATUS_OK);
        EXPECT(calls.dispatch_count > 2 && calls.dispatches[0].clears);
        EXPECT(calls.dispatches[calls.dispatch_count - 1].writes);
        for (size_t i = 0; i < calls.dispatch_count; i++) {
            EXPECT(calls.dispatches[i].pass_offset + calls.pass_size <= calls.passes_size);
            EXPECT(calls.dispatches[i].output_offset + calls.output_size <= calls.outputs_size);
            hash ^= strlen(calls.dispatches[i].entry);
        }
        hash ^= hash_of(calls.passes, calls.passes_size) ^ hash_of(calls.outputs, calls.outputs_size);
        texfold_program_free(program);
        TexfoldRegion beyond = {.x = blocks.width};
        EXPECT(texfold_program_new(gpu, number, &beyond, 0, 0, 0, &program) == TEXFOLD_STATUS_REGION);
    }
    TexfoldPlaneInfo plane;
    EXPECT(texfold_gpu_plane(gpu, info.planes, &plane) == TEXFOLD_STATUS_ARGUMENT);
    TexfoldProgram *program;
    EXPECT(texfold_program_new(gpu, info.blocks, NULL, 0, 0, 0, &program) == TEXFOLD_STATUS_ARGUMENT);
    if (hash == 0) printf("nothing\n");
    texfold_gpu_free(gpu);
}

static void misuse(unsigned char *data, size_t size) {
    TexfoldTexture *texture;
    EXPECT(texfold_open(NULL, size, NULL, &texture) == TEXFOLD_STATUS_ARGUMENT);
    EXPECT(texfold_open(data, size, NULL, NULL) == TEXFOLD_STATUS_ARGUMENT);
    EXPECT(texfold_open(data, 0, NULL, &texture) == TEXFOLD_STATUS_FILE);
    EXPECT(texfold_open(data, SIZE_MAX, NULL, &texture) == TEXFOLD_STATUS_ARGUMENT);
    TexfoldLimits limits = {.texels = 1, .bytes = 1 << 20};
    EXPECT(texfold_open(data, size, &limits, &texture) == TEXFOLD_STATUS_LIMIT);
    printf("limit: %s\n", texfold_error());
    data[0] ^= 1;
    EXPECT(texfold_open(data, size, NULL, &texture) == TEXFOLD_STATUS_FILE);
    printf("file: %s\n", texfold_error());
    data[0] ^= 1;
    TexfoldInfo info;
    TexfoldImageInfo about;
    EXPECT(texfold_info(NULL, &info) == TEXFOLD_STATUS_ARGUMENT);
    EXPECT(texfold_image_info(NULL, 0, &about) == TEXFOLD_STATUS_ARGUMENT);
    texfold_close(NULL), texfold_gpu_free(NULL), texfold_program_free(NULL), texfold_cancel_free(NULL), texfold_cancel(NULL);
    texfold_bytes_free((TexfoldBytes){NULL, 0});
}

static bool count(const char *stage, float done, void *user) {
    EXPECT(stage && done >= 0 && done <= 1);
    return --*(int *)user > 0;
}

static void encode(void) {
    enum { SIDE = 40, ROW = 3 * SIDE + 8 };
    static uint8_t pixels[SIDE * ROW - 8];
    for (int i = 0; i < (int)sizeof pixels; i++) pixels[i] = (uint8_t)(i % ROW * 2 + i / ROW);
    TexfoldSource source = {.pixels = pixels, .size = sizeof pixels, .width = SIDE, .height = SIDE, .row_bytes = ROW, .channels = 3, .bits = 8};
    TexfoldEncodeOptions options = texfold_encode_options();
    int calls = 1000000;
    options.codec = "dct", options.goal = "psnr", options.value = 40, options.effort = "fast", options.mips = true;
    options.progress = count, options.user = &calls, options.threads = 1;
    TexfoldBytes file = {0};
    EXPECT(texfold_encode(&source, 1, &options, &file) == TEXFOLD_STATUS_OK);
    EXPECT(calls < 1000000);
    TexfoldTexture *texture;
    uint8_t back[4 * SIDE * SIDE];
    EXPECT(texfold_open(file.data, file.size, NULL, &texture) == TEXFOLD_STATUS_OK);
    EXPECT(texfold_decode_rgba8(texture, (TexfoldRegion){0}, back, sizeof back, 0) == TEXFOLD_STATUS_OK);
    double squares = 0;
    for (int i = 0; i < 3 * SIDE * SIDE; i++) {
        int texel = i / 3, at = texel / SIDE * ROW + texel % SIDE * 3 + i % 3;
        int difference = back[4 * texel + i % 3] - pixels[at];
        squares += difference * difference;
    }
    /* 40 dB: mean squares below 6.5. */
    EXPECT(squares / (3 * SIDE * SIDE) <= 6.6);
    texfold_close(texture), texfold_bytes_free(file);

    TexfoldSource maps[2] = {source, source};
    maps[0].map = "color", maps[1].map = "normal";
    EXPECT(texfold_encode(maps, 2, &options, &file) == TEXFOLD_STATUS_OK);
    EXPECT(texfold_open(file.data, file.size, NULL, &texture) == TEXFOLD_STATUS_OK);
    TexfoldImageInfo about;
    EXPECT(texfold_image_info(texture, 1, &about) == TEXFOLD_STATUS_OK && !strcmp(about.color, "normal") && !strcmp(about.map, "normal"));
    texfold_close(texture), texfold_bytes_free(file);
    maps[1].map = NULL;
    EXPECT(texfold_encode(maps, 2, &options, &file) == TEXFOLD_STATUS_ARGUMENT);

    calls = 1;
    EXPECT(texfold_encode(&source, 1, &options, &file) == TEXFOLD_STATUS_CANCELLED);
    TexfoldCancel *cancel = texfold_cancel_new();
    options.progress = NULL, options.cancel = cancel;
    texfold_cancel(cancel);
    EXPECT(texfold_encode(&source, 1, &options, &file) == TEXFOLD_STATUS_CANCELLED);
    options.cancel = NULL;
    texfold_cancel_free(cancel);

    options.effort = "quick";
    EXPECT(texfold_encode(&source, 1, &options, &file) == TEXFOLD_STATUS_ARGUMENT);
    printf("effort: %s\n", texfold_error());
    options.effort = NULL, options.value = -1;
    EXPECT(texfold_encode(&source, 1, &options, &file) == TEXFOLD_STATUS_ARGUMENT);
    options.value = 40;
    EXPECT(texfold_encode(NULL, 1, &options, &file) == TEXFOLD_STATUS_ARGUMENT);
    EXPECT(texfold_encode(&source, 0, &options, &file) == TEXFOLD_STATUS_ENCODE);
    EXPECT(texfold_encode(&source, 1, NULL, &file) == TEXFOLD_STATUS_ARGUMENT);
    EXPECT(texfold_encode(&source, 1, &options, NULL) == TEXFOLD_STATUS_ARGUMENT);
    TexfoldSource bad = source;
    bad.size--;
    EXPECT(texfold_encode(&bad, 1, &options, &file) == TEXFOLD_STATUS_ARGUMENT);
    bad = source, bad.row_bytes = 3 * SIDE - 1;
    EXPECT(texfold_encode(&bad, 1, &options, &file) == TEXFOLD_STATUS_ARGUMENT);
    bad = source, bad.channels = 5;
    EXPECT(texfold_encode(&bad, 1, &options, &file) == TEXFOLD_STATUS_ARGUMENT);
    bad = source, bad.bits = 12;
    EXPECT(texfold_encode(&bad, 1, &options, &file) == TEXFOLD_STATUS_ARGUMENT);
    bad = source, bad.height = 0xffffffff, bad.width = 0xffffffff, bad.row_bytes = 0;
    EXPECT(texfold_encode(&bad, 1, &options, &file) == TEXFOLD_STATUS_ARGUMENT);
    bad = source, bad.width = 0;
    EXPECT(texfold_encode(&bad, 1, &options, &file) == TEXFOLD_STATUS_ENCODE);
    bad = source, bad.color = "\xff";
    EXPECT(texfold_encode(&bad, 1, &options, &file) == TEXFOLD_STATUS_ARGUMENT);
}

int main(int count, char **names) {
    EXPECT(texfold_error()[0] == 0);
    for (int i = 1; i < count; i++) {
        size_t size;
        unsigned char *data = contents(names[i], &size);
        TexfoldTexture *texture;
        EXPECT(texfold_open(data, size, NULL, &texture) == TEXFOLD_STATUS_OK);
        if (i == 1) misuse(data, size);
        free(data);
        read_levels(texture, names[i]);
        read_gpu(texture);
        texfold_close(texture);
    }
    encode();
    return wrong;
}
