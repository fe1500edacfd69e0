/*
 * A host of Cairn in C: loads a world, walks through it by a control script, and writes the pictures to files.
 *
 * Build, in the root of the repository, after `cargo build --release`:
 *
 *     cc -std=c11 -Iinclude samples/host-c/[a-z]*.c -o host-c -Ltarget/release -lcairn -lm "-Wl,-rpath,$PWD/target/release"
 *
 * Run:
 *
 *     ./host-c --seed-picture samples/worlds/place.ppm --script samples/scripts/walk.txt --seconds 2 --out walk.y4m
 *
 * Start reading at main(): it creates a device, a world and a rollout. Then the loop in walk() keeps the rollout's queue full and
 * fetches anchors in order, as an engine does once in every frame.
 */
#include <cairn.h>

#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "options.h"
#include "pictures.h"

/* Set by Ctrl+C. */
static volatile sig_atomic_t stop;

static void on_interrupt(int number)
{
    (void)number;
    stop = 1;
}

/* Whether a call succeeded; prints the library's message to standard error if not. */
static int succeeded(cairn_result result)
{
    if (result < 0) {
        char message[2048];
        cairn_last_error(message, sizeof message, NULL);
        fprintf(stderr, "host-c: %s (%s)\n", message, cairn_result_name(result));
    }
    return result >= 0;
}

static void on_log(uint32_t level, const char *target, const char *message, void *user)
{
    static const char *const names[] = {"", "error", "warning", "info", "debug", "trace"};
    (void)user;
    fprintf(stderr, "%s: %s: %s\n", level <= CAIRN_LOG_TRACE ? names[level] : "", target, message);
}

/* Prints the progress on one line. A result other than 0 cancels the load. */
static uint32_t on_load(const cairn_load_progress *progress, void *user)
{
    (void)user;
    const uint64_t percent = progress->total > 0 ? progress->done * 100 / progress->total : 0;
    fprintf(stderr, "\r%s %3u %%", progress->stage == CAIRN_LOAD_READING ? "reading  " : "preparing", (unsigned)percent);
    return stop != 0;
}

/* Prints what a device needs and what was found, when a device cannot be created. */
static void print_requirements(uint32_t kind, const cairn_device_options *options)
{
    cairn_requirement requirements[16];
    uint32_t count = 0;
    memset(requirements, 0, sizeof requirements);
    for (size_t i = 0; i < sizeof requirements / sizeof requirements[0]; i++) {
        requirements[i].struct_size = sizeof requirements[i];
    }
    if (!succeeded(cairn_device_requirements(kind, options, requirements, sizeof requirements[0],
                                          sizeof requirements / sizeof requirements[0], &count))) {
        return;
    }
    for (uint32_t i = 0; i < count && i < sizeof requirements / sizeof requirements[0]; i++) {
        const cairn_requirement *r = &requirements[i];
        const char *status = r->status == CAIRN_REQUIREMENT_MET       ? "ok     "
                             : r->status == CAIRN_REQUIREMENT_NOT_MET ? "MISSING"
                                                                      : "unknown";
        fprintf(stderr, "  %s  needed: %s; found: %s\n", status, r->needed, r->found);
    }
}

static int make_device(const options *options, cairn_device **device)
{
    const cairn_device_options settings = {
        .struct_size = sizeof settings, .threads = options->threads, .onnxruntime = options->onnxruntime,
        /* This is a tool, so its user's environment may name libraries. A game leaves this flag out. */
        .flags = CAIRN_DEVICE_ENVIRONMENT};
    const int on_gpu = strcmp(options->device, "gpu") == 0;
    char refusals[2048] = "";
    const cairn_result r = on_gpu ? cairn_device_create_gpu(NULL, &settings, device)
                           : strcmp(options->device, "auto") == 0
                               ? cairn_device_create_auto(&settings, refusals, sizeof refusals, NULL, device)
                               : cairn_device_create_cpu(&settings, device);
    if (!succeeded(r)) {
        print_requirements(on_gpu ? CAIRN_DEVICE_WEBGPU : CAIRN_DEVICE_CPU, &settings);
        return 0;
    }
    if (refusals[0] != '\0') {
        printf("%s\n", refusals);
    }
    cairn_device_info info = {.struct_size = sizeof info};
    if (!succeeded(cairn_device_get_info(*device, &info))) {
        return 0;
    }
    printf("device:  %s\n", info.description);
    return 1;
}

static int load_world(const options *options, const cairn_device *device, cairn_world **world)
{
    const cairn_world_options world_options = {.struct_size = sizeof world_options,
                                               .path = options->world,
                                               .operating_point = options->preset,
                                               .progress = on_load};
    const cairn_result r = cairn_world_load(device, &world_options, world);
    fprintf(stderr, "\r               \r");
    cairn_world_info info = {.struct_size = sizeof info};
    if (!succeeded(r) || !succeeded(cairn_world_get_info(*world, &info))) {
        return 0;
    }
    printf("world:   %s, %ux%u pixels, %u latents a second, licence %s\n", info.name, (unsigned)info.render_width,
           (unsigned)info.render_height, (unsigned)info.latents_per_second, info.licence);
    return 1;
}

