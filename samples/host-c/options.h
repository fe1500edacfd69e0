/* The command line of host-c. */
#ifndef OPTIONS_H
#define OPTIONS_H

#include <stdint.h>

typedef struct options {
    const char *world;        /* bundle */
    const char *script;       /* control script, or null for no input */
    const char *seed_picture; /* PPM, or null for a pattern */
    const char *preset;       /* operating point, or null for the library's default */
    const char *out;          /* .y4m or .ppm, or null to write nothing */
    const char *device;       /* "cpu", "gpu" or "auto" */
    const char *onnxruntime;  /* library file, or null to let Cairn search for it */
    double seconds;           /* world time; 0 for the duration of the script, or for 1 second without a script */
    uint64_t seed;
    uint32_t threads; /* 0: the library chooses */
    int verbose;
} options;

/* What a command line asks for. */
typedef enum request { REQUEST_RUN, REQUEST_HELP, REQUEST_WRONG } request;

/* Reads the command line; prints an error in it to standard error. */
request options_read(options *options, int count, char **arguments);

/* The text for --help. */
extern const char options_help[];

#endif
