/* Every function of the header with every kind of invalid argument. */
#include <errno.h>
#include <math.h>

#include "stage.h"

/* Number of allocations that are not freed; counted on Linux only. */
static long pieces;

#ifndef _WIN32
/* ---- The library's allocations come here: the program's functions override those of the C library. ---- */
extern void *__libc_malloc(size_t size);
extern void *__libc_calloc(size_t count, size_t size);
extern void *__libc_realloc(void *old, size_t size);
extern void *__libc_memalign(size_t alignment, size_t size);
extern void __libc_free(void *old);

static void *piece(void *made)
{
    __atomic_add_fetch(&pieces, made != NULL, __ATOMIC_SEQ_CST);
    return made;
}

void *malloc(size_t size) { return piece(__libc_malloc(size)); }
void *calloc(size_t count, size_t size) { return piece(__libc_calloc(count, size)); }
void *memalign(size_t alignment, size_t size) { return piece(__libc_memalign(alignment, size)); }
void *aligned_alloc(size_t alignment, size_t size) { return piece(__libc_memalign(alignment, size)); }

void *realloc(void *old, size_t size)
{
    return old ? __libc_realloc(old, size) : malloc(size);
}

int posix_memalign(void **to, size_t alignment, size_t size)
{
    void *made = memalign(alignment, size);
    if (made) *to = made;
    return made ? 0 : ENOMEM;
}

void free(void *old)
{
    __atomic_sub_fetch(&pieces, old != NULL, __ATOMIC_SEQ_CST);
    __libc_free(old);
}
#endif

static cairn_device *device;
static const struct row *row;
static struct argument a[MOST_ARGUMENTS];
static unsigned long refusals;

/* Calls with one invalid argument: the result is as expected, the message has the function's name, and no output of the call was
   written. */
static void refused(cairn_result expected, const char *what)
{
    static unsigned char before[MOST_ARGUMENTS][8192];
    for (int i = 0; i < row->count; i++) memcpy(before[i], &rooms[i], sizeof before[i]);
    cairn_result r = row->call(a);
    refusals++;
    /* These two return the last error and do not change it. */
    int keeps = !strncmp(row->name, "cairn_last_error", 16);
    if (r != expected || (!keeps && strncmp(message(), row->name, strlen(row->name)))) {
        fprintf(stderr, "%s with %s: %s, not %s (%s)\n", row->name, what, cairn_result_name(r),
                cairn_result_name(expected), message());
        CHECK(!"it is refused");
    }
    for (int i = 0; i < row->count; i++) {
        if (memcmp(before[i], &rooms[i], sizeof before[i])) {
            fprintf(stderr, "%s with %s has written argument %d\n", row->name, what, i + 1);
            CHECK(!"nothing is written");
        }
    }
}

static void *stale[KINDS];

static void wrong_handles(int i)
{
    static int foreign;
    const struct shape *shape = &row->shapes[i];
    void *right = a[i].pointer;
    enum object kind = shape->object == QUEUE ? ROLLOUT : (enum object)shape->object;
    void *const wrong[] = {NULL, &foreign, (char *)&foreign + 1, rooms, (void *)1, (void *)UINTPTR_MAX, stale[kind],
        (void *)((uintptr_t)right ^ 1), (void *)((uintptr_t)right + (1 << 24)), (void *)(uintptr_t)refused};
    for (size_t w = 0; w < sizeof wrong / sizeof wrong[0]; w++) {
        a[i].pointer = wrong[w];
        if (wrong[w] == NULL && (shape->or_null || destroys(row))) continue;
        /* The neighbouring number may be the handle of another object of this kind. */
        if (w == 7 && (wrong[w] == objects[kind] || wrong[w] == objects[QUEUE])) continue;
        refused(CAIRN_ERROR_INVALID_HANDLE, "a handle that is none");
    }
    for (int other = 0; other < OBJECTS; other++) {
        a[i].pointer = objects[other];
        if (other != SWAPCHAIN && other != (int)kind && !(other == QUEUE && kind == ROLLOUT)) {
            refused(CAIRN_ERROR_INVALID_HANDLE, "a handle of another kind");
        }
    }
    for (int bit = 24; bit < 64; bit++) {
        a[i].pointer = (void *)((uintptr_t)right ^ (uintptr_t)1 << bit);
        refused(CAIRN_ERROR_INVALID_HANDLE, "a guessed handle");
    }
    a[i].pointer = right;
}

