/* The command line of host-c. */
#ifndef OPTIONS_H
#define OPTIONS_H

#include <stdint.h>

typedef struct options {
    const char *world;        /* bundle */
    const char *script;       /* control script, or null for standing still */
    const char *seed_picture; /* PPM, or null for a pattern */
    const char *preset;       /* operating point, or null for the library's default */
    const char *out;          /* .y4m or .ppm, or null for no pictures */
    const char *onnxruntime;  /* library file, or null to let Cairn look for it */
    double seconds;           /* of world time; 0 for as long as the script lasts, or 1 second without one */
    uint64_t seed;
    uint32_t threads; /* 0: the library chooses */
    int verbose;
} options;

/* What a command line asks for. */
typedef enum request { REQUEST_RUN, REQUEST_HELP, REQUEST_WRONG } request;

/* Reads the command line; what is wrong with it is said on standard error. */
request options_read(options *options, int count, char **arguments);

/* The manual. */
extern const char options_help[];

#endif
