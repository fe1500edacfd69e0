#include "pictures.h"

#include <ctype.h>
#include <errno.h>
#include <stdlib.h>
#include <string.h>

/* The largest side of a picture that Cairn accepts. */
#define MAX_SIDE 16384u

static int fail(const char *path, const char *why)
{
    fprintf(stderr, "host-c: %s: %s\n", path, why);
    return 0;
}

int image_make(image *image, uint32_t width, uint32_t height)
{
    memset(image, 0, sizeof *image);
    if (width == 0 || height == 0 || width > MAX_SIDE || height > MAX_SIDE) {
        fprintf(stderr, "host-c: a picture of %ux%u pixels; each side must be 1 to %u\n", (unsigned)width,
                (unsigned)height, MAX_SIDE);
        return 0;
    }
    image->pixels = calloc((size_t)width * height, 4);
    if (image->pixels == NULL) {
        fprintf(stderr, "host-c: no memory for a picture of %ux%u pixels\n", (unsigned)width, (unsigned)height);
        return 0;
    }
    image->width = width;
    image->height = height;
    return 1;
}

void image_free(image *image)
{
    free(image->pixels);
    memset(image, 0, sizeof *image);
}

/* Reads a number of a PPM's header, after white space and comments; -1 if there is none or it is above `max`. */
static long header_number(FILE *file, long max)
{
    int c = getc(file);
    while (isspace(c) || c == '#') {
        if (c == '#') {
            while (c != '\n' && c != EOF) {
                c = getc(file);
            }
        } else {
            c = getc(file);
        }
    }
    long number = -1;
    while (c >= '0' && c <= '9') {
        number = (number < 0 ? 0 : number * 10) + (c - '0');
        if (number > max) {
            return -1;
        }
        c = getc(file);
    }
    /* Exactly one byte of white space follows the last number; the pixels begin after it. */
    return isspace(c) ? number : -1;
}

static int read_ppm(image *image, const char *path, FILE *file)
{
    if (getc(file) != 'P' || getc(file) != '6') {
        return fail(path, "is no PPM: it does not begin with P6");
    }
    const long width = header_number(file, MAX_SIDE);
    const long height = header_number(file, MAX_SIDE);
    const long maximum = header_number(file, 65535);
    if (width <= 0 || height <= 0 || maximum != 255) {
        return fail(path, "the header names no width and height up to 16384 and a maximum of 255");
    }
    if (!image_make(image, (uint32_t)width, (uint32_t)height)) {
        return 0;
    }
    for (size_t i = 0; i < (size_t)width * (size_t)height; i++) {
        uint8_t *pixel = image->pixels + i * 4;
        if (fread(pixel, 1, 3, file) != 3) {
            image_free(image);
            return fail(path, "ends before its last pixel");
        }
        pixel[3] = 255;
    }
    return 1;
}

int image_read_ppm(image *image, const char *path)
{
    memset(image, 0, sizeof *image);
    FILE *file = fopen(path, "rb");
    if (file == NULL) {
        return fail(path, strerror(errno));
    }
    const int done = read_ppm(image, path, file);
    fclose(file);
    return done;
}

void image_pattern(image *image)
{
    for (uint32_t y = 0; y < image->height; y++) {
        for (uint32_t x = 0; x < image->width; x++) {
            uint8_t *pixel = image->pixels + ((size_t)y * image->width + x) * 4;
            const uint32_t down = y * 255 / image->height;
            if (down < 128) {
                pixel[0] = (uint8_t)(90 + down / 2);
                pixel[1] = (uint8_t)(140 + down / 2);
                pixel[2] = (uint8_t)(220 - down / 4);
            } else {
                const uint32_t square = (x * 8 / image->width + y * 16 / image->height) % 2;
                pixel[0] = (uint8_t)(70 + square * 60);
                pixel[1] = (uint8_t)(90 + square * 50);
                pixel[2] = (uint8_t)(50 + square * 20);
            }
            pixel[3] = 255;
        }
    }
}

static int ends_with(const char *text, const char *end)
{
    const size_t length = strlen(text), of_end = strlen(end);
    return length > of_end && strcmp(text + length - of_end, end) == 0;
}

