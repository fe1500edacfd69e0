/* Arguments from a careless or hostile caller: invalid handles, null or misaligned pointers, structs of every size. */
#include <pthread.h>
#include <stdint.h>

#include "check.h"

static cairn_device *device;
static cairn_world *world;
static cairn_rollout *rollout;
static cairn_anchor *anchor;
static cairn_script *script;
static cairn_recorder *recorder;

/* Every call that takes a handle and accepts zeroes for all other arguments; `h` is the handle. */
typedef cairn_result (*handle_call)(void *h);

/* Memory for any struct and any array, with a struct_size that is valid for none. */
static uint64_t room[1024];

static cairn_result device_info(void *h) { return cairn_device_get_info(h, (void *)room); }
static cairn_result device_destroy(void *h) { return cairn_device_destroy(h); }
static cairn_result world_load(void *h) { return cairn_world_load(h, (void *)room, (void *)room); }
static cairn_result world_info(void *h) { return cairn_world_get_info(h, (void *)room); }
static cairn_result world_memory(void *h) { return cairn_world_get_memory(h, (void *)room); }
static cairn_result world_licence(void *h) { return cairn_world_get_licence(h, NULL, 0, (void *)room); }
static cairn_result world_destroy(void *h) { return cairn_world_destroy(h); }
static cairn_result rollout_create(void *h) { return cairn_rollout_create(h, NULL, (void *)room); }
static cairn_result rollout_info(void *h) { return cairn_rollout_get_info(h, (void *)room); }
static cairn_result rollout_append(void *h) { return cairn_rollout_append(h, (void *)room, NULL); }
static cairn_result rollout_step(void *h) { return cairn_rollout_step(h, (void *)room, NULL); }
static cairn_result rollout_reset(void *h) { return cairn_rollout_reset(h); }
static cairn_result rollout_anchor(void *h) { return cairn_rollout_get_anchor(h, (void *)room); }
static cairn_result rollout_poll(void *h) { return cairn_rollout_poll(h, 1, NULL, NULL); }
static cairn_result rollout_wait(void *h) { return cairn_rollout_wait(h, 1, 0, NULL, NULL); }
static cairn_result rollout_cancel(void *h) { return cairn_rollout_cancel(h); }
static cairn_result rollout_pause(void *h) { return cairn_rollout_pause(h); }
static cairn_result rollout_resume(void *h) { return cairn_rollout_resume(h); }
static cairn_result rollout_single(void *h) { return cairn_rollout_single_step(h); }
static cairn_result rollout_save(void *h) { return cairn_rollout_save(h, NULL, 0, (void *)room); }
static cairn_result rollout_save_file(void *h) { return cairn_rollout_save_file(h, "x"); }
static cairn_result rollout_restore(void *h) { return cairn_rollout_restore(h, room, 8); }
static cairn_result rollout_restore_file(void *h) { return cairn_rollout_restore_file(h, "x"); }
static cairn_result rollout_statistics(void *h) { return cairn_rollout_get_statistics(h, (void *)room); }
static cairn_result rollout_destroy(void *h) { return cairn_rollout_destroy(h); }
static cairn_result rollout_submit(void *h)
{
    cairn_controls c = controls(0);
    return cairn_rollout_submit(h, &c, room);
}
static cairn_result rollout_submit_picture(void *h)
{
    cairn_picture p = seed_picture();
    return cairn_rollout_submit_picture(h, &p, room);
}
static cairn_result anchor_info(void *h) { return cairn_anchor_get_info(h, (void *)room); }
static cairn_result anchor_picture(void *h) { return cairn_anchor_read_picture(h, 0, (void *)room); }
static cairn_result anchor_latent(void *h) { return cairn_anchor_read_latent(h, (void *)room, 1); }
static cairn_result anchor_destroy(void *h) { return cairn_anchor_destroy(h); }
static cairn_result script_controls(void *h) { return cairn_script_get_controls(h, 1, 15, (void *)room); }
static cairn_result script_duration(void *h) { return cairn_script_get_duration(h, room); }
static cairn_result script_text(void *h) { return cairn_script_get_text(h, NULL, 0, (void *)room); }
static cairn_result script_destroy(void *h) { return cairn_script_destroy(h); }
static cairn_result recorder_key(void *h) { return cairn_recorder_key(h, 0, 1, 1); }
static cairn_result recorder_mouse(void *h) { return cairn_recorder_mouse(h, 0, 1, 1); }
static cairn_result recorder_scroll(void *h) { return cairn_recorder_scroll(h, 0, 1); }
static cairn_result recorder_step(void *h) { return cairn_recorder_step(h, 1, 15, (void *)room); }
static cairn_result recorder_script(void *h) { return cairn_recorder_make_script(h, 0, (void *)room); }
static cairn_result recorder_destroy(void *h) { return cairn_recorder_destroy(h); }