/* Whether `size` was the struct's size before fields were added to it. */
static int earlier_size(const struct shape *shape, uint32_t size)
{
    const uint32_t sizes[][2] = {{sizeof(cairn_device_options), 32}, {sizeof(cairn_presenter_options), 64},
        {sizeof(cairn_presenter_options), 72}, {sizeof(cairn_presenter_statistics), 304}, {sizeof(cairn_presenter_statistics), 376},
        {sizeof(cairn_presenter_statistics), 568}, {sizeof(cairn_device_info), 144}, {sizeof(cairn_world_options), 48},
        {sizeof(cairn_world_options), 56}, {sizeof(cairn_world_info), 336}, {sizeof(cairn_rollout_statistics), 120},
        {sizeof(cairn_rollout_statistics), 216}, {sizeof(cairn_swapchain_statistics), 176}};
    int found = 0;
    for (size_t i = 0; i < sizeof sizes / sizeof sizes[0]; i++) found |= shape->size == sizes[i][0] && size == sizes[i][1];
    return found;
}

static void wrong_structs(int i)
{
    const struct shape *shape = &row->shapes[i];
    unsigned char *right = a[i].pointer;
    a[i].pointer = NULL;
    if (!shape->or_null) refused(CAIRN_ERROR_INVALID_ARGUMENT, "no struct");
    for (uint32_t off = 1; off < shape->align; off++) {
        a[i].pointer = right + off;
        refused(CAIRN_ERROR_INVALID_ARGUMENT, "a misaligned struct");
    }
    a[i].pointer = right;
    for (uint32_t size = 0; size < 4200; size++) {
        if (earlier_size(shape, size)) continue;
        if (size == shape->size || (size > shape->size && size <= 4096 && size % shape->align == 0)) continue;
        memcpy(right, &size, sizeof size);
        refused(CAIRN_ERROR_STRUCT_SIZE, "a wrong struct_size");
        /* Far above the current size, samples suffice. */
        if (size > shape->size + 16) size += 254;
    }
    for (int bit = 13; bit < 32; bit++) {
        uint32_t size = (uint32_t)1 << bit | shape->size;
        memcpy(right, &size, sizeof size);
        refused(CAIRN_ERROR_STRUCT_SIZE, "an absurd struct_size");
    }
    if (shape->kind == READ_ARGUMENT) {
        uint32_t size = shape->size + 64;
        for (uint32_t at = shape->size; at < size; at++) {
            memcpy(right, &size, sizeof size);
            right[at] = 1;
            refused(CAIRN_ERROR_STRUCT_SIZE, "something set that is not known");
            right[at] = 0;
        }
    }
    memcpy(right, &shape->size, sizeof shape->size);
}

static const char *const no_texts[] = {"\xff", "a\x80", "\xc0\xaf", "\xed\xa0\x80", "\xf4\x90\x80\x80", "ok\xe2\x82"};
enum { NO_TEXTS = sizeof no_texts / sizeof no_texts[0] };

static void wrong_fields(int i)
{
    const float no_numbers[] = {NAN, -NAN, INFINITY, -INFINITY};
    for (int f = 0; f < FIELDS; f++) {
        if (fields[f].number != row->shapes[i].number) continue;
        unsigned char *place = rooms[i].bytes + fields[f].at, right[8];
        memcpy(right, place, sizeof right);
        for (int n = 0; n < 32; n++) {
            uint32_t number = (uint32_t)1 << n;
            if (fields[f].kind == CHOICE_FIELD && number <= fields[f].most) number = fields[f].most + 1;
            if (fields[f].kind == FLAGS_FIELD && !(number & ~fields[f].most)) continue;
            if (fields[f].kind == CHOICE_FIELD || fields[f].kind == FLAGS_FIELD) {
                memcpy(place, &number, sizeof number);
            } else if (fields[f].kind == TEXT_FIELD) {
                if (n >= NO_TEXTS) break;
                memcpy(place, &no_texts[n], sizeof no_texts[n]);
            } else {
                if (n >= (fields[f].kind == REAL_FIELD ? 4 : 2)) break;
                memcpy(place, &no_numbers[n], sizeof no_numbers[n]);
            }
            refused(CAIRN_ERROR_INVALID_ARGUMENT, fields[f].name);
        }
        memcpy(place, right, sizeof right);
    }
}

