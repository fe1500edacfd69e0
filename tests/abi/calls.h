/* Every function of the header that can return an error, described by its arguments, so that programs can call all of them with any
   arguments. `cargo xtask test abi` fails when a function of the header has no row here. */
#ifndef CAIRN_TEST_CALLS_H
#define CAIRN_TEST_CALLS_H

#include <stdint.h>

#include "check.h"

/* Objects that rows are called with: one of each kind of handle, and QUEUE, a paused rollout with a queued step. SWAPCHAIN is for
   Windows and has no object, so its rows fail with CAIRN_ERROR_INVALID_HANDLE once all other arguments are valid. */
enum object { DEVICE, WORLD, ROLLOUT, ANCHOR, SCRIPT, RECORDER, GUIDANCE, PRESENTER, SWAPCHAIN, KINDS, QUEUE = KINDS, OBJECTS };

/* The structs that the library reads. */
#define READ_STRUCTS(X)                                                                                               \
    X(cairn_thread_options) X(cairn_scheduler)                                                                        \
    X(cairn_device_options) X(cairn_world_options) X(cairn_rollout_options) X(cairn_picture) X(cairn_target)          \
    X(cairn_controls) X(cairn_guidance_data) X(cairn_presenter_options) X(cairn_d3d12_options)     \
    X(cairn_d3d12_preparation) X(cairn_d3d12_recording)                                                               \
    X(cairn_budget)                                                                                                   \
    X(cairn_swapchain_options) X(cairn_swapchain_frame) X(cairn_swapchain_pacing)
#define NUMBERED(name) NUMBER_OF_##name,
enum { READ_STRUCTS(NUMBERED) READ_STRUCT_COUNT };

enum kind {
    HANDLE_ARGUMENT, /* of kind `object`; `alone` if the call needs exclusive use */
    READ_ARGUMENT,   /* a struct that the library reads */
    FILLED_ARGUMENT, /* a struct that the library fills */
    RESULT_ARGUMENT, /* an output pointer for a handle or a number */
    TEXT_ARGUMENT,   /* a path or a name that ends in a NUL */
    BYTES_ARGUMENT,  /* memory; the next argument is its number of elements */
    ROOM_ARGUMENT,   /* the same, with any count allowed */
    COUNT_ARGUMENT,  /* only `good` is valid; if that is 0, the size of the saved state */
    NUMBER_ARGUMENT, /* any number */
    CHOICE_ARGUMENT, /* a 32-bit number from `least` to `most` */
    REAL_ARGUMENT,   /* a finite number */
    NONE_ARGUMENT    /* a callback; null */
};

struct shape {
    enum kind kind;
    int object, alone, or_null, number;
    uint32_t size, align;
    uint64_t good, least, most;
};

struct argument {
    void *pointer;
    uint64_t number;
    float real;
};

enum { MOST_ARGUMENTS = 9, ROOM = 1 << 17 };

struct row {
    const char *name;
    cairn_result (*call)(const struct argument *a);
    int count;
    struct shape shapes[MOST_ARGUMENTS];
};

