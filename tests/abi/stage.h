/* Objects of every kind, and valid arguments for each row of calls.h. */
#ifndef CAIRN_TEST_STAGE_H
#define CAIRN_TEST_STAGE_H

#include "calls.h"
#include "given.h"

#ifndef STATE_FILE
#define STATE_FILE "calls-state.bin"
#endif

static void *objects[OBJECTS];
/* Objects of Direct3D 12, where there is any. */
static struct given given;
#ifdef _WIN32
/* The device of worlds: loading them on Direct3D 12 takes long without a graphics card. */
static cairn_device *cpu;
#endif
static unsigned char *saved_state;
static size_t saved_size;

/* Memory for arguments that are pointers, one block for each. */
static union {
    unsigned char bytes[ROOM];
    uint64_t aligned;
} rooms[MOST_ARGUMENTS];
static unsigned char target_pixels[HEIGHT][WIDTH][4];

/* A job system that runs none of its jobs. */
static void ignore_jobs(void *user, uint32_t jobs, cairn_job job, void *data)
{
    (void)user, (void)jobs, (void)job, (void)data;
}

/* Fills a struct that the library reads with valid values. */
static void valid_struct(int number, void *to)
{
    static const uint16_t still[WIDTH * HEIGHT * 2];
    memset(to, 0, 4096);
    if (number == NUMBER_OF_cairn_thread_options) {
        *(cairn_thread_options *)to = (cairn_thread_options){.struct_size = sizeof(cairn_thread_options), .threads = 2};
    } else if (number == NUMBER_OF_cairn_scheduler) {
        *(cairn_scheduler *)to =
            (cairn_scheduler){.struct_size = sizeof(cairn_scheduler), .concurrency = 4, .run = ignore_jobs};
    } else if (number == NUMBER_OF_cairn_device_options) {
        *(cairn_device_options *)to = (cairn_device_options){.struct_size = sizeof(cairn_device_options), .threads = 2,
            .flags = CAIRN_DEVICE_ENVIRONMENT};
        ((cairn_device_options *)to)->onnxruntime = getenv("CAIRN_TEST_CALLS_ONNXRUNTIME");
    } else if (number == NUMBER_OF_cairn_world_options) {
        *(cairn_world_options *)to = (cairn_world_options){.struct_size = sizeof(cairn_world_options),
            .path = getenv("CAIRN_TEST_WORLD"), .operating_point = "stock,g16,native,pictures:1"};
    } else if (number == NUMBER_OF_cairn_rollout_options) {
        *(cairn_rollout_options *)to = (cairn_rollout_options){.struct_size = sizeof(cairn_rollout_options), .seed = 5};
    } else if (number == NUMBER_OF_cairn_picture) {
        *(cairn_picture *)to = seed_picture();
    } else if (number == NUMBER_OF_cairn_target) {
        *(cairn_target *)to = (cairn_target){.struct_size = sizeof(cairn_target), .width = WIDTH, .height = HEIGHT,
            .pixels = target_pixels, .size = sizeof target_pixels};
    } else if (number == NUMBER_OF_cairn_controls) {
        *(cairn_controls *)to = controls(1);
    } else if (number == NUMBER_OF_cairn_guidance_data) {
        *(cairn_guidance_data *)to = (cairn_guidance_data){.struct_size = sizeof(cairn_guidance_data), .width = WIDTH,
            .height = HEIGHT, .motion = still, .motion_count = WIDTH * HEIGHT * 2, .near_plane = 0.5f, .far_plane = 50,
            .vertical_fov = 1};
    } else if (number == NUMBER_OF_cairn_budget) {
        *(cairn_budget *)to = (cairn_budget){.struct_size = sizeof(cairn_budget), .frame_ns = 1000000000,
            .presenter = objects[PRESENTER]};
    } else if (number == NUMBER_OF_cairn_d3d12_options) {
        *(cairn_d3d12_options *)to = (cairn_d3d12_options){.struct_size = sizeof(cairn_d3d12_options), .captured_passes = 16};
    } else if (number == NUMBER_OF_cairn_d3d12_preparation) {
        *(cairn_d3d12_preparation *)to = (cairn_d3d12_preparation){.struct_size = sizeof(cairn_d3d12_preparation),
            .anchor_width = WIDTH, .anchor_height = HEIGHT};
    } else if (number == NUMBER_OF_cairn_d3d12_recording) {
        *(cairn_d3d12_recording *)to = (cairn_d3d12_recording){.struct_size = sizeof(cairn_d3d12_recording),
            .list = given.list ? given.list : to, .target = given.texture ? given.texture : to,
            .fence = given.fence ? given.fence : to, .fence_value = given.list ? given.fence_value : 1};
    } else if (number == NUMBER_OF_cairn_swapchain_options) {
        *(cairn_swapchain_options *)to = (cairn_swapchain_options){.struct_size = sizeof(cairn_swapchain_options),
            .max_render_width = WIDTH, .max_render_height = HEIGHT};
    } else if (number == NUMBER_OF_cairn_swapchain_frame) {
        *(cairn_swapchain_frame *)to = (cairn_swapchain_frame){.struct_size = sizeof(cairn_swapchain_frame),
            .depth = given.texture ? given.texture : to, .motion = given.texture ? given.texture : to, .render_width = WIDTH, .render_height = HEIGHT, .frame_time_ms = 16};
    } else if (number == NUMBER_OF_cairn_swapchain_pacing) {
        *(cairn_swapchain_pacing *)to = (cairn_swapchain_pacing){.struct_size = sizeof(cairn_swapchain_pacing)};
    } else {
        *(cairn_presenter_options *)to = (cairn_presenter_options){
            .struct_size = sizeof(cairn_presenter_options), .interval_ns = 66666667, .capacity = CAIRN_MAX_QUEUE};
    }
}

