#include "options.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

const char options_help[] =
    "host-c: walks through a world and writes what is seen\n"
    "\n"
    "usage: host-c [WORLD] [options]\n"
    "\n"
    "  WORLD                a bundle: a directory, or one file; without one, the world inside the library\n"
    "  --script FILE        what the player does (docs/control-script.md); without one, nothing\n"
    "  --seconds S          how long, at most 86400; without it until the script ends, or 1\n"
    "  --out FILE           x.y4m: a video without loss or compression, which most players play\n"
    "                       x.ppm: one picture a file, x-00000.ppm and so on\n"
    "                       without it, nothing is written\n"
    "  --seed-picture FILE  where it begins, a PPM (P6) of any size; without one, a pattern\n"
    "  --preset TEXT        how it runs, such as baseline-112 or stock,g64\n"
    "  --seed N             decides all noise; 0 without it\n"
    "  --device DEVICE      cpu, which is the default; gpu for a graphics adapter by ONNX Runtime's WebGPU provider; or auto for the best\n"
    "  --threads N          threads of a pass; one for each physical core without it\n"
    "  --onnxruntime FILE   the library of ONNX Runtime 1.24 or newer; without it, Cairn looks for one\n"
    "  --verbose            say what the library says\n"
    "  --help               this\n"
    "\n"
    "Ends with 0, with 1 when something failed, with 2 when the command line is wrong, and with 130 on Ctrl+C.\n";

static request wrong(const char *what, const char *name)
{
    fprintf(stderr, "host-c: %s: %s. See host-c --help\n", name, what);
    return REQUEST_WRONG;
}

/* Reads a text that is a whole number up to `max`, and nothing else. */
static int read_number(const char *text, uint64_t max, uint64_t *number)
{
    char *end = NULL;
    if (text[0] < '0' || text[0] > '9') {
        return 0;
    }
    errno = 0;
    const unsigned long long value = strtoull(text, &end, 10);
    if (errno != 0 || *end != '\0' || value > max) {
        return 0;
    }
    *number = value;
    return 1;
}

static int read_seconds(const char *text, double *seconds)
{
    char *end = NULL;
    const double value = strtod(text, &end);
    if (end == text || *end != '\0' || !isfinite(value) || value <= 0 || value > 86400) {
        return 0;
    }
    *seconds = value;
    return 1;
}

request options_read(options *options, int count, char **arguments)
{
    memset(options, 0, sizeof *options);
    options->device = "cpu";
    for (int i = 1; i < count; i++) {
        const char *name = arguments[i];
        if (strcmp(name, "--help") == 0 || strcmp(name, "-h") == 0) {
            return REQUEST_HELP;
        }
        if (strcmp(name, "--verbose") == 0) {
            options->verbose = 1;
            continue;
        }
        if (name[0] != '-') {
            if (options->world != NULL) {
                return wrong("there is a world already", name);
            }
            options->world = name;
            continue;
        }
        const struct {
            const char *name;
            const char **text;
        } texts[] = {
            {"--script", &options->script},
            {"--out", &options->out},
            {"--seed-picture", &options->seed_picture},
            {"--preset", &options->preset},
            {"--device", &options->device},
            {"--onnxruntime", &options->onnxruntime},
        };
        const char **text = NULL;
        for (size_t t = 0; t < sizeof texts / sizeof texts[0]; t++) {
            if (strcmp(name, texts[t].name) == 0) {
                text = texts[t].text;
            }
        }
        const int known = text != NULL || strcmp(name, "--seconds") == 0 || strcmp(name, "--seed") == 0 ||
                          strcmp(name, "--threads") == 0;
        if (!known) {
            return wrong("there is no such option", name);
        }
        if (++i == count) {
            return wrong("a value must follow", name);
        }
        const char *value = arguments[i];
        uint64_t number = 0;
        if (text == &options->device && strcmp(value, "cpu") != 0 && strcmp(value, "gpu") != 0 && strcmp(value, "auto") != 0) {
            return wrong("is no device; use cpu, gpu or auto", value);
        }
        if (text != NULL) {
            *text = value;
        } else if (strcmp(name, "--seconds") == 0) {
            if (!read_seconds(value, &options->seconds)) {
                return wrong("is no time over 0 and up to 86400 seconds", value);
            }
        } else if (strcmp(name, "--seed") == 0) {
            if (!read_number(value, UINT64_MAX, &options->seed)) {
                return wrong("is no whole number of 64 bits", value);
            }
        } else {
            if (!read_number(value, 1024, &number)) {
                return wrong("is no number of threads from 0 to 1024", value);
            }
            options->threads = (uint32_t)number;
        }
    }
    return REQUEST_RUN;
}