int film_supports(const char *path)
{
    return path == NULL || ends_with(path, ".ppm") || ends_with(path, ".y4m");
}

int film_begin(film *film, const char *path, uint32_t width, uint32_t height, uint32_t pictures_per_second)
{
    memset(film, 0, sizeof *film);
    film->path = path;
    film->width = width;
    film->height = height;
    if (path == NULL || ends_with(path, ".ppm")) {
        return 1;
    }
    if (!film_supports(path)) {
        return fail(path, "the name must end in .y4m or .ppm");
    }
    film->planes = malloc((size_t)width * height * 3);
    if (film->planes == NULL) {
        return fail(path, "no memory for a frame");
    }
    film->video = fopen(path, "wb");
    if (film->video == NULL) {
        const char *why = strerror(errno);
        film_end(film);
        return fail(path, why);
    }
    if (fprintf(film->video, "YUV4MPEG2 W%u H%u F%u:1 Ip A1:1 C444 XCOLORRANGE=LIMITED\n", (unsigned)width, (unsigned)height,
                (unsigned)pictures_per_second) < 0) {
        return fail(path, strerror(errno));
    }
    return 1;
}

static uint8_t quantise(double value)
{
    return (uint8_t)(value + 0.5);
}

/* Converts to Y'CbCr of 8 bits and limited range: Y' = 16 + 219 y, C = 128 + 224 c with c in [-0.5, 0.5]. A Y4M file does not name its
   luma weights; players use those of BT.709 from 1280 columns or 577 rows on and those of BT.601 below. */
static void convert_to_planes(const image *image, uint8_t *planes)
{
    const int is_high = image->width >= 1280 || image->height > 576;
    const double red = is_high ? 0.2126 : 0.299, blue = is_high ? 0.0722 : 0.114;
    const double green = 1 - red - blue;
    const size_t count = (size_t)image->width * image->height;
    for (size_t i = 0; i < count; i++) {
        const uint8_t *pixel = image->pixels + i * 4;
        const double r = pixel[0] / 255.0, g = pixel[1] / 255.0, b = pixel[2] / 255.0;
        const double y = red * r + green * g + blue * b;
        planes[i] = quantise(16 + 219 * y);
        planes[count + i] = quantise(128 + 112 * (b - y) / (1 - blue));
        planes[2 * count + i] = quantise(128 + 112 * (r - y) / (1 - red));
    }
}

/* x.ppm becomes x-00000.ppm and so on. */
static int write_ppm(const film *film, const image *image)
{
    char path[4096];
    const int stem = (int)strlen(film->path) - 4;
    const int length = snprintf(path, sizeof path, "%.*s-%05u.ppm", stem, film->path, (unsigned)film->written);
    if (length < 0 || (size_t)length >= sizeof path) {
        return fail(film->path, "the name is too long");
    }
    FILE *file = fopen(path, "wb");
    if (file == NULL) {
        return fail(path, strerror(errno));
    }
    int good = fprintf(file, "P6\n%u %u\n255\n", (unsigned)image->width, (unsigned)image->height) > 0;
    for (size_t i = 0; good && i < (size_t)image->width * image->height; i++) {
        good = fwrite(image->pixels + i * 4, 1, 3, file) == 3;
    }
    good = fclose(file) == 0 && good;
    return good ? 1 : fail(path, "cannot be written");
}

int film_add(film *film, const image *image)
{
    if (film->path == NULL) {
        return 1;
    }
    if (image->width != film->width || image->height != film->height) {
        return fail(film->path, "a picture of another size");
    }
    if (film->video != NULL) {
        const size_t size = (size_t)image->width * image->height * 3;
        convert_to_planes(image, film->planes);
        if (fputs("FRAME\n", film->video) < 0 || fwrite(film->planes, 1, size, film->video) != size) {
            return fail(film->path, strerror(errno));
        }
    } else if (!write_ppm(film, image)) {
        return 0;
    }
    film->written++;
    return 1;
}

int film_end(film *film)
{
    const char *path = film->path;
    FILE *video = film->video;
    free(film->planes);
    memset(film, 0, sizeof *film);
    if (video != NULL && fclose(video) != 0) {
        return fail(path, strerror(errno));
    }
    return 1;
}