/* An anchor without a world. */
__attribute__((unused)) static cairn_anchor *create_anchor(uint64_t number)
{
    static unsigned char pixels[HEIGHT][WIDTH][4];
    cairn_picture picture = {
        .struct_size = sizeof picture, .width = WIDTH, .height = HEIGHT, .pixels = pixels, .size = sizeof pixels};
    cairn_anchor *anchor = NULL;
    OK(cairn_anchor_create(&picture, number, 0, &anchor));
    return anchor;
}

static void create_queue(void)
{
    cairn_controls c = controls(2);
    cairn_picture picture = seed_picture();
    cairn_rollout *queue = NULL;
    uint64_t ticket = 0;
    OK(cairn_rollout_create(objects[WORLD], NULL, &queue));
    OK(cairn_rollout_append(queue, &picture, NULL));
    OK(cairn_rollout_pause(queue));
    OK(cairn_rollout_submit(queue, &c, &ticket));
    objects[QUEUE] = queue;
}

static void create_objects_without_world(void)
{
    cairn_presenter_options options;
    uint64_t room[512];
    valid_struct(NUMBER_OF_cairn_presenter_options, room);
    memcpy(&options, room, sizeof options);
    OK(cairn_script_create(SCRIPT_TEXT, sizeof SCRIPT_TEXT - 1, (cairn_script **)&objects[SCRIPT]));
    OK(cairn_recorder_create((cairn_recorder **)&objects[RECORDER]));
    valid_struct(NUMBER_OF_cairn_guidance_data, room);
    OK(cairn_guidance_create_from_host((void *)room, (cairn_guidance **)&objects[GUIDANCE]));
    OK(cairn_presenter_create(&options, (cairn_presenter **)&objects[PRESENTER]));
    OK(cairn_presenter_push(objects[PRESENTER], objects[ANCHOR], NULL, 1000));
}

/* The device of rows: on Windows one of Direct3D 12. */
__attribute__((unused)) static cairn_device *create_device(void)
{
#ifdef _WIN32
    cairn_device_options options = {.struct_size = sizeof options, .flags = CAIRN_DEVICE_ENVIRONMENT,
        .onnxruntime = getenv("CAIRN_TEST_CALLS_ONNXRUNTIME")};
    cairn_device *device = NULL;
    if (!given.device) given_create(&given);
    OK(cairn_device_create_d3d12(given.device, given.queue, given.compute, &options, &device));
    return device;
#else
    return make_device();
#endif
}

