/* Loading worlds: their properties, progress, cancelling, and invalid bundles. */
#include <stdint.h>
#include <sys/stat.h>

#include "check.h"

static void a_world_describes_itself(void)
{
    cairn_device *device = make_device();
    cairn_world *world = make_world(device);
    /* The world keeps its device alive. */
    OK(cairn_device_destroy(device));
    cairn_world_info info = {.struct_size = sizeof info};
    OK(cairn_world_get_info(world, &info));
    CHECK(info.render_width == 128 && info.render_height == 72 && info.decoded_height == 64);
    CHECK(info.latent_channels == 4 && info.latent_height == 4 && info.latent_width == 8);
    CHECK(info.global_window == 16 && info.max_global_window == 64 && info.global_dilation == 4);
    CHECK(info.precision == CAIRN_PRECISION_F32 && info.keys == 256 && info.pictures_per_latent == 4);
    CHECK(info.name[0] && info.licence[0] && strlen(info.digest) == 64);
    cairn_world_memory memory = {.struct_size = sizeof memory};
    OK(cairn_world_get_memory(world, &memory));
    CHECK(memory.total == memory.bundle + memory.weights + memory.ring + memory.slabs + memory.intermediates +
                              memory.autoencoder + memory.arena);
    CHECK(memory.weights > 0 && memory.ring > 0);
    char text[64];
    size_t length = 12345;
    CHECK(cairn_world_get_licence(world, text, sizeof text, &length) >= CAIRN_OK);
    CHECK(length != 12345 && strlen(text) < sizeof text);
    OK(cairn_world_destroy(world));
}

static void without_a_path_the_embedded_world_is_loaded(void)
{
    cairn_device *device = make_device();
    cairn_world *world = NULL;
    const cairn_world_options options = {.struct_size = sizeof options};
    OK(cairn_world_load(device, &options, &world));
    cairn_world_info info = {.struct_size = sizeof info};
    OK(cairn_world_get_info(world, &info));
    CHECK(strcmp(info.name, "Miniature") == 0);
    CHECK(info.decoded_width == 256 && info.decoded_height == 128);
    OK(cairn_world_destroy(world));
    OK(cairn_device_destroy(device));
}

static void invalid_worlds_are_refused(void)
{
    cairn_device *device = make_device();
    cairn_world *world = (cairn_world *)(uintptr_t)0x1234;
    cairn_world_options good = {.struct_size = sizeof good, .path = world_path()}, options = good;
    options.path = "/there/is/no/such/world";
    ANSWERS(CAIRN_ERROR_IO, cairn_world_load(device, &options, &world));
    CHECK(strstr(message(), "no/such/world") != NULL);
    options.path = "\xc3\x28";
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_world_load(device, &options, &world));
    options = good;
    options.precision = 3;
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_world_load(device, &options, &world));
    options = good;
    for (int i = 0; i < 4; i++) {
        static const char *const points[] = {"", "nonsense", "stock,g17", "g4294967295"};
        options.operating_point = points[i];
        ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_world_load(device, &options, &world));
    }
    options = good;
    options.memory_limit = 1;
    ANSWERS(CAIRN_ERROR_OUT_OF_MEMORY, cairn_world_load(device, &options, &world));
    CHECK(strstr(message(), "MiB are needed") != NULL);
#ifdef CAIRN_WORLD_FIT_WINDOW /* Not in the first header. */
    /* Not even the narrowest window fits into a byte; the widest fits into the available memory. */
    options.flags = CAIRN_WORLD_FIT_WINDOW;
    ANSWERS(CAIRN_ERROR_OUT_OF_MEMORY, cairn_world_load(device, &options, &world));
    options.flags = 1u << 31;
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_world_load(device, &options, &world));
#endif
#ifdef CAIRN_WORLD_CHECK_PRECISION /* Slices came after it. */
    options = good;
    options.slices = UINT32_MAX;
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_world_load(device, &options, &world));
    CHECK(strstr(message(), "it can be split into 1 to ") != NULL);
#endif
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_world_load(device, NULL, &world));
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_world_load(device, &good, NULL));
    CHECK(world == (cairn_world *)(uintptr_t)0x1234);
    OK(cairn_device_destroy(device));
}

#ifdef CAIRN_WORLD_CHECK_PRECISION /* Slices came after it. */
/* The latent that a world makes in so many slices, or in as many as the limit needs; info gets the world's properties. */
static void latent_in_slices(cairn_device *device, uint32_t slices, uint32_t limit, float latent[4 * 4 * 8],
                             cairn_world_info *info)
{
    cairn_world *world = NULL;
    const cairn_world_options options = {.struct_size = sizeof options,
                                         .path = world_path(),
                                         .slices = slices,
                                         .longest_submission_us = limit};
    OK(cairn_world_load(device, &options, &world));
    OK(cairn_world_get_info(world, info));
    const cairn_rollout_options rollout_options = {.struct_size = sizeof rollout_options, .seed = 5};
    cairn_rollout *rollout = NULL;
    OK(cairn_rollout_create(world, &rollout_options, &rollout));
    const cairn_picture picture = seed_picture();
    OK(cairn_rollout_append(rollout, &picture, NULL));
    const cairn_controls c = controls(1);
    OK(cairn_rollout_step(rollout, &c, NULL));
    cairn_anchor *anchor = NULL;
    OK(cairn_rollout_get_anchor(rollout, &anchor));
    OK(cairn_anchor_read_latent(anchor, latent, 4 * 4 * 8));
    OK(cairn_anchor_destroy(anchor));
    OK(cairn_rollout_destroy(rollout));
    OK(cairn_world_destroy(world));
}