/* Calls by the object that they take; the last of each destroys it. */
static const handle_call of_device[] = {device_info, world_load, device_destroy, NULL};
static const handle_call of_world[] = {world_info, world_memory, world_licence, rollout_create, world_destroy, NULL};
static const handle_call of_rollout[] = {
    rollout_info,   rollout_append,    rollout_step,    rollout_reset,        rollout_anchor, rollout_poll,
    rollout_wait,   rollout_cancel,    rollout_pause,   rollout_resume,       rollout_single, rollout_save,
    rollout_submit, rollout_save_file, rollout_restore, rollout_restore_file, rollout_statistics,
    rollout_submit_picture, rollout_destroy, NULL};
static const handle_call of_anchor[] = {anchor_info, anchor_picture, anchor_latent, anchor_destroy, NULL};
static const handle_call of_script[] = {script_controls, script_duration, script_text, script_destroy, NULL};
static const handle_call of_recorder[] = {recorder_key,    recorder_mouse,  recorder_scroll, recorder_step,
                                          recorder_script, recorder_destroy, NULL};
static const handle_call *const kinds[] = {of_device, of_world, of_rollout, of_anchor, of_script, of_recorder};
enum { KINDS = sizeof kinds / sizeof kinds[0] };

static void *living(int kind)
{
    void *const all[] = {device, world, rollout, anchor, script, recorder};
    return all[kind];
}

static void make_all(void)
{
    device = make_device();
    world = make_world(device);
    cairn_picture picture = seed_picture();
    OK(cairn_rollout_create(world, NULL, &rollout));
    OK(cairn_rollout_append(rollout, &picture, NULL));
    OK(cairn_rollout_get_anchor(rollout, &anchor));
    static const char text[] = "cairn-controls 1\n0..1 hold W\n";
    OK(cairn_script_create(text, sizeof text - 1, &script));
    OK(cairn_recorder_create(&recorder));
}

static void destroy_all(void)
{
    OK(cairn_device_destroy(device));
    OK(cairn_world_destroy(world));
    OK(cairn_rollout_destroy(rollout));
    OK(cairn_anchor_destroy(anchor));
    OK(cairn_script_destroy(script));
    OK(cairn_recorder_destroy(recorder));
}

/* Every call returns CAIRN_ERROR_INVALID_HANDLE for `h`, except that destroying null succeeds. */
static void refused(int kind, void *h)
{
    for (const handle_call *call = kinds[kind]; *call; call++) {
        room[0] = 0;
        int destroys = call[1] == NULL;
        ANSWERS(h == NULL && destroys ? CAIRN_OK : CAIRN_ERROR_INVALID_HANDLE, (*call)(h));
    }
}

static void invalid_handles_are_refused_everywhere(void)
{
    make_all();
    static int foreign;
    for (int kind = 0; kind < KINDS; kind++) {
        refused(kind, NULL);
        refused(kind, &foreign);
        refused(kind, room);
        refused(kind, (void *)(uintptr_t)1);
        refused(kind, (void *)UINTPTR_MAX);
        for (int other = 0; other < KINDS; other++) {
            if (other != kind) refused(kind, living(other));
        }
        for (int bit = 0; bit < 64; bit++) {
            refused(kind, (void *)((uintptr_t)living(kind) ^ (uintptr_t)1 << bit));
        }
    }
    void *stale[KINDS];
    for (int kind = 0; kind < KINDS; kind++) stale[kind] = living(kind);
    destroy_all();
    for (int kind = 0; kind < KINDS; kind++) refused(kind, stale[kind]);
    make_all();
    for (int kind = 0; kind < KINDS; kind++) refused(kind, stale[kind]);
    destroy_all();
}

static void a_hundred_thousand_random_handles_are_refused(void)
{
    make_all();
    uint64_t state = 88172645463325252ull;
    for (int i = 0; i < 100000; i++) {
        state ^= state << 13, state ^= state >> 7, state ^= state << 17;
        int kind = (int)(state % KINDS);
        /* The right kind and a slot that may exist. */
        uint64_t guess = ((uintptr_t)living(kind) & 0xff00000000000000ull) | (state >> 16 & 0xffffffff) << 24 | (state & 7);
        if ((void *)(uintptr_t)guess == living(kind)) continue;
        room[0] = 0;
        ANSWERS(CAIRN_ERROR_INVALID_HANDLE, kinds[kind][0]((void *)(uintptr_t)guess));
    }
    destroy_all();
}

