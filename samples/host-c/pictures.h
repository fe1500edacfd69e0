/* Pictures on disk: PPM in, PPM or Y4M out. Pixels are RGBA, four bytes each, rows from top to bottom without gaps. */
#ifndef PICTURES_H
#define PICTURES_H

#include <stdint.h>
#include <stdio.h>

typedef struct image {
    uint32_t width;
    uint32_t height;
    uint8_t *pixels; /* allocated with malloc */
} image;

/* Makes an image, all zero. Returns 0, with a message on standard error, when memory is short or a side is 0 or over 16384. */
int image_make(image *image, uint32_t width, uint32_t height);

/* Frees the pixels; an image without pixels is allowed. */
void image_free(image *image);

/* Reads a PPM (P6, 8 bits). Returns 0, with a message on standard error, on failure. */
int image_read_ppm(image *image, const char *path);

/* Fills an image with a pattern that has colour, edges and a horizon. */
void image_pattern(image *image);

/* The file or files to which pictures are written. All zero: none. */
typedef struct film {
    const char *path;
    FILE *video; /* the Y4M file; null for PPM */
    uint8_t *planes;
    uint32_t width;
    uint32_t height;
    uint32_t written;
} film;

/* Whether a film's name has a known ending. A null path is supported. */
int film_supports(const char *path);

/* Begins a film at `path`, whose ending chooses the format; with a null path nothing is written. Returns 0, with a message, on failure. */
int film_begin(film *film, const char *path, uint32_t width, uint32_t height, uint32_t pictures_per_second);

/* Adds a picture of the film's size. Returns 0, with a message, on failure. */
int film_add(film *film, const image *image);

/* Ends a film; one that never began is allowed. Returns 0, with a message, when its last bytes cannot be written. */
int film_end(film *film);

#endif
