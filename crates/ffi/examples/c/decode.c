/* Decodes a texture: decode FILE.txf OUT.pam. Build: cc decode.c -I include -ltexfold_c. */
#include <stdio.h>
#include <stdlib.h>
#include <texfold.h>

static int fail(const char *what) {
    fprintf(stderr, "error: %s: %s\n", what, texfold_error());
    return 1;
}

int main(int count, char **names) {
    static unsigned char file[64 << 20];
    FILE *in = count == 3 ? fopen(names[1], "rb") : NULL;
    if (!in) return fprintf(stderr, "usage: decode FILE.txf OUT.pam\n"), 2;
    size_t size = fread(file, 1, sizeof file, in);
    fclose(in);

    TexfoldTexture *texture;
    TexfoldImageInfo image;
    if (texfold_open(file, size, NULL, &texture) != TEXFOLD_STATUS_OK) return fail(names[1]);
    if (texfold_image_info(texture, 0, &image) != TEXFOLD_STATUS_OK) return fail(names[1]);
    size_t bytes = (size_t)4 * image.width * image.height;
    unsigned char *pixels = malloc(bytes);
    TexfoldRegion whole = {0}; /* image 0, level 0, from the first texel to the last */
    if (!pixels || texfold_decode_rgba8(texture, whole, pixels, bytes, 0) != TEXFOLD_STATUS_OK) return fail(names[1]);
    texfold_close(texture);

    FILE *out = fopen(names[2], "wb");
    if (!out) return perror(names[2]), 1;
    fprintf(out, "P7\nWIDTH %u\nHEIGHT %u\nDEPTH 4\nMAXVAL 255\nTUPLTYPE RGB_ALPHA\nENDHDR\n", image.width, image.height);
    fwrite(pixels, 1, bytes, out);
    free(pixels);
    return fclose(out) == 0 ? 0 : 1;
}