/* Every call that takes a struct, with all other arguments valid; `s` is the struct. */
typedef cairn_result (*struct_call)(void *s);

/* ONNX Runtime is found here only with this flag. Nothing is written into a struct that is too small or invalid. */
static void let_the_environment_name_libraries(void *s)
{
    if (s && (uintptr_t)s % _Alignof(cairn_device_options) == 0 && *(uint32_t *)s >= 32) {
        ((cairn_device_options *)s)->flags = CAIRN_DEVICE_ENVIRONMENT;
    }
}

static cairn_result in_device_options(void *s)
{
    cairn_device *made = NULL;
    let_the_environment_name_libraries(s);
    cairn_result r = cairn_device_create_cpu(s, &made);
    cairn_device_destroy(made);
    return r;
}
static cairn_result in_requirements(void *s)
{
    uint32_t count;
    return cairn_device_requirements(CAIRN_DEVICE_CPU, s, NULL, 0, 0, &count);
}
static cairn_result in_rollout_options(void *s)
{
    cairn_rollout *made = NULL;
    cairn_result r = cairn_rollout_create(world, s, &made);
    cairn_rollout_destroy(made);
    return r;
}
static cairn_result in_step(void *s) { return cairn_rollout_step(rollout, s, NULL); }
static cairn_result in_step_info(void *s)
{
    cairn_controls c = controls(0);
    return cairn_rollout_step(rollout, &c, s);
}
static cairn_result in_submit(void *s)
{
    uint64_t ticket = 0;
    cairn_result r = cairn_rollout_submit(rollout, s, &ticket);
    if (r == CAIRN_OK) OK(cairn_rollout_wait(rollout, ticket, CAIRN_FOREVER, NULL, NULL));
    return r;
}
static cairn_result in_recorder_step(void *s)
{
    static uint64_t latent;
    return cairn_recorder_step(recorder, ++latent, 15, s);
}

struct sized {
    const char *name;
    struct_call call;
    uint32_t size, align;
    /* Whether the call succeeds if all bytes after struct_size are zero. */
    int zeroes_work;
    /* Its sizes in earlier headers, 0 if it has not grown. */
    uint32_t earlier[2];
};

static const struct sized sized[] = {
    {"cairn_device_options", in_device_options, sizeof(cairn_device_options), _Alignof(cairn_device_options), 1, {32, 0}},
    {"requirements", in_requirements, sizeof(cairn_device_options), _Alignof(cairn_device_options), 1, {32, 0}},
    {"cairn_device_info", NULL, sizeof(cairn_device_info), _Alignof(cairn_device_info), 1, {144, 0}},
    {"cairn_world_info", NULL, sizeof(cairn_world_info), _Alignof(cairn_world_info), 1, {336, 0}},
    {"cairn_world_memory", NULL, sizeof(cairn_world_memory), _Alignof(cairn_world_memory), 1, {0, 0}},
    {"cairn_rollout_options", in_rollout_options, sizeof(cairn_rollout_options), _Alignof(cairn_rollout_options), 1, {0, 0}},
    {"cairn_rollout_info", NULL, sizeof(cairn_rollout_info), _Alignof(cairn_rollout_info), 1, {0, 0}},
    {"cairn_rollout_statistics", NULL, sizeof(cairn_rollout_statistics), _Alignof(cairn_rollout_statistics), 1, {120, 216}},
    {"cairn_controls", in_step, sizeof(cairn_controls), _Alignof(cairn_controls), 1, {0, 0}},
    {"submit", in_submit, sizeof(cairn_controls), _Alignof(cairn_controls), 1, {0, 0}},
    {"recorder_step", in_recorder_step, sizeof(cairn_controls), _Alignof(cairn_controls), 1, {0, 0}},
    {"script_controls", NULL, sizeof(cairn_controls), _Alignof(cairn_controls), 1, {0, 0}},
    {"cairn_step_info", in_step_info, sizeof(cairn_step_info), _Alignof(cairn_step_info), 1, {0, 0}},
    {"cairn_anchor_info", NULL, sizeof(cairn_anchor_info), _Alignof(cairn_anchor_info), 1, {0, 0}},
    {"cairn_picture", NULL, sizeof(cairn_picture), _Alignof(cairn_picture), 0, {0, 0}},
    {"cairn_target", NULL, sizeof(cairn_target), _Alignof(cairn_target), 0, {0, 0}},
    {"cairn_world_options", NULL, sizeof(cairn_world_options), _Alignof(cairn_world_options), 0, {48, 56}},
};