/* Reads a whole text file; the caller frees the text. */
static char *read_text(const char *path, size_t *length)
{
    FILE *file = fopen(path, "rb");
    char *text = NULL;
    size_t capacity = 0;
    *length = 0;
    if (file == NULL) {
        perror(path);
        return NULL;
    }
    do {
        capacity = capacity == 0 ? 4096 : capacity * 2;
        /* The limit is longer than any control script. */
        char *longer = capacity <= 16u << 20 ? realloc(text, capacity) : NULL;
        if (longer == NULL) {
            fprintf(stderr, "host-c: %s: is too long for a control script\n", path);
            free(text);
            fclose(file);
            return NULL;
        }
        text = longer;
        *length += fread(text + *length, 1, capacity - *length, file);
    } while (*length == capacity);
    const int failed = ferror(file);
    fclose(file);
    if (failed) {
        fprintf(stderr, "host-c: %s: cannot be read\n", path);
        free(text);
        return NULL;
    }
    return text;
}

/* Reads a script; a null path gives one without input. */
static int read_script(const char *path, cairn_script **script)
{
    static const char empty[] = "cairn-controls 1\n";
    if (path == NULL) {
        return succeeded(cairn_script_create(empty, sizeof empty - 1, script));
    }
    size_t length = 0;
    char *text = read_text(path, &length);
    const int done = text != NULL && succeeded(cairn_script_create(text, length, script));
    free(text);
    return done;
}

/* Appends the seed picture: the file's, or a pattern of the world's size. */
static int append_seed(const options *options, const cairn_world *world, cairn_rollout *rollout)
{
    image seed;
    cairn_world_info info = {.struct_size = sizeof info};
    if (!succeeded(cairn_world_get_info(world, &info))) {
        return 0;
    }
    if (options->seed_picture != NULL) {
        if (!image_read_ppm(&seed, options->seed_picture)) {
            return 0;
        }
    } else {
        if (!image_make(&seed, info.render_width, info.render_height)) {
            return 0;
        }
        image_pattern(&seed);
    }
    const cairn_picture picture = {.struct_size = sizeof picture,
                                   .format = CAIRN_FORMAT_RGBA8,
                                   .width = seed.width,
                                   .height = seed.height,
                                   .pixels = seed.pixels,
                                   .size = (uint64_t)seed.width * seed.height * 4};
    const int done = succeeded(cairn_rollout_append(rollout, &picture, NULL));
    image_free(&seed);
    return done;
}

/* Writes an anchor's pictures from index `first` on. */
static int write_pictures(const cairn_anchor *anchor, uint32_t first, image *image, film *film)
{
    cairn_anchor_info info = {.struct_size = sizeof info};
    if (!succeeded(cairn_anchor_get_info(anchor, &info))) {
        return 0;
    }
    const cairn_target target = {.struct_size = sizeof target,
                                 .format = CAIRN_FORMAT_RGBA8,
                                 .width = image->width,
                                 .height = image->height,
                                 .pixels = image->pixels,
                                 .size = (uint64_t)image->width * image->height * 4};
    for (uint32_t i = first; i < info.pictures; i++) {
        if (!succeeded(cairn_anchor_read_picture(anchor, i, &target)) || !film_add(film, image)) {
            return 0;
        }
    }
    return 1;
}

/* Makes latents 1 to `last`: keeps the queue full and fetches anchors in order. */
static int walk(cairn_rollout *rollout, const cairn_script *script, const cairn_rollout_info *info, uint64_t last, image *image,
                film *film)
{
    uint64_t tickets[CAIRN_MAX_QUEUE];
    uint64_t submitted = 0, fetched = 0;
    double busy = 0;
    while (fetched < last && !stop) {
        while (submitted < last && submitted - fetched < CAIRN_MAX_QUEUE) {
            cairn_controls controls = {.struct_size = sizeof controls};
            if (!succeeded(cairn_script_get_controls(script, submitted + 1, info->latents_per_second, &controls))) {
                return 0;
            }
            const cairn_result r = cairn_rollout_submit(rollout, &controls, &tickets[submitted % CAIRN_MAX_QUEUE]);
            if (!succeeded(r)) {
                return 0;
            }
            if (r == CAIRN_QUEUE_FULL) {
                break;
            }
            submitted++;
        }
        cairn_step_info step = {.struct_size = sizeof step};
        cairn_anchor *anchor = NULL;
        const cairn_result r =
            cairn_rollout_wait(rollout, tickets[fetched % CAIRN_MAX_QUEUE], 100 * 1000 * 1000, &step, &anchor);
        if (!succeeded(r)) {
            return 0;
        }
        if (r == CAIRN_NOT_READY) {
            continue; /* an engine would draw a frame now */
        }
        const int done = write_pictures(anchor, 0, image, film);
        cairn_anchor_destroy(anchor);
        if (!done) {
            return 0;
        }
        fetched++;
        busy += (double)(step.denoise_ns + step.cache_ns + step.commit_ns + step.decode_ns) / 1e9;
        fprintf(stderr, "\rlatent %llu of %llu, %.3f s each ", (unsigned long long)fetched, (unsigned long long)last,
                busy / (double)fetched);
    }
    fprintf(stderr, "\n");
    return !stop;
}