/* Kinds of arguments, and the member of `struct argument` that each uses. */
#define SHAPE_SHARED(o) {.kind = HANDLE_ARGUMENT, .object = o}
#define SHAPE_SHARED_OR_NULL(o) {.kind = HANDLE_ARGUMENT, .object = o, .or_null = 1}
#define SHAPE_ALONE(o) {.kind = HANDLE_ARGUMENT, .object = o, .alone = 1}
#define SHAPE_READ(s) {.kind = READ_ARGUMENT, .number = NUMBER_OF_##s, .size = sizeof(s), .align = _Alignof(s)}
#define SHAPE_READ_OR_NULL(s) \
    {.kind = READ_ARGUMENT, .number = NUMBER_OF_##s, .size = sizeof(s), .align = _Alignof(s), .or_null = 1}
#define SHAPE_FILLED(s) {.kind = FILLED_ARGUMENT, .size = sizeof(s), .align = _Alignof(s)}
#define SHAPE_FILLED_OR_NULL(s) {.kind = FILLED_ARGUMENT, .size = sizeof(s), .align = _Alignof(s), .or_null = 1}
#define SHAPE_RESULT(t) {.kind = RESULT_ARGUMENT, .size = sizeof(t), .align = _Alignof(t)}
#define SHAPE_RESULT_OR_NULL(t) {.kind = RESULT_ARGUMENT, .size = sizeof(t), .align = _Alignof(t), .or_null = 1}
#define SHAPE_TEXT {.kind = TEXT_ARGUMENT}
#define SHAPE_TEXT_OR_NULL {.kind = TEXT_ARGUMENT, .or_null = 1}
#define SHAPE_BYTES(t) {.kind = BYTES_ARGUMENT, .size = sizeof(t), .align = _Alignof(t)}
#define SHAPE_ARRAY(s) {.kind = ROOM_ARGUMENT, .align = _Alignof(s)}
#define SHAPE_ROOM {.kind = ROOM_ARGUMENT, .align = 1}
#define SHAPE_GIVEN {.kind = ROOM_ARGUMENT, .align = 1} /* an object of another library */
#define SHAPE_GIVEN_OR_NULL {.kind = ROOM_ARGUMENT, .align = 1, .or_null = 1}
#define SHAPE_COUNT(n) {.kind = COUNT_ARGUMENT, .good = n}
#define SHAPE_NUMBER(n) {.kind = NUMBER_ARGUMENT, .good = n}
#define SHAPE_CHOICE(from, to) {.kind = CHOICE_ARGUMENT, .good = from, .least = from, .most = to}
#define SHAPE_REAL {.kind = REAL_ARGUMENT}
#define SHAPE_NONE {.kind = NONE_ARGUMENT}
#define AS_SHARED(o) POINTER
#define AS_SHARED_OR_NULL(o) POINTER
#define AS_ALONE(o) POINTER
#define AS_READ(s) POINTER
#define AS_READ_OR_NULL(s) POINTER
#define AS_FILLED(s) POINTER
#define AS_FILLED_OR_NULL(s) POINTER
#define AS_RESULT(t) POINTER
#define AS_RESULT_OR_NULL(t) POINTER
#define AS_TEXT POINTER
#define AS_TEXT_OR_NULL POINTER
#define AS_BYTES(t) POINTER
#define AS_ARRAY(s) POINTER
#define AS_ROOM POINTER
#define AS_GIVEN POINTER
#define AS_GIVEN_OR_NULL POINTER
#define AS_COUNT(n) WHOLE
#define AS_NUMBER(n) WHOLE
#define AS_CHOICE(from, to) WHOLE
#define AS_REAL FLOATING
#define AS_NONE NOTHING
#define POINTER(a) (a).pointer
#define WHOLE(a) (a).number
#define FLOATING(a) (a).real
#define NOTHING(a) NULL

#define CALLS(C1, C2, C3, C4, C5, C6, C7, C8, C9)                                                                         \
    C3(cairn_last_error, ROOM, NUMBER(64), RESULT_OR_NULL(size_t))                                                    \
    C4(cairn_last_error_part, CHOICE(1, 4), ROOM, NUMBER(64), RESULT_OR_NULL(size_t))                                 \
    C3(cairn_set_log_callback, CHOICE(0, 5), NONE, NONE)                                                              \
    C1(cairn_set_threads, READ_OR_NULL(cairn_thread_options))                                                         \
    C1(cairn_set_scheduler, READ_OR_NULL(cairn_scheduler))                                                            \
    C2(cairn_device_create_cpu, READ_OR_NULL(cairn_device_options), RESULT(cairn_device *))                           \
    C2(cairn_device_get_info, SHARED(DEVICE), FILLED(cairn_device_info))                                              \
    C1(cairn_device_destroy, SHARED(DEVICE))                                                                          \
    C4(cairn_adapters, ARRAY(cairn_adapter), COUNT(sizeof(cairn_adapter)), NUMBER(2), RESULT(uint32_t))               \
    C6(cairn_device_requirements, CHOICE(1, 3), READ_OR_NULL(cairn_device_options), ARRAY(cairn_requirement),         \
       COUNT(sizeof(cairn_requirement)), NUMBER(4), RESULT(uint32_t))                                                 \
    C3(cairn_world_load, SHARED(DEVICE), READ(cairn_world_options), RESULT(cairn_world *))                            \
    C2(cairn_world_get_info, SHARED(WORLD), FILLED(cairn_world_info))                                                 \
    C2(cairn_world_get_memory, SHARED(WORLD), FILLED(cairn_world_memory))                                             \
    C4(cairn_world_get_licence, SHARED(WORLD), ROOM, NUMBER(64), RESULT_OR_NULL(size_t))                              \
    C1(cairn_world_destroy, SHARED(WORLD))                                                                            \
    C4(cairn_anchor_create, READ(cairn_picture), NUMBER(1), CHOICE(0, 1), RESULT(cairn_anchor *))                     \
    C2(cairn_anchor_get_info, SHARED(ANCHOR), FILLED(cairn_anchor_info))                                              \
    C3(cairn_anchor_read_picture, SHARED(ANCHOR), CHOICE(0, 0), READ(cairn_target))                                   \
    C3(cairn_anchor_read_latent, SHARED(ANCHOR), BYTES(float), COUNT(4 * 4 * 8))                                      \
    C1(cairn_anchor_destroy, SHARED(ANCHOR))                                                                          \
    C3(cairn_rollout_create, SHARED(WORLD), READ_OR_NULL(cairn_rollout_options), RESULT(cairn_rollout *))             \
    C1(cairn_rollout_destroy, SHARED(ROLLOUT))                                                                        \
    C2(cairn_rollout_get_info, SHARED(ROLLOUT), FILLED(cairn_rollout_info))                                           \
    C3(cairn_rollout_append, ALONE(ROLLOUT), READ(cairn_picture), FILLED_OR_NULL(cairn_step_info))                    \
    C4(cairn_rollout_append_pictures, ALONE(ROLLOUT), READ(cairn_picture), CHOICE(1, 1),                              \
       FILLED_OR_NULL(cairn_step_info))                                                                               \
    C2(cairn_rollout_keep_encoder_stream, ALONE(ROLLOUT), CHOICE(0, 1))                                               \
    C1(cairn_rollout_rest, ALONE(ROLLOUT))                                                                            \
    C3(cairn_rollout_step, ALONE(ROLLOUT), READ(cairn_controls), FILLED_OR_NULL(cairn_step_info))                     \
    C3(cairn_rollout_set_budget, ALONE(ROLLOUT), NUMBER(100000000), TEXT)                                             \
    C2(cairn_rollout_govern, ALONE(ROLLOUT), READ_OR_NULL(cairn_budget))                                              \
    C1(cairn_rollout_reset, ALONE(ROLLOUT))                                                                           \
    C2(cairn_rollout_get_anchor, SHARED(ROLLOUT), RESULT(cairn_anchor *))                                             \
    C3(cairn_rollout_submit, SHARED(QUEUE), READ(cairn_controls), RESULT(uint64_t))                                   \
    C3(cairn_rollout_submit_picture, SHARED(QUEUE), READ(cairn_picture), RESULT(uint64_t))                            \
    C4(cairn_rollout_submit_pictures, SHARED(QUEUE), READ(cairn_picture), CHOICE(1, 1), RESULT(uint64_t))             \
    C4(cairn_rollout_poll, SHARED(QUEUE), NUMBER(1), FILLED_OR_NULL(cairn_step_info), RESULT_OR_NULL(cairn_anchor *)) \
    C5(cairn_rollout_wait, SHARED(QUEUE), NUMBER(1), NUMBER(1000), FILLED_OR_NULL(cairn_step_info),                   \
       RESULT_OR_NULL(cairn_anchor *))                                                                                \
    C1(cairn_rollout_cancel, SHARED(QUEUE))                                                                           \
    C1(cairn_rollout_pause, SHARED(QUEUE))                                                                            \
    C1(cairn_rollout_resume, SHARED(QUEUE))                                                                           \
    C1(cairn_rollout_single_step, SHARED(QUEUE))                                                                      \
    C4(cairn_rollout_save, SHARED(ROLLOUT), BYTES(char), COUNT(0), RESULT(size_t))                                    \
    C2(cairn_rollout_save_file, SHARED(ROLLOUT), TEXT)                                                                \
    C3(cairn_rollout_restore, ALONE(ROLLOUT), BYTES(char), COUNT(0))                                                  \
    C2(cairn_rollout_restore_file, ALONE(ROLLOUT), TEXT)                                                              \
    C4(cairn_guidance_create, SHARED(ANCHOR), SHARED(ANCHOR), CHOICE(0, 3), RESULT(cairn_guidance *))                 \
    C2(cairn_guidance_create_from_host, READ(cairn_guidance_data), RESULT(cairn_guidance *))                          \
    C2(cairn_guidance_get_info, SHARED(GUIDANCE), FILLED(cairn_guidance_info))                                        \
    C3(cairn_guidance_read_motion, SHARED(GUIDANCE), BYTES(uint16_t), COUNT(WIDTH * HEIGHT * 2))                      \
    C3(cairn_guidance_read_depth, SHARED(GUIDANCE), BYTES(float), COUNT(WIDTH * HEIGHT))                              \
    C1(cairn_guidance_destroy, SHARED(GUIDANCE))                                                                      \
    C2(cairn_presenter_create, READ_OR_NULL(cairn_presenter_options), RESULT(cairn_presenter *))                      \
    C4(cairn_presenter_push, SHARED(PRESENTER), SHARED(ANCHOR), SHARED_OR_NULL(GUIDANCE), NUMBER(100000000))          \
    C3(cairn_presenter_query, SHARED(PRESENTER), NUMBER(100000000), FILLED(cairn_frame))                              \
    C4(cairn_presenter_draw, ALONE(PRESENTER), NUMBER(100000000), READ(cairn_target), FILLED_OR_NULL(cairn_frame))    \
    C3(cairn_presenter_resize, SHARED(PRESENTER), CHOICE(0, 16384), CHOICE(0, 16384))                                 \
    C5(cairn_presenter_set_overlay, SHARED(PRESENTER), BYTES(uint8_t), COUNT(WIDTH * HEIGHT), NUMBER(WIDTH),          \
       NUMBER(HEIGHT))                                                                                                \
    C2(cairn_presenter_set_budget, SHARED(PRESENTER), NUMBER(4000000))                                                \
    C1(cairn_presenter_reset, SHARED(PRESENTER))                                                                      \
    C2(cairn_presenter_get_statistics, SHARED(PRESENTER), FILLED(cairn_presenter_statistics))                         \
    C1(cairn_presenter_destroy, SHARED(PRESENTER))                                                                    \
    C3(cairn_script_create, BYTES(char), COUNT(sizeof SCRIPT_TEXT - 1), RESULT(cairn_script *))                       \
    C4(cairn_script_get_controls, SHARED(SCRIPT), NUMBER(1), CHOICE(1, 240), FILLED(cairn_controls))                  \
    C2(cairn_script_get_duration, SHARED(SCRIPT), RESULT(uint64_t))                                                   \
    C4(cairn_script_get_text, SHARED(SCRIPT), ROOM, NUMBER(64), RESULT_OR_NULL(size_t))                               \
    C1(cairn_script_destroy, SHARED(SCRIPT))                                                                          \
    C1(cairn_recorder_create, RESULT(cairn_recorder *))                                                               \
    C4(cairn_recorder_key, ALONE(RECORDER), NUMBER(1000), CHOICE(1, 255), CHOICE(0, 1))                               \
    C4(cairn_recorder_mouse, ALONE(RECORDER), NUMBER(1000), REAL, REAL)                                               \
    C3(cairn_recorder_scroll, ALONE(RECORDER), NUMBER(1000), NUMBER(1))                                               \
    C4(cairn_recorder_step, ALONE(RECORDER), NUMBER(1), CHOICE(15, 240), READ(cairn_controls))                        \
    C3(cairn_recorder_make_script, ALONE(RECORDER), NUMBER(100000000), RESULT(cairn_script *))                        \
    C1(cairn_recorder_destroy, SHARED(RECORDER))                                                                      \
    C2(cairn_rollout_get_statistics, SHARED(ROLLOUT), FILLED(cairn_rollout_statistics))                               \
    C5(cairn_device_create_d3d12, GIVEN, GIVEN, GIVEN_OR_NULL, READ_OR_NULL(cairn_device_options),                    \
       RESULT(cairn_device *))                                                                                        \
    C3(cairn_device_create_adapter, NUMBER(1), READ_OR_NULL(cairn_device_options), RESULT(cairn_device *))            \
    C3(cairn_device_create_gpu, TEXT_OR_NULL, READ_OR_NULL(cairn_device_options), RESULT(cairn_device *))             \
    C5(cairn_device_create_auto, READ_OR_NULL(cairn_device_options), ROOM, NUMBER(64), RESULT_OR_NULL(size_t),        \
       RESULT(cairn_device *))                                                                                        \
    C2(cairn_device_set_d3d12, SHARED(DEVICE), READ(cairn_d3d12_options))                                             \
    C3(cairn_device_get_d3d12, SHARED(DEVICE), RESULT(void *), RESULT(void *))                                        \
    C4(cairn_rollout_append_d3d12, ALONE(ROLLOUT), GIVEN, NUMBER(0), FILLED_OR_NULL(cairn_step_info))                 \
    C5(cairn_anchor_get_d3d12, SHARED(ANCHOR), CHOICE(0, 0), RESULT(void *), RESULT(void *), RESULT(uint64_t))        \
    C3(cairn_presenter_prepare_d3d12, SHARED(PRESENTER), SHARED(DEVICE), READ(cairn_d3d12_preparation))               \
    C5(cairn_presenter_record_d3d12, ALONE(PRESENTER), SHARED(DEVICE), NUMBER(100000000), READ(cairn_d3d12_recording), \
       FILLED_OR_NULL(cairn_frame))                                                                                   \
    C9(cairn_presenter_submit_d3d12, ALONE(PRESENTER), SHARED(DEVICE), NUMBER(100000000), GIVEN, NUMBER(0), NUMBER(0), \
       FILLED_OR_NULL(cairn_frame), RESULT(void *), RESULT(uint64_t))                                                 \
    C1(cairn_presenter_release_d3d12, ALONE(PRESENTER))                                                               \
    C4(cairn_swapchain_wrap, SHARED(DEVICE), READ_OR_NULL(cairn_swapchain_options), RESULT(void *), RESULT(cairn_swapchain *)) \
    C5(cairn_swapchain_create, SHARED(DEVICE), READ_OR_NULL(cairn_swapchain_options), GIVEN, GIVEN, RESULT(cairn_swapchain *)) \
    C7(cairn_swapchain_create_for_window, SHARED(DEVICE), READ_OR_NULL(cairn_swapchain_options), GIVEN, GIVEN, GIVEN,  \
       GIVEN_OR_NULL, RESULT(cairn_swapchain *))                                                                      \
    C2(cairn_swapchain_get_dxgi, ALONE(SWAPCHAIN), RESULT(void *))                                                    \
    C3(cairn_swapchain_prepare, ALONE(SWAPCHAIN), GIVEN, READ(cairn_swapchain_frame))                                 \
    C4(cairn_swapchain_set_interface, ALONE(SWAPCHAIN), GIVEN_OR_NULL, NUMBER(0), CHOICE(0, 3))                       \
    C2(cairn_swapchain_set_pacing, ALONE(SWAPCHAIN), READ_OR_NULL(cairn_swapchain_pacing))                            \
    C1(cairn_swapchain_pause, ALONE(SWAPCHAIN))                                                                       \
    C1(cairn_swapchain_wait, ALONE(SWAPCHAIN))                                                                        \
    C1(cairn_swapchain_fit, ALONE(SWAPCHAIN))                                                                         \
    C2(cairn_swapchain_get_statistics, SHARED(SWAPCHAIN), FILLED(cairn_swapchain_statistics))                         \
    C1(cairn_swapchain_destroy, SHARED(SWAPCHAIN))

/* Functions for Windows only, which are unsupported elsewhere with any arguments. */
__attribute__((unused)) static int is_for_windows(const char *name)
{
    return strstr(name, "d3d12") || strstr(name, "create_adapter") || strstr(name, "swapchain");
}

enum { WIDTH = 128, HEIGHT = 72 };
#define SCRIPT_TEXT "cairn-controls 1\n0..1 hold W\n"

#define CALL1(f, a0) static cairn_result call_##f(const struct argument *a) { return f(AS_##a0(a[0])); }
#define CALL2(f, a0, a1) static cairn_result call_##f(const struct argument *a) { return f(AS_##a0(a[0]), AS_##a1(a[1])); }
#define CALL3(f, a0, a1, a2) \
    static cairn_result call_##f(const struct argument *a) { return f(AS_##a0(a[0]), AS_##a1(a[1]), AS_##a2(a[2])); }
#define CALL4(f, a0, a1, a2, a3)                              \
    static cairn_result call_##f(const struct argument *a)    \
    {                                                         \
        return f(AS_##a0(a[0]), AS_##a1(a[1]), AS_##a2(a[2]), AS_##a3(a[3])); \
    }
#define CALL5(f, a0, a1, a2, a3, a4)                          \
    static cairn_result call_##f(const struct argument *a)    \
    {                                                         \
        return f(AS_##a0(a[0]), AS_##a1(a[1]), AS_##a2(a[2]), AS_##a3(a[3]), AS_##a4(a[4])); \
    }
#define CALL6(f, a0, a1, a2, a3, a4, a5)                      \
    static cairn_result call_##f(const struct argument *a)    \
    {                                                         \
        return f(AS_##a0(a[0]), AS_##a1(a[1]), AS_##a2(a[2]), AS_##a3(a[3]), AS_##a4(a[4]), AS_##a5(a[5])); \
    }
#define CALL7(f, a0, a1, a2, a3, a4, a5, a6)                  \
    static cairn_result call_##f(const struct argument *a)    \
    {                                                         \
        return f(AS_##a0(a[0]), AS_##a1(a[1]), AS_##a2(a[2]), AS_##a3(a[3]), AS_##a4(a[4]), AS_##a5(a[5]), AS_##a6(a[6])); \
    }
#define CALL8(f, a0, a1, a2, a3, a4, a5, a6, a7)              \
    static cairn_result call_##f(const struct argument *a)    \
    {                                                         \
        return f(AS_##a0(a[0]), AS_##a1(a[1]), AS_##a2(a[2]), AS_##a3(a[3]), AS_##a4(a[4]), AS_##a5(a[5]), AS_##a6(a[6]), \
                 AS_##a7(a[7]));                              \
    }
#define CALL9(f, a0, a1, a2, a3, a4, a5, a6, a7, a8)          \
    static cairn_result call_##f(const struct argument *a)    \
    {                                                         \
        return f(AS_##a0(a[0]), AS_##a1(a[1]), AS_##a2(a[2]), AS_##a3(a[3]), AS_##a4(a[4]), AS_##a5(a[5]), AS_##a6(a[6]), \
                 AS_##a7(a[7]), AS_##a8(a[8]));               \
    }
CALLS(CALL1, CALL2, CALL3, CALL4, CALL5, CALL6, CALL7, CALL8, CALL9)

#define ROW1(f, a0) {#f, call_##f, 1, {SHAPE_##a0}},
#define ROW2(f, a0, a1) {#f, call_##f, 2, {SHAPE_##a0, SHAPE_##a1}},
#define ROW3(f, a0, a1, a2) {#f, call_##f, 3, {SHAPE_##a0, SHAPE_##a1, SHAPE_##a2}},
#define ROW4(f, a0, a1, a2, a3) {#f, call_##f, 4, {SHAPE_##a0, SHAPE_##a1, SHAPE_##a2, SHAPE_##a3}},
#define ROW5(f, a0, a1, a2, a3, a4) {#f, call_##f, 5, {SHAPE_##a0, SHAPE_##a1, SHAPE_##a2, SHAPE_##a3, SHAPE_##a4}},
#define ROW6(f, a0, a1, a2, a3, a4, a5) \
    {#f, call_##f, 6, {SHAPE_##a0, SHAPE_##a1, SHAPE_##a2, SHAPE_##a3, SHAPE_##a4, SHAPE_##a5}},
#define ROW7(f, a0, a1, a2, a3, a4, a5, a6) \
    {#f, call_##f, 7, {SHAPE_##a0, SHAPE_##a1, SHAPE_##a2, SHAPE_##a3, SHAPE_##a4, SHAPE_##a5, SHAPE_##a6}},
#define ROW8(f, a0, a1, a2, a3, a4, a5, a6, a7) \
    {#f, call_##f, 8, {SHAPE_##a0, SHAPE_##a1, SHAPE_##a2, SHAPE_##a3, SHAPE_##a4, SHAPE_##a5, SHAPE_##a6, SHAPE_##a7}},
#define ROW9(f, a0, a1, a2, a3, a4, a5, a6, a7, a8) \
    {#f, call_##f, 9, {SHAPE_##a0, SHAPE_##a1, SHAPE_##a2, SHAPE_##a3, SHAPE_##a4, SHAPE_##a5, SHAPE_##a6, SHAPE_##a7, SHAPE_##a8}},
static const struct row rows[] = {CALLS(ROW1, ROW2, ROW3, ROW4, ROW5, ROW6, ROW7, ROW8, ROW9)};
enum { ROWS = sizeof rows / sizeof rows[0] };

/* Whether a row destroys a handle. */
__attribute__((unused)) static int destroys(const struct row *row)
{
    size_t length = strlen(row->name);
    return length > 8 && !strcmp(row->name + length - 8, "_destroy");
}

/* Whether a row returns CAIRN_ERROR_BUSY while there is any object. */
__attribute__((unused)) static int needs_no_object(const struct row *row)
{
    return !strcmp(row->name, "cairn_set_threads") || !strcmp(row->name, "cairn_set_scheduler");
}

/* A member of a struct, and its valid values: up to `most` for a choice, any of the bits of `most` for flags, finite for REAL_FIELD,
   and not NaN for NUMBER_FIELD. */
struct field {
    const char *name;
    int number;
    size_t at;
    enum { CHOICE_FIELD, FLAGS_FIELD, REAL_FIELD, NUMBER_FIELD, TEXT_FIELD } kind;
    uint32_t most;
};
#define FIELD(s, f, k, m) {#s "." #f, NUMBER_OF_##s, offsetof(s, f), k, m}
static const struct field fields[] = {
    FIELD(cairn_thread_options, threads, CHOICE_FIELD, CAIRN_MAX_THREADS),
    FIELD(cairn_thread_options, priority, CHOICE_FIELD, 2),
    FIELD(cairn_thread_options, reserved, CHOICE_FIELD, 0),
    FIELD(cairn_scheduler, concurrency, CHOICE_FIELD, CAIRN_MAX_THREADS),
    FIELD(cairn_device_options, threads, CHOICE_FIELD, 1024),
    FIELD(cairn_device_options, flags, FLAGS_FIELD, 3),
    FIELD(cairn_device_options, reserved, CHOICE_FIELD, 0),
    FIELD(cairn_device_options, onnxruntime, TEXT_FIELD, 0),
    FIELD(cairn_device_options, ffx, TEXT_FIELD, 0),
    FIELD(cairn_world_options, precision, CHOICE_FIELD, 2),
    FIELD(cairn_world_options, path, TEXT_FIELD, 0),
    FIELD(cairn_world_options, operating_point, TEXT_FIELD, 0),
    FIELD(cairn_world_options, flags, FLAGS_FIELD, 3),
    FIELD(cairn_world_options, reserved, CHOICE_FIELD, 0),
    /* The layers of the test world. */
    FIELD(cairn_world_options, slices, CHOICE_FIELD, 8),
    FIELD(cairn_rollout_options, queue_capacity, CHOICE_FIELD, CAIRN_MAX_QUEUE),
    FIELD(cairn_rollout_options, operating_point, TEXT_FIELD, 0),
    FIELD(cairn_picture, format, CHOICE_FIELD, 1),
    FIELD(cairn_picture, width, CHOICE_FIELD, 40),
    FIELD(cairn_picture, height, CHOICE_FIELD, 30),
    FIELD(cairn_target, format, CHOICE_FIELD, 1),
    FIELD(cairn_target, width, CHOICE_FIELD, WIDTH),
    FIELD(cairn_target, height, CHOICE_FIELD, HEIGHT),
    FIELD(cairn_controls, mouse_dx, REAL_FIELD, 0),
    FIELD(cairn_controls, mouse_dy, REAL_FIELD, 0),
    FIELD(cairn_controls, scroll, REAL_FIELD, 0),
    FIELD(cairn_guidance_data, flags, FLAGS_FIELD, 3),
    FIELD(cairn_guidance_data, width, CHOICE_FIELD, WIDTH),
    FIELD(cairn_guidance_data, height, CHOICE_FIELD, HEIGHT),
    FIELD(cairn_guidance_data, near_plane, REAL_FIELD, 0),
    FIELD(cairn_guidance_data, far_plane, NUMBER_FIELD, 0),
    FIELD(cairn_guidance_data, vertical_fov, REAL_FIELD, 0),
    FIELD(cairn_guidance_data, reserved, CHOICE_FIELD, 0),
    FIELD(cairn_presenter_options, multiplier, CHOICE_FIELD, 6),
    FIELD(cairn_presenter_options, flags, FLAGS_FIELD, 15),
    FIELD(cairn_presenter_options, capacity, CHOICE_FIELD, CAIRN_MAX_QUEUE),
    FIELD(cairn_presenter_options, motion, CHOICE_FIELD, 3),
    FIELD(cairn_presenter_options, colour_space, CHOICE_FIELD, 3),
    FIELD(cairn_presenter_options, fsr, CHOICE_FIELD, 2),
    FIELD(cairn_presenter_options, shader, CHOICE_FIELD, 2),
    FIELD(cairn_presenter_options, cpu, CHOICE_FIELD, 2),
    FIELD(cairn_presenter_options, reserved, CHOICE_FIELD, 0),
    FIELD(cairn_presenter_options, white_nits, CHOICE_FIELD, 10000),
    FIELD(cairn_presenter_options, reserved_too, CHOICE_FIELD, 0),
    FIELD(cairn_presenter_options, upscaler, CHOICE_FIELD, 2),
    FIELD(cairn_presenter_options, reserved_also, CHOICE_FIELD, 0),
    FIELD(cairn_budget, multiplier, CHOICE_FIELD, 64),
    FIELD(cairn_budget, schedules, TEXT_FIELD, 0),
    FIELD(cairn_budget, world_count, CHOICE_FIELD, CAIRN_MAX_BUDGET_WORLDS),
    FIELD(cairn_budget, reserved, CHOICE_FIELD, 0),
    FIELD(cairn_d3d12_options, flags, FLAGS_FIELD, 1),
    FIELD(cairn_d3d12_preparation, anchor_width, CHOICE_FIELD, 16384),
    FIELD(cairn_d3d12_preparation, anchor_height, CHOICE_FIELD, 16384),
    FIELD(cairn_d3d12_preparation, lists, CHOICE_FIELD, CAIRN_MAX_LISTS),
    FIELD(cairn_d3d12_preparation, flags, FLAGS_FIELD, 1),
    FIELD(cairn_d3d12_recording, reserved, CHOICE_FIELD, 0),
    FIELD(cairn_swapchain_options, flags, FLAGS_FIELD, 255),
    FIELD(cairn_swapchain_options, provider, CHOICE_FIELD, 4),
    FIELD(cairn_swapchain_options, max_render_width, CHOICE_FIELD, 16384),
    FIELD(cairn_swapchain_options, max_render_height, CHOICE_FIELD, 16384),
    FIELD(cairn_swapchain_frame, flags, FLAGS_FIELD, 1),
    FIELD(cairn_swapchain_frame, render_width, CHOICE_FIELD, 16384),
    FIELD(cairn_swapchain_frame, render_height, CHOICE_FIELD, 16384),
    FIELD(cairn_swapchain_frame, jitter_x, REAL_FIELD, 0),
    FIELD(cairn_swapchain_frame, jitter_y, REAL_FIELD, 0),
    FIELD(cairn_swapchain_frame, motion_scale_x, REAL_FIELD, 0),
    FIELD(cairn_swapchain_frame, motion_scale_y, REAL_FIELD, 0),
    FIELD(cairn_swapchain_frame, frame_time_ms, REAL_FIELD, 0),
    FIELD(cairn_swapchain_frame, vertical_fov, REAL_FIELD, 0),
    FIELD(cairn_swapchain_frame, near_plane, REAL_FIELD, 0),
    FIELD(cairn_swapchain_frame, far_plane, REAL_FIELD, 0),
    FIELD(cairn_swapchain_frame, metres, REAL_FIELD, 0),
    FIELD(cairn_swapchain_frame, position[1], REAL_FIELD, 0),
    FIELD(cairn_swapchain_frame, up[2], REAL_FIELD, 0),
    FIELD(cairn_swapchain_frame, right[0], REAL_FIELD, 0),
    FIELD(cairn_swapchain_frame, forward[1], REAL_FIELD, 0),
    FIELD(cairn_swapchain_frame, reserved, CHOICE_FIELD, 0),
    FIELD(cairn_swapchain_pacing, flags, FLAGS_FIELD, 3),
    FIELD(cairn_swapchain_pacing, safety_margin_ms, REAL_FIELD, 0),
    FIELD(cairn_swapchain_pacing, variance_factor, REAL_FIELD, 0),
};
enum { FIELDS = sizeof fields / sizeof fields[0] };

#endif