static cairn_result call_sized(const struct sized *one, void *s)
{
    if (one->call) return one->call(s);
    if (!strcmp(one->name, "cairn_device_info")) return cairn_device_get_info(device, s);
    if (!strcmp(one->name, "cairn_world_info")) return cairn_world_get_info(world, s);
    if (!strcmp(one->name, "cairn_world_memory")) return cairn_world_get_memory(world, s);
    if (!strcmp(one->name, "cairn_rollout_info")) return cairn_rollout_get_info(rollout, s);
    if (!strcmp(one->name, "cairn_rollout_statistics")) return cairn_rollout_get_statistics(rollout, s);
    if (!strcmp(one->name, "script_controls")) return cairn_script_get_controls(script, 1, 15, s);
    if (!strcmp(one->name, "cairn_anchor_info")) return cairn_anchor_get_info(anchor, s);
    if (!strcmp(one->name, "cairn_picture")) return cairn_rollout_append(rollout, s, NULL);
    if (!strcmp(one->name, "cairn_target")) return cairn_anchor_read_picture(anchor, 0, s);
    cairn_world *loaded = NULL;
    return cairn_world_load(device, s, &loaded);
}

static void structs_of_every_size_are_checked(void)
{
    make_all();
    for (size_t i = 0; i < sizeof sized / sizeof sized[0]; i++) {
        const struct sized *one = &sized[i];
        for (uint32_t size = 0; size < 4200; size += size < 300 ? 1 : 97) {
            memset(room, 0, sizeof room);
            memcpy(room, &size, sizeof size);
            int newer = size > one->size && size <= 4096 && size % one->align == 0;
            int grown = size != 0 && (size == one->earlier[0] || size == one->earlier[1]);
            int right = size == one->size || grown || newer;
            cairn_result r = call_sized(one, room);
            if (right ? (one->zeroes_work ? r != CAIRN_OK : r == CAIRN_ERROR_STRUCT_SIZE) : r != CAIRN_ERROR_STRUCT_SIZE) {
                fprintf(stderr, "%s of %u bytes: %s (%s)\n", one->name, size, cairn_result_name(r), message());
                CHECK(!"the answer fits the size");
            }
            /* The caller's size stays, and nothing is written beyond the struct. */
            uint32_t now;
            memcpy(&now, room, sizeof now);
            CHECK(now == size);
            for (size_t at = size < 4 ? 4 : size; at < sizeof room; at++) {
                if (((unsigned char *)room)[at]) {
                    CHECK(!"nothing is written behind the struct");
                    break;
                }
            }
        }
        uint32_t absurd[] = {UINT32_MAX, 0x80000000u, 0x7fffffffu, 65536};
        for (int a = 0; a < 4; a++) {
            memset(room, 0, sizeof room);
            memcpy(room, &absurd[a], 4);
            ANSWERS(CAIRN_ERROR_STRUCT_SIZE, call_sized(one, room));
        }
        for (size_t off = 1; off < one->align; off++) {
            memset(room, 0, sizeof room);
            memcpy((char *)room + off, &one->size, 4);
            ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, call_sized(one, (char *)room + off));
        }
    }
    destroy_all();
}

static void fields_of_a_newer_host_are_not_ignored(void)
{
    make_all();
    struct {
        cairn_controls c;
        uint64_t newer[4];
    } longer = {.c = controls(1)};
    longer.c.struct_size = sizeof longer;
    OK(cairn_rollout_step(rollout, &longer.c, NULL));
    for (int i = 0; i < 4; i++) {
        longer.newer[i] = 1ull << (i * 16);
        ANSWERS(CAIRN_ERROR_STRUCT_SIZE, cairn_rollout_step(rollout, &longer.c, NULL));
        longer.newer[i] = 0;
    }
    destroy_all();
}