/* Destroys the devices, after which no reference to the host's objects stays. */
__attribute__((unused)) static void destroy_devices(cairn_device *device)
{
    OK(cairn_device_destroy(device));
#ifdef _WIN32
    OK(cairn_device_destroy(cpu));
    cpu = NULL;
#endif
}

/* The device of worlds, beside `device`. */
static cairn_device *world_device(cairn_device *device)
{
#ifdef _WIN32
    if (getenv("CAIRN_TEST_DIRECTML")) return device;
    if (!cpu) {
        cairn_device_options options = {.struct_size = sizeof options, .threads = 2, .onnxruntime = getenv("CAIRN_TEST_CALLS_ONNXRUNTIME"),
            .flags = CAIRN_DEVICE_DETERMINISTIC | CAIRN_DEVICE_ENVIRONMENT};
        OK(cairn_device_create_cpu(&options, &cpu));
    }
    return cpu;
#else
    return device;
#endif
}

/* Creates all objects that do not exist yet. */
__attribute__((unused)) static void create_objects(cairn_device *device)
{
    objects[DEVICE] = device;
    if (!objects[WORLD]) objects[WORLD] = make_world(world_device(device));
    cairn_rollout *rollout = NULL;
    cairn_picture picture = seed_picture();
    OK(cairn_rollout_create(objects[WORLD], NULL, &rollout));
    OK(cairn_rollout_append(rollout, &picture, NULL));
    OK(cairn_rollout_get_anchor(rollout, (cairn_anchor **)&objects[ANCHOR]));
    OK(cairn_rollout_save(rollout, NULL, 0, &saved_size));
    saved_state = malloc(saved_size);
    OK(cairn_rollout_save(rollout, saved_state, saved_size, &saved_size));
    OK(cairn_rollout_save_file(rollout, STATE_FILE));
    objects[ROLLOUT] = rollout;
    create_queue();
    create_objects_without_world();
}

/* Destroys a handle of a kind. */
__attribute__((unused)) static cairn_result destroy_object(enum object kind, void *handle)
{
    switch (kind) {
    case DEVICE: return cairn_device_destroy(handle);
    case WORLD: return cairn_world_destroy(handle);
    case ANCHOR: return cairn_anchor_destroy(handle);
    case SCRIPT: return cairn_script_destroy(handle);
    case RECORDER: return cairn_recorder_destroy(handle);
    case GUIDANCE: return cairn_guidance_destroy(handle);
    case PRESENTER: return cairn_presenter_destroy(handle);
    case SWAPCHAIN: return cairn_swapchain_destroy(handle);
    default: return cairn_rollout_destroy(handle);
    }
}

__attribute__((unused)) static void destroy_objects(void)
{
    for (int i = 0; i < OBJECTS; i++) {
        OK(destroy_object((enum object)i, objects[i]));
        objects[i] = NULL;
    }
    free(saved_state);
    saved_state = NULL;
}

/* The kind of the handle that a row creates, by its name; OBJECTS for none. */
__attribute__((unused)) static enum object created_kind(const struct row *row)
{
    static const struct {
        const char *name;
        enum object kind;
    } makers[] = {
        {"cairn_device_create_cpu", DEVICE},      {"cairn_world_load", WORLD},
        {"cairn_device_create_d3d12", DEVICE},    {"cairn_device_create_adapter", DEVICE},
        {"cairn_device_create_gpu", DEVICE},
        {"cairn_device_create_auto", DEVICE},
        {"cairn_anchor_create", ANCHOR},          {"cairn_rollout_create", ROLLOUT},
        {"cairn_rollout_get_anchor", ANCHOR},     {"cairn_rollout_poll", ANCHOR},
        {"cairn_rollout_wait", ANCHOR},           {"cairn_guidance_create", GUIDANCE},
        {"cairn_guidance_create_from_host", GUIDANCE}, {"cairn_presenter_create", PRESENTER},
        {"cairn_script_create", SCRIPT},          {"cairn_recorder_create", RECORDER},
        {"cairn_recorder_make_script", SCRIPT},
    };
    for (size_t i = 0; i < sizeof makers / sizeof makers[0]; i++) {
        if (!strcmp(row->name, makers[i].name)) return makers[i].kind;
    }
    return OBJECTS;
}

