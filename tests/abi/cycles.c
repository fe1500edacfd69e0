/* Objects created and destroyed many times: memory, files, threads and handles return to their former numbers. */
#include <dirent.h>
#include <malloc.h>
#include <stdint.h>
#include <unistd.h>

#include "check.h"

typedef struct {
    size_t bytes;
    int files, threads;
} Held;

static int entries(const char *folder)
{
    int count = 0;
    DIR *open = opendir(folder);
    if (!open) return -1;
    while (readdir(open)) count++;
    closedir(open);
    return count;
}

/* The resources that this process holds now. */
static Held held(void)
{
    struct mallinfo2 memory = mallinfo2();
    Held now = {memory.uordblks + memory.hblkhd, entries("/proc/self/fd"), entries("/proc/self/task")};
    return now;
}

static cairn_device *device;

/* One of each object that needs no world; each handle is used once. */
static void once(int i)
{
    cairn_device *own = NULL;
    cairn_anchor *anchors[2] = {NULL, NULL};
    cairn_guidance *guidance = NULL;
    cairn_presenter *presenter = NULL;
    cairn_script *script = NULL;
    cairn_recorder *recorder = NULL;
    cairn_device_options cpu = {.struct_size = sizeof cpu, .threads = 1, .flags = CAIRN_DEVICE_ENVIRONMENT};
    OK(cairn_device_create_cpu(&cpu, &own));
    cairn_device_info about = {.struct_size = sizeof about};
    OK(cairn_device_get_info(own, &about));
    static unsigned char pixels[8][8][4];
    cairn_picture picture = {.struct_size = sizeof picture, .width = 8, .height = 8, .pixels = pixels, .size = sizeof pixels};
    pixels[i % 8][3][1] = (unsigned char)i;
    for (int a = 0; a < 2; a++) OK(cairn_anchor_create(&picture, (uint64_t)a, 0, &anchors[a]));
    OK(cairn_guidance_create(anchors[0], anchors[1], CAIRN_MOTION_PICTURES, &guidance));
    cairn_presenter_options options = {.struct_size = sizeof options, .interval_ns = 1000};
    OK(cairn_presenter_create(&options, &presenter));
    OK(cairn_presenter_push(presenter, anchors[0], NULL, 0));
    OK(cairn_presenter_push(presenter, anchors[1], guidance, 1000));
    static unsigned char shown[8][8][4];
    cairn_target target = {.struct_size = sizeof target, .width = 8, .height = 8, .pixels = shown, .size = sizeof shown};
    OK(cairn_presenter_draw(presenter, 1500, &target, NULL));
    OK(cairn_recorder_create(&recorder));
    cairn_controls c = controls(i);
    OK(cairn_recorder_step(recorder, 1, 15, &c));
    OK(cairn_recorder_make_script(recorder, 1000000, &script));
    /* A refused call, whose message is stored. */
    ANSWERS(CAIRN_ERROR_INVALID_HANDLE, cairn_anchor_destroy((cairn_anchor *)script));
    OK(cairn_script_destroy(script));
    OK(cairn_recorder_destroy(recorder));
    OK(cairn_presenter_destroy(presenter));
    OK(cairn_guidance_destroy(guidance));
    OK(cairn_anchor_destroy(anchors[0]));
    OK(cairn_anchor_destroy(anchors[1]));
    OK(cairn_device_destroy(own));
}

/* A world, a rollout with direct and queued steps, and an anchor that outlives them. */
static void once_with_a_world(void)
{
    cairn_world *world = make_world(device);
    cairn_rollout *rollout = NULL;
    cairn_anchor *anchor = NULL;
    OK(cairn_rollout_create(world, NULL, &rollout));
    cairn_picture picture = seed_picture();
    cairn_controls c = controls(1);
    uint64_t ticket = 0;
    OK(cairn_rollout_append(rollout, &picture, NULL));
    OK(cairn_rollout_step(rollout, &c, NULL));
    OK(cairn_rollout_submit(rollout, &c, &ticket));
    OK(cairn_rollout_wait(rollout, ticket, CAIRN_FOREVER, NULL, &anchor));
    OK(cairn_rollout_submit(rollout, &c, &ticket)); /* left in flight */
    OK(cairn_world_destroy(world));
    OK(cairn_rollout_destroy(rollout));
    OK(cairn_anchor_destroy(anchor));
}

/* Whether the held resources are unchanged; `slack` is for what the C library and ONNX Runtime keep in reserve. */
static void same(Held before, Held after, size_t slack)
{
    CHECK(after.files == before.files);
    CHECK(after.threads == before.threads);
    CHECK(after.bytes <= before.bytes + slack);
    if (failed_checks) {
        fprintf(stderr, "%zu bytes, %d files, %d threads; before %zu, %d, %d\n", after.bytes, after.files, after.threads,
                before.bytes, before.files, before.threads);
    }
}

static void ten_thousand_cycles_without_a_world_leak_nothing(void)
{
    for (int i = 0; i < 100; i++) once(i);
    Held before = held();
    for (int i = 0; i < 10000 && !failed_checks; i++) once(i);
    /* Less than one and a half bytes per cycle. */
    same(before, held(), 16384);
}

static void twenty_cycles_with_a_world_leak_nothing(void)
{
    for (int i = 0; i < 3; i++) once_with_a_world();
    Held before = held();
    for (int i = 0; i < 20 && !failed_checks; i++) once_with_a_world();
    /* A hundredth of the memory of one world with a rollout. */
    cairn_world *world = make_world(device);
    cairn_world_memory memory = {.struct_size = sizeof memory};
    OK(cairn_world_get_memory(world, &memory));
    OK(cairn_world_destroy(world));
    same(before, held(), (size_t)(memory.total / 100));
}

/*
 * glibc's per-thread cache keeps freed blocks that `mallinfo2` still counts as used, as many as threads happened to
 * free them: without the cache only what is held is counted. It is read at the start of a process.
 */
static void without_thread_cache(char **argv)
{
    static const char tunable[] = "glibc.malloc.tcache_count=0";
    const char *set = getenv("GLIBC_TUNABLES");
    if (set && !strcmp(set, tunable)) return;
    setenv("GLIBC_TUNABLES", tunable, 1);
    execv("/proc/self/exe", argv);
}

int main(int argc, char **argv)
{
    (void)argc;
    without_thread_cache(argv);
    device = make_device();
    RUN(ten_thousand_cycles_without_a_world_leak_nothing);
    RUN(twenty_cycles_with_a_world_leak_nothing);
    OK(cairn_device_destroy(device));
    return failed_tests != 0;
}
