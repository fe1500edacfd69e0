/* Pictures on disk: PPM in, PPM or Y4M out. Pixels are RGBA, four bytes each, rows from top to bottom without gaps. */
#ifndef PICTURES_H
#define PICTURES_H

#include <stdint.h>
#include <stdio.h>

typedef struct image {
    uint32_t width;
    uint32_t height;
    uint8_t *pixels; /* of malloc */
} image;

/* Makes an image, all zero. 0, with a message on standard error, when there is no memory or the size is 0 or over 16384. */
int image_make(image *image, uint32_t width, uint32_t height);

/* Frees the pixels; an image that has none is allowed. */
void image_free(image *image);

/* Reads a PPM (P6, 8 bits). 0, with a message on standard error, when that cannot be. */
int image_read_ppm(image *image, const char *path);

/* Fills an image with a pattern that has colour, edges and a horizon. */
void image_pattern(image *image);

/* Where pictures go. All zero: nowhere. */
typedef struct film {
    const char *path;
    FILE *video; /* of a Y4M; null for PPM */
    uint8_t *planes;
    uint32_t width;
    uint32_t height;
    uint32_t written;
} film;

/* Whether a film's name has an ending that is known; a null path has. */
int film_takes(const char *path);

/* Begins a film at `path`, by its ending; a null path makes one that goes nowhere. 0, with a message, when that cannot be. */
int film_begin(film *film, const char *path, uint32_t width, uint32_t height, uint32_t pictures_per_second);

/* Adds a picture of the film's size. 0, with a message, when that cannot be. */
int film_add(film *film, const image *image);

/* Ends a film, also one that never began. 0, with a message, when its last bytes cannot be
   written. */
int film_end(film *film);

#endif
