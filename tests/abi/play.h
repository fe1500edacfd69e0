/* Random call sequences with random structs, chosen by a string of bytes. */
#ifndef CAIRN_TEST_PLAY_H
#define CAIRN_TEST_PLAY_H

#include "stage.h"

/* Source of the choices; zeroes when it is used up. */
struct bytes {
    const unsigned char *at;
    size_t left;
};

static uint64_t take(struct bytes *from, size_t size)
{
    uint64_t value = 0;
    if (size > from->left) size = from->left;
    memcpy(&value, from->at, size);
    from->at += size, from->left -= size;
    return value;
}

/* A number that is often near a limit. */
static uint64_t random_number(struct bytes *from)
{
    const uint64_t borders[] = {0, 1, 2, 3, 255, 256, 65535, UINT32_MAX, INT64_MAX, UINT64_MAX, 16384, 16385};
    uint64_t choice = take(from, 1);
    if (choice < 12) return borders[choice];
    if (choice < 128) return take(from, 1);
    return choice < 192 ? (uint64_t)1 << (choice & 63) : take(from, 8);
}

/* Handles that were created during the sequence, to be used and destroyed. */
enum { KEPT = 16 };
static struct {
    void *handle;
    enum object kind;
} kept[KEPT];

static void store_handle(struct bytes *from, enum object kind, void *handle)
{
    int place = (int)(take(from, 1) % KEPT);
    if (kept[place].handle) destroy_object(kept[place].kind, kept[place].handle);
    kept[place].handle = handle, kept[place].kind = kind;
}

/* Changes members of a struct: pointers stay valid, and counts never exceed the memory behind them. */
static void randomise_struct(struct bytes *from, const struct shape *shape, unsigned char *to)
{
    for (int times = (int)take(from, 1) % 4; times > 0; times--) {
        const struct field *field = &fields[take(from, 1) % FIELDS];
        if (field->number != shape->number || field->kind == TEXT_FIELD) continue;
        uint32_t number = (uint32_t)random_number(from);
        memcpy(to + field->at, &number, sizeof number);
    }
    if (take(from, 1) % 16 == 0) {
        uint32_t size = (uint32_t)random_number(from);
        memcpy(to, &size, sizeof size);
    }
}

static void random_arguments(struct bytes *from, const struct row *row, struct argument a[MOST_ARGUMENTS])
{
    valid_arguments(row, a, 0);
    for (int i = 0; i < row->count; i++) {
        const struct shape *shape = &row->shapes[i];
        unsigned what = (unsigned)take(from, 1);
        if (shape->kind == HANDLE_ARGUMENT) {
            int place = (int)(what % KEPT);
            if (what < 128 && kept[place].handle) a[i].pointer = kept[place].handle;
            if (what > 250) a[i].pointer = (void *)(uintptr_t)random_number(from);
        } else if (shape->kind == READ_ARGUMENT) {
            if (what < 192) randomise_struct(from, shape, a[i].pointer);
            if (what > 250) a[i].pointer = NULL;
        } else if (shape->kind == FILLED_ARGUMENT) {
            /* Any size fits into the memory. */
            uint32_t size = what < 32 ? (uint32_t)random_number(from) : shape->size;
            memcpy(a[i].pointer, &size, sizeof size);
            if (what > 250) a[i].pointer = NULL;
        } else if (shape->kind == NUMBER_ARGUMENT && i > 0 && row->shapes[i - 1].kind == ROOM_ARGUMENT) {
            a[i].number = take(from, 2) % 8192; /* the size of the memory */
        } else if (shape->kind == CHOICE_ARGUMENT || shape->kind == NUMBER_ARGUMENT) {
            if (what < 192) a[i].number = random_number(from);
        } else if (shape->kind == COUNT_ARGUMENT) {
            /* No more than there is, if the argument is such a count at all. */
            if (what < 64 && shape->good != 0) a[i].number = what % (a[i].number + 1);
        } else if (shape->kind == REAL_ARGUMENT) {
            uint32_t bits = (uint32_t)random_number(from);
            memcpy(&a[i].real, &bits, sizeof bits);
        } else if (shape->kind == TEXT_ARGUMENT || shape->kind == BYTES_ARGUMENT) {
            unsigned char *text = a[i].pointer;
            if (what < 64 && a[i].pointer != saved_state) text[take(from, 1) % 16] = (unsigned char)take(from, 1);
        } else if (what > 250) {
            a[i].pointer = NULL;
        }
    }
}

/* Calls that take too long or have effects outside: a random path would be written to, a world takes long to load, a wait may never
   end. The hostile callers test their arguments. */
static int is_excluded(const struct row *row)
{
    const char *const names[] = {"save_file", "wait", "world_load", "device_create", "requirements", "log_callback"};
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
        if (strstr(row->name, names[i])) return 1;
    }
    return 0;
}

/* Runs the calls that `from` chooses until it is used up, and destroys all handles that were created. Every result must be one that the
   header names, and none an internal error. */
static void play(struct bytes *from)
{
    static struct argument a[MOST_ARGUMENTS];
    while (from->left > 0) {
        const struct row *row = &rows[take(from, 1) % ROWS];
        if (is_excluded(row)) continue;
        /* The stage's own objects are not destroyed. */
        int ends = destroys(row);
        int needs_world = row->shapes[0].kind == HANDLE_ARGUMENT &&
            (row->shapes[0].object == WORLD || row->shapes[0].object == ROLLOUT || row->shapes[0].object == QUEUE);
        if (needs_world && !objects[WORLD] && take(from, 1) > 8) continue;
        random_arguments(from, row, a);
        if (ends) {
            int place = (int)(take(from, 1) % KEPT);
            a[0].pointer = kept[place].handle;
            cairn_result r = row->call(a);
            if (r == CAIRN_OK) kept[place].handle = NULL;
            continue;
        }
        cairn_result r = row->call(a);
        if (r <= CAIRN_ERROR_POISONED || r > CAIRN_QUEUE_FULL || !strcmp(cairn_result_name(r), "unknown result")) {
            fprintf(stderr, "%s: %s (%s)\n", row->name, cairn_result_name(r), message());
            abort();
        }
        enum object kind = created_kind(row);
        void *made = NULL;
        const void *place = a[row->count - 1].pointer;
        if (r == CAIRN_OK && kind != OBJECTS && place) memcpy(&made, place, sizeof made);
        if (made) store_handle(from, kind, made);
    }
    for (int place = 0; place < KEPT; place++) {
        if (!kept[place].handle) continue;
        OK(destroy_object(kept[place].kind, kept[place].handle));
        kept[place].handle = NULL;
    }
}

#endif