static void slices_give_the_same_latent(void)
{
    cairn_device *device = make_device();
    static float whole[4 * 4 * 8], sliced[4 * 4 * 8];
    cairn_world_info info = {.struct_size = sizeof info};
    latent_in_slices(device, 0, 0, whole, &info);
    CHECK(info.slices == 1 && info.longest_slice_us == 0);
    const uint32_t layers = info.layers;
    latent_in_slices(device, layers, 0, sliced, &info);
    CHECK(info.slices == layers && memcmp(whole, sliced, sizeof whole) == 0);
    /* No slice takes a microsecond. */
    latent_in_slices(device, 0, 1, sliced, &info);
    CHECK(info.slices == layers && info.longest_slice_us > 0 && memcmp(whole, sliced, sizeof whole) == 0);
    OK(cairn_device_destroy(device));
}
#endif

/* The calls of a progress callback, and when it cancels. */
struct watch {
    cairn_device *device;
    int calls;
    int cancel_at;
    uint64_t last_done;
    uint32_t stage;
};

static uint32_t watch_progress(const cairn_load_progress *progress, void *user)
{
    struct watch *watch = user;
    CHECK(progress->struct_size == sizeof *progress);
    CHECK(progress->done <= progress->total);
    CHECK(progress->stage >= watch->stage);
    CHECK(progress->stage != watch->stage || progress->done >= watch->last_done);
    watch->stage = progress->stage;
    watch->last_done = progress->done;
    /* It may call the library, but not destroy objects that the load uses. */
    cairn_device_info info = {.struct_size = sizeof info};
    OK(cairn_device_get_info(watch->device, &info));
    ANSWERS(CAIRN_ERROR_BUSY, cairn_device_destroy(watch->device));
    watch->calls++;
    CHECK(watch->cancel_at == 0 || watch->calls <= watch->cancel_at);
    return watch->calls == watch->cancel_at;
}

static cairn_result load_watched(struct watch *watch, cairn_world **world)
{
    cairn_world_options options = {.struct_size = sizeof options, .path = world_path()};
    options.progress = watch_progress;
    options.user = watch;
    return cairn_world_load(watch->device, &options, world);
}

static void loading_reports_progress_and_can_be_cancelled_at_every_call(void)
{
    struct watch whole = {.device = make_device()};
    cairn_world *world = NULL;
    OK(load_watched(&whole, &world));
    CHECK(whole.stage == CAIRN_LOAD_PREPARING && whole.calls > 10);
    OK(cairn_world_destroy(world));
    world = NULL;
    for (int at = 1; at <= whole.calls; at++) {
        struct watch watch = {.device = whole.device, .cancel_at = at};
        ANSWERS(CAIRN_ERROR_CANCELLED, load_watched(&watch, &world));
        CHECK(watch.calls == at && world == NULL);
    }
    struct watch again = {.device = whole.device};
    OK(load_watched(&again, &world));
    CHECK(again.calls == whole.calls);
    OK(cairn_world_destroy(world));
    OK(cairn_device_destroy(whole.device));
}

/* Copies a file of the bundle, with the byte at `at` changed if `at` is not negative. */
static void copy_file(const char *from, const char *to, const char *name, long at)
{
    char path[4096];
    snprintf(path, sizeof path, "%s/%s", from, name);
    FILE *in = fopen(path, "rb");
    snprintf(path, sizeof path, "%s/%s", to, name);
    FILE *out = fopen(path, "wb");
    CHECK(in && out);
    if (in && out) {
        int c;
        for (long i = 0; (c = fgetc(in)) != EOF; i++) {
            fputc(i == at ? c ^ 1 : c, out);
        }
    }
    if (in) fclose(in);
    if (out) fclose(out);
}

static void a_tampered_bundle_is_refused(void)
{
    static const char *const files[] = {"cairn-world.json",     "autoencoder.bin",      "decoder.f16.onnx",
                                        "decoder.f32.onnx",     "encoder.f16.onnx",     "encoder.f32.onnx",
                                        "transformer.bin",      "transformer.f16.onnx", "transformer.f32.onnx"};
    enum { FILES = sizeof files / sizeof files[0] };
    mkdir("tampered", 0777);
    cairn_device *device = make_device();
    for (int changed = -1; changed < FILES; changed++) {
        for (int i = 0; i < FILES; i++) {
            copy_file(world_path(), "tampered", files[i], i == changed ? 1000 : -1);
        }
        cairn_world_options options = {.struct_size = sizeof options, .path = "tampered"};
        cairn_world *world = NULL;
        ANSWERS(changed < 0 ? CAIRN_OK : CAIRN_ERROR_INVALID_BUNDLE, cairn_world_load(device, &options, &world));
        CHECK((world != NULL) == (changed < 0));
        OK(cairn_world_destroy(world));
    }
    OK(cairn_device_destroy(device));
}

static void twenty_worlds_leak_nothing(void)
{
    for (int i = 0; i < 20; i++) {
        cairn_device *device = make_device();
        cairn_world *world = make_world(device);
        OK(cairn_world_destroy(world));
        OK(cairn_device_destroy(device));
    }
}

int main(void)
{
    RUN(a_world_describes_itself);
    RUN(without_a_path_the_embedded_world_is_loaded);
    RUN(invalid_worlds_are_refused);
#ifdef CAIRN_WORLD_CHECK_PRECISION
    RUN(slices_give_the_same_latent);
#endif
    RUN(loading_reports_progress_and_can_be_cancelled_at_every_call);
    RUN(a_tampered_bundle_is_refused);
    RUN(twenty_worlds_leak_nothing);
    return failed_tests != 0;
}