static void wrong_numbers(int i)
{
    const struct shape *shape = &row->shapes[i];
    struct argument right = a[i];
    if (shape->kind == CHOICE_ARGUMENT) {
        if (shape->least > 0) {
            a[i].number = shape->least == 15 ? 0 : shape->least - 1;
            int may_be = strstr(row->name, "recorder_key") != NULL; /* key 0 exists */
            if (!may_be) refused(CAIRN_ERROR_INVALID_ARGUMENT, "a number too small");
        }
        for (int bit = 0; bit < 32; bit++) {
            a[i].number = (uint64_t)1 << bit;
            if (a[i].number <= shape->most) a[i].number = shape->most + 1;
            refused(CAIRN_ERROR_INVALID_ARGUMENT, "a number too large");
        }
    } else if (shape->kind == COUNT_ARGUMENT) {
        int elements = row->shapes[i - 1].kind == BYTES_ARGUMENT;
        const uint64_t wrong[] = {0, 1, right.number - 1, right.number + 1, UINT64_MAX, (uint64_t)1 << 63};
        for (int w = 0; w < 6; w++) {
            a[i].number = wrong[w];
            /* A larger buffer than needed is fine, and so is another script. */
            if (strstr(row->name, "rollout_save") && (w == 3 || w == 4 || w == 5)) continue;
            if (strstr(row->name, "script_create") && w == 2) continue;
            if (!elements && w == 3 && (right.number + 1) % 8 == 0) continue;
            cairn_result expected = elements ? CAIRN_ERROR_INVALID_ARGUMENT : CAIRN_ERROR_STRUCT_SIZE;
            if (strstr(row->name, "rollout_restore") && w < 4) expected = CAIRN_ERROR_INVALID_STATE;
            refused(expected, "a wrong count");
        }
    } else if (shape->kind == REAL_ARGUMENT) {
        const float wrong[] = {NAN, -NAN, INFINITY, -INFINITY};
        for (int w = 0; w < 4; w++) {
            a[i].real = wrong[w];
            refused(CAIRN_ERROR_INVALID_ARGUMENT, "what is no number");
        }
    }
    a[i] = right;
}

static void wrong_places(int i)
{
    const struct shape *shape = &row->shapes[i];
    struct argument right = a[i];
    a[i].pointer = NULL;
    if (!shape->or_null) refused(CAIRN_ERROR_INVALID_ARGUMENT, "a null pointer");
    for (uint32_t off = 1; off < shape->align; off++) {
        a[i].pointer = (char *)right.pointer + off;
        refused(CAIRN_ERROR_INVALID_ARGUMENT, "a misaligned pointer");
    }
    a[i] = right;
}

static void wrong_texts(int i)
{
    struct argument right = a[i];
    wrong_places(i);
    for (int t = 0; t < NO_TEXTS; t++) {
        a[i].pointer = (void *)(uintptr_t)no_texts[t];
        refused(CAIRN_ERROR_INVALID_ARGUMENT, "what is no UTF-8");
    }
    static char endless[65536];
    memset(endless, 'a', sizeof endless);
    a[i].pointer = endless;
    refused(CAIRN_ERROR_INVALID_ARGUMENT, "a text without an end");
    a[i] = right;
}

/* A fingerprint of all objects' visible state. */
static uint64_t state_of_all(void)
{
    uint64_t print = 1469598103934665603ull;
    unsigned char *state = malloc(saved_size);
    char text[4096] = "";
    cairn_presenter_statistics statistics = {.struct_size = sizeof statistics};
    cairn_rollout_statistics queue = {.struct_size = sizeof queue};
    cairn_script *recorded = NULL;
    OK(cairn_rollout_save(objects[ROLLOUT], state, saved_size, &saved_size));
    OK(cairn_presenter_get_statistics(objects[PRESENTER], &statistics));
    OK(cairn_rollout_get_statistics(objects[QUEUE], &queue));
    OK(cairn_recorder_make_script(objects[RECORDER], 100000000, &recorded));
    OK(cairn_script_get_text(recorded, text, sizeof text, NULL));
    OK(cairn_script_destroy(recorded));
    const struct {
        const void *bytes;
        size_t size;
    } parts[] = {{state, saved_size}, {&statistics, sizeof statistics}, {&queue, sizeof queue}, {text, sizeof text}};
    for (int p = 0; p < 4; p++) {
        const unsigned char *bytes = parts[p].bytes;
        for (size_t i = 0; i < parts[p].size; i++) print = (print ^ bytes[i]) * 1099511628211ull;
    }
    free(state);
    return print;
}

static void refuse_row(void)
{
    for (int i = 0; i < row->count; i++) {
        valid_arguments(row, a, 0x5a);
        switch (row->shapes[i].kind) {
        case HANDLE_ARGUMENT: wrong_handles(i); break;
        case READ_ARGUMENT: wrong_structs(i), wrong_fields(i); break;
        case FILLED_ARGUMENT: wrong_structs(i); break;
        case RESULT_ARGUMENT: wrong_places(i); break;
        case BYTES_ARGUMENT: wrong_places(i); break;
        case ROOM_ARGUMENT: wrong_places(i); break;
        case TEXT_ARGUMENT: wrong_texts(i); break;
        default: wrong_numbers(i); break;
        }
    }
}