/* An object of Direct3D 12 for an argument; null for null or memory. */
static void *given_argument(const struct row *row, int i)
{
    const struct {
        const char *name;
        int argument;
        void *object;
    } all[] = {
        {"cairn_device_create_d3d12", 0, given.device}, {"cairn_device_create_d3d12", 1, given.queue},
        {"cairn_device_create_d3d12", 2, given.compute}, {"cairn_rollout_append_d3d12", 1, given.texture},
        {"cairn_presenter_submit_d3d12", 3, given.texture}, {"cairn_swapchain_create", 2, given.factory},
        {"cairn_swapchain_create", 3, given.description}, {"cairn_swapchain_create_for_window", 2, given.factory},
        {"cairn_swapchain_create_for_window", 3, given.window},
        {"cairn_swapchain_create_for_window", 4, given.window_description},
        {"cairn_swapchain_prepare", 1, given.list}, {"cairn_swapchain_set_interface", 1, given.texture},
    };
    for (size_t at = 0; at < sizeof all / sizeof all[0]; at++) {
        if (!strcmp(row->name, all[at].name) && all[at].argument == i) return all[at].object;
    }
    return NULL;
}

/* Releases the references that a row's call has given, and ends its recording. */
__attribute__((unused)) static void release_given(const struct row *row, const struct argument *a, cairn_result r)
{
#ifdef _WIN32
    int submits = !strcmp(row->name, "cairn_presenter_submit_d3d12");
    for (int i = 0; i < row->count && r == CAIRN_OK; i++) {
        int is_object = strstr(row->name, "get_d3d12") || submits;
        if (row->shapes[i].kind != RESULT_ARGUMENT || !is_object || (strstr(row->name, "anchor") && i == 4)) continue;
        if (submits && i == 8) continue;
        void *object;
        memcpy(&object, a[i].pointer, sizeof object);
        if (submits) {
            uint64_t value;
            memcpy(&value, a[8].pointer, sizeof value);
            given_wait(object, value);
        }
        given_release(object);
    }
    if (!strcmp(row->name, "cairn_presenter_record_d3d12")) given_end_recordings(&given);
#else
    (void)row, (void)a, (void)r;
#endif
}

/* Valid arguments for the row; output memory is filled with `pattern` first. */
static void valid_arguments(const struct row *row, struct argument a[MOST_ARGUMENTS], int pattern)
{
    memset(a, 0, sizeof(struct argument) * MOST_ARGUMENTS);
    for (int i = 0; i < row->count; i++) {
        const struct shape *shape = &row->shapes[i];
        a[i].pointer = &rooms[i];
        if (given.device && row->shapes[i].kind == ROOM_ARGUMENT && row->shapes[i].align == 1 && is_for_windows(row->name)) {
            a[i].pointer = given_argument(row, i);
        }
        a[i].number = shape->kind == COUNT_ARGUMENT && shape->good == 0 ? saved_size : shape->good;
        a[i].real = 1;
        if (shape->kind == HANDLE_ARGUMENT) a[i].pointer = objects[shape->object];
        /* A schedule, or the name of a file. */
        if (shape->kind == TEXT_ARGUMENT) strcpy((char *)&rooms[i], strstr(row->name, "set_budget") ? "stock" : STATE_FILE);
        if (shape->kind == READ_ARGUMENT) valid_struct(shape->number, &rooms[i]);
        if (shape->kind == FILLED_ARGUMENT || shape->kind == RESULT_ARGUMENT || shape->kind == ROOM_ARGUMENT) {
            memset(&rooms[i], pattern, 8192);
        }
        if (shape->kind == FILLED_ARGUMENT) memcpy(&rooms[i], &shape->size, sizeof shape->size);
        if (shape->kind == BYTES_ARGUMENT) {
            memset(&rooms[i], pattern, 8192);
            if (strstr(row->name, "script_create")) memcpy(&rooms[i], SCRIPT_TEXT, sizeof SCRIPT_TEXT);
            if (a[i + 1].number == 0 && row->shapes[i + 1].good == 0) a[i].pointer = saved_state;
        }
    }
}

#endif