static void null_and_misaligned_results_are_refused(void)
{
    make_all();
    void *odd = (char *)room + 1;
    cairn_controls c = controls(0);
    cairn_picture picture = seed_picture();
    void *const wrong[] = {NULL, odd};
    for (int i = 0; i < 2; i++) {
        ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_device_create_cpu(NULL, wrong[i]));
        ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_rollout_create(world, NULL, wrong[i]));
        ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_rollout_get_anchor(rollout, wrong[i]));
        ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_rollout_submit(rollout, &c, wrong[i]));
        ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_rollout_submit_picture(rollout, &picture, wrong[i]));
        ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_rollout_save(rollout, NULL, 0, wrong[i]));
        ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_anchor_create(&picture, 0, 0, wrong[i]));
        ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_anchor_read_latent(anchor, wrong[i], 128));
        ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_script_create("x", 1, wrong[i]));
        ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_script_get_duration(script, wrong[i]));
        ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_recorder_create(wrong[i]));
        ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_recorder_make_script(recorder, 0, wrong[i]));
        ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_adapters(NULL, 0, 0, wrong[i]));
    }
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_rollout_restore(rollout, NULL, 8));
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_rollout_restore(rollout, room, SIZE_MAX));
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_rollout_save(rollout, NULL, 8, (size_t *)room));
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_rollout_save_file(rollout, NULL));
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_rollout_save_file(rollout, "\xff"));
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_rollout_save_file(rollout, ".."));
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_rollout_restore_file(rollout, "a\x80"));
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_world_get_licence(world, NULL, 5, NULL));
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_script_get_text(script, NULL, 5, NULL));
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_script_create(NULL, 5, &script));
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_anchor_create(&picture, 0, 2, &anchor));
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_rollout_poll(rollout, 0, NULL, NULL));
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_rollout_poll(rollout, UINT64_MAX, NULL, NULL));
    cairn_rollout_options options = {.struct_size = sizeof options, .queue_capacity = CAIRN_MAX_QUEUE + 1};
    cairn_rollout *none = NULL;
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_rollout_create(world, &options, &none));
    options.queue_capacity = 0;
    options.operating_point = "stock,g64";
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_rollout_create(world, &options, &none));
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_recorder_key(recorder, 0, 256, 1));
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_recorder_key(recorder, 0, 1, 2));
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_recorder_mouse(recorder, 0, 0.0f / 0.0f, 0));
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_script_get_controls(script, 1, 0, &c));
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_script_get_controls(script, 1, 241, &c));
    destroy_all();
}

/* Threads that call, create and destroy at random: nothing breaks, and every result is one that the header names. */
static void *call_randomly(void *argument)
{
    uint64_t state = (uintptr_t)argument * 2654435761u + 1;
    for (int i = 0; i < 3000; i++) {
        state ^= state << 13, state ^= state >> 7, state ^= state << 17;
        int kind = (int)(state % KINDS), n = 0;
        while (kinds[kind][n + 1]) n++;
        /* Neither slow calls nor calls that write into the shared memory. */
        handle_call call = kinds[kind][(state >> 8) % (uint64_t)n];
        if (call == rollout_cancel || call == rollout_pause || call == rollout_resume || call == rollout_single ||
            call == rollout_poll || call == rollout_reset || call == recorder_key || call == recorder_mouse ||
            call == recorder_scroll) {
            cairn_result r = call(living(kind));
            CHECK(r == CAIRN_OK || r == CAIRN_NOT_READY || r == CAIRN_ERROR_BUSY || r == CAIRN_ERROR_INVALID_ARGUMENT);
        }
        cairn_anchor *taken = NULL;
        cairn_result r = cairn_rollout_get_anchor(rollout, &taken);
        CHECK(r == CAIRN_OK || r == CAIRN_ERROR_BUSY || r == CAIRN_ERROR_INVALID_ARGUMENT);
        OK(cairn_anchor_destroy(taken));
    }
    return NULL;
}

static void random_calls_from_many_threads_break_nothing(void)
{
    make_all();
    pthread_t threads[4];
    for (uintptr_t i = 0; i < 4; i++) CHECK(pthread_create(&threads[i], NULL, call_randomly, (void *)(i + 1)) == 0);
    for (int i = 0; i < 4; i++) pthread_join(threads[i], NULL);
    destroy_all();
}

int main(void)
{
    RUN(invalid_handles_are_refused_everywhere);
    RUN(a_hundred_thousand_random_handles_are_refused);
    RUN(structs_of_every_size_are_checked);
    RUN(fields_of_a_newer_host_are_not_ignored);
    RUN(null_and_misaligned_results_are_refused);
    RUN(random_calls_from_many_threads_break_nothing);
    return failed_tests != 0;
}