static void invalid_arguments_are_refused_everywhere(void)
{
    create_objects(device);
    OK(cairn_recorder_key(objects[RECORDER], 500, 'W', 1));
    for (int kind = 0; kind < KINDS; kind++) stale[kind] = NULL;
    stale[ANCHOR] = create_anchor(3);
    OK(cairn_anchor_destroy(stale[ANCHOR]));
    OK(cairn_recorder_create((cairn_recorder **)&stale[RECORDER]));
    OK(cairn_recorder_destroy(stale[RECORDER]));
    OK(cairn_rollout_create(objects[WORLD], NULL, (cairn_rollout **)&stale[ROLLOUT]));
    OK(cairn_rollout_destroy(stale[ROLLOUT]));
    OK(cairn_script_create(SCRIPT_TEXT, sizeof SCRIPT_TEXT - 1, (cairn_script **)&stale[SCRIPT]));
    OK(cairn_script_destroy(stale[SCRIPT]));
    OK(cairn_presenter_create(NULL, (cairn_presenter **)&stale[PRESENTER]));
    OK(cairn_presenter_destroy(stale[PRESENTER]));
    for (int pass = 0; pass < 2; pass++) {
        for (row = rows; row < rows + ROWS; row++) {
            uint64_t before = state_of_all();
            unsigned long counted = refusals;
            long held = pieces;
            refuse_row();
            /* One may be the last message, if it is longer than the one before. */
            if (pass == 1 && pieces > held + 2) {
                fprintf(stderr, "%s keeps %ld pieces of %lu refusals\n", row->name, pieces - held, refusals - counted);
                CHECK(!"nothing is kept");
            }
            if (state_of_all() != before) {
                fprintf(stderr, "%s has changed something although it was refused\n", row->name);
                CHECK(!"nothing is changed");
            }
        }
    }
    CHECK(refusals > 2 * 5000);
    destroy_objects();
}

/* Whether a function for Windows returns what it must for these arguments. */
static int is_answer_for_windows(cairn_result r)
{
    int needs_swapchain = row->shapes[0].kind == HANDLE_ARGUMENT && row->shapes[0].object == SWAPCHAIN;
    if (needs_swapchain) return r == CAIRN_ERROR_INVALID_HANDLE;
    if (!given.device) return r == CAIRN_ERROR_UNSUPPORTED;
    /* There are no libraries of AMD's, no swap chain to wrap, and no adapter of that number. */
    if (strstr(row->name, "swapchain_wrap") || strstr(row->name, "create_adapter")) return r == CAIRN_ERROR_INVALID_ARGUMENT;
    if (strstr(row->name, "swapchain")) return r == CAIRN_ERROR_RUNTIME_MISSING;
    /* The world is not on Direct3D 12. */
    int needs_world = strstr(row->name, "rollout_append_d3d12") || strstr(row->name, "anchor_get_d3d12");
    return needs_world && !getenv("CAIRN_TEST_DIRECTML") ? r == CAIRN_ERROR_UNSUPPORTED : r >= 0;
}

static void valid_arguments_of_every_row_are_accepted(void)
{
    for (row = rows; row < rows + ROWS; row++) {
        create_objects(device);
        valid_arguments(row, a, 0);
        cairn_result r = row->call(a);
        release_given(row, a, r);
        int taken = is_for_windows(row->name) && !destroys(row) ? is_answer_for_windows(r)
            : needs_no_object(row)                                   ? r == CAIRN_ERROR_BUSY
            /* The provider's library is not beside ONNX Runtime. */
            : strstr(row->name, "create_gpu")                        ? r == CAIRN_ERROR_RUNTIME_MISSING
                                                                     : r >= 0;
        if (!taken) fprintf(stderr, "%s: %s (%s)\n", row->name, cairn_result_name(r), message());
        CHECK(taken);
        enum object kind = created_kind(row);
        if (r == CAIRN_OK && kind != OBJECTS) {
            void *made;
            memcpy(&made, &rooms[row->count - 1], sizeof made);
            OK(destroy_object(kind, made));
        }
        if (destroys(row)) {
            ANSWERS(a[0].pointer ? CAIRN_ERROR_INVALID_HANDLE : CAIRN_OK, row->call(a));
            device = row->shapes[0].object == DEVICE ? create_device() : device;
            objects[row->shapes[0].object] = NULL;
        }
        objects[DEVICE] = NULL;
        void *world = objects[WORLD];
        objects[WORLD] = NULL;
        destroy_objects();
        objects[WORLD] = world;
    }
    destroy_objects();
}

#ifdef _WIN32
static unsigned long before[2];

static void no_reference_to_device_and_queue_stays(void)
{
    /* The other device is gone with the last objects. */
    destroy_devices(NULL);
    CHECK(given_has_references(&given, before));
}
#endif

int main(void)
{
#ifdef _WIN32
    given_create(&given);
    given_references(&given, before);
#endif
    device = create_device();
    RUN(valid_arguments_of_every_row_are_accepted);
    RUN(invalid_arguments_are_refused_everywhere);
#ifdef _WIN32
    RUN(no_reference_to_device_and_queue_stays);
#endif
    return failed_tests != 0;
}