/* The number of latents that the walk makes after the seed's. */
static int latent_count(const options *options, const cairn_script *script, uint32_t per_second, uint64_t *count)
{
    double seconds = options->seconds;
    if (seconds == 0 && options->script != NULL) {
        uint64_t microseconds = 0;
        if (!succeeded(cairn_script_get_duration(script, &microseconds))) {
            return 0;
        }
        seconds = (double)microseconds / 1e6;
    }
    seconds = seconds > 0 ? seconds : 1;
    *count = (uint64_t)(seconds * per_second + 0.5);
    *count = *count > 0 ? *count : 1;
    return 1;
}

static int run_rollout(const options *options, const cairn_world *world, const cairn_script *script, cairn_rollout *rollout,
                       film *film)
{
    cairn_rollout_info info = {.struct_size = sizeof info};
    cairn_world_info about = {.struct_size = sizeof about};
    uint64_t latents = 0;
    if (!succeeded(cairn_rollout_get_info(rollout, &info)) || !succeeded(cairn_world_get_info(world, &about)) ||
        !latent_count(options, script, info.latents_per_second, &latents)) {
        return 0;
    }
    printf("rollout: %s, %llu latents\n", info.operating_point, (unsigned long long)latents);
    const uint32_t rate = info.latents_per_second * info.pictures_per_latent;
    image image;
    if (!image_make(&image, about.render_width, about.render_height)) {
        return 0;
    }
    cairn_anchor *seed = NULL;
    /* Time 0 is the seed's last picture; its earlier ones are not written. */
    int done = film_begin(film, options->out, image.width, image.height, rate) && append_seed(options, world, rollout) &&
               succeeded(cairn_rollout_get_anchor(rollout, &seed)) && write_pictures(seed, info.pictures_per_latent - 1, &image, film) &&
               walk(rollout, script, &info, latents, &image, film);
    cairn_anchor_destroy(seed);
    image_free(&image);

    cairn_rollout_statistics s = {.struct_size = sizeof s};
    if (done && succeeded(cairn_rollout_get_statistics(rollout, &s))) {
        printf("made:    %llu latents by %llu denoise and %llu cache passes; %u pictures written\n",
               (unsigned long long)s.latents, (unsigned long long)s.denoise_passes, (unsigned long long)s.cache_passes,
               (unsigned)film->written);
    }
    return done;
}

int main(int count, char **arguments)
{
    options options;
    switch (options_read(&options, count, arguments)) {
    case REQUEST_HELP:
        fputs(options_help, stdout);
        return 0;
    case REQUEST_WRONG:
        return 2;
    case REQUEST_RUN:
        break;
    }
    if (!film_supports(options.out)) {
        fprintf(stderr, "host-c: %s: the name must end in .y4m or .ppm. See host-c --help\n", options.out);
        return 2;
    }
    /* The library that was loaded may be of another build than the header. */
    if (cairn_abi_version() != CAIRN_ABI_VERSION || cairn_version() < CAIRN_VERSION) {
        fprintf(stderr, "host-c: this program was compiled for another version of the library\n");
        return 1;
    }
    signal(SIGINT, on_interrupt);
    if (options.verbose && !succeeded(cairn_set_log_callback(CAIRN_LOG_DEBUG, on_log, NULL))) {
        return 1;
    }

    cairn_device *device = NULL;
    cairn_world *world = NULL;
    cairn_rollout *rollout = NULL;
    cairn_script *script = NULL;
    film film;
    memset(&film, 0, sizeof film);
    const cairn_rollout_options rollout_options = {
        .struct_size = sizeof rollout_options, .seed = options.seed, .operating_point = options.preset};

    int done = read_script(options.script, &script) && make_device(&options, &device) &&
               load_world(&options, device, &world) && succeeded(cairn_rollout_create(world, &rollout_options, &rollout)) &&
               run_rollout(&options, world, script, rollout, &film);
    done = film_end(&film) && done;

    /* Any order is allowed, and so is null. A step in progress ends before its next pass. */
    cairn_device_destroy(device);
    cairn_world_destroy(world);
    cairn_rollout_destroy(rollout);
    cairn_script_destroy(script);
    cairn_set_log_callback(CAIRN_LOG_OFF, NULL, NULL);
    return stop ? 130 : done ? 0 : 1;
}
