/* Shared by the programs of this folder: tests with the output of Rust's harness, and the world they run. */
#ifndef CAIRN_TEST_CHECK_H
#define CAIRN_TEST_CHECK_H

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cairn.h"

static int failed_checks;
__attribute__((unused)) static int failed_tests;

/* Prints a condition that does not hold, and continues. */
#define CHECK(what)                                                        \
    do {                                                                   \
        if (!(what)) {                                                     \
            fprintf(stderr, "%s:%d: %s\n", __FILE__, __LINE__, #what);     \
            __atomic_add_fetch(&failed_checks, 1, __ATOMIC_SEQ_CST);       \
        }                                                                  \
    } while (0)

/* Prints the result of a call that differs from the expected one. */
#define ANSWERS(expected, call)                                                                                  \
    do {                                                                                                         \
        cairn_result answer = (call);                                                                            \
        if (answer != (expected)) {                                                                              \
            char text[512] = "";                                                                                 \
            cairn_last_error(text, sizeof text, NULL);                                                           \
            fprintf(stderr, "%s:%d: %s is %s, not %s (%s)\n", __FILE__, __LINE__, #call, cairn_result_name(answer), \
                    cairn_result_name(expected), text);                                                          \
            __atomic_add_fetch(&failed_checks, 1, __ATOMIC_SEQ_CST);                                             \
        }                                                                                                        \
    } while (0)

#define OK(call) ANSWERS(CAIRN_OK, call)

/* Runs a test and prints its line. */
#define RUN(test)                                                            \
    do {                                                                     \
        failed_checks = 0;                                                   \
        test();                                                              \
        printf("test %s ... %s\n", #test, failed_checks ? "FAILED" : "ok");  \
        fflush(stdout);                                                      \
        failed_tests += failed_checks != 0;                                  \
    } while (0)

/* The calling thread's last message; valid until the next call. */
__attribute__((unused)) static const char *message(void)
{
    static _Thread_local char text[2048];
    cairn_last_error(text, sizeof text, NULL);
    return text;
}

/* A device with two threads, whatever the machine has. */
__attribute__((unused)) static cairn_device *make_device(void)
{
    cairn_device_options options = {.struct_size = sizeof options, .threads = 2,
        .flags = CAIRN_DEVICE_DETERMINISTIC | CAIRN_DEVICE_ENVIRONMENT};
    cairn_device *device = NULL;
    OK(cairn_device_create_cpu(&options, &device));
    return device;
}

/* The path of the small world, from CAIRN_TEST_WORLD. */
__attribute__((unused)) static const char *world_path(void)
{
    const char *path = getenv("CAIRN_TEST_WORLD");
    if (!path) {
        fprintf(stderr, "set CAIRN_TEST_WORLD to a bundle; cargo xtask test abi does\n");
        exit(2);
    }
    return path;
}

/* That world, with one picture for each latent. */
__attribute__((unused)) static cairn_world *make_world(cairn_device *device)
{
    cairn_world_options options = {
        .struct_size = sizeof options, .path = world_path(), .operating_point = "stock,g16,native,pictures:1"};
    cairn_world *world = NULL;
    OK(cairn_world_load(device, &options, &world));
    return world;
}

/* 40 x 30 pixels with structure. */
__attribute__((unused)) static cairn_picture seed_picture(void)
{
    static unsigned char pixels[30][40][4];
    for (int y = 0; y < 30; y++) {
        for (int x = 0; x < 40; x++) {
            pixels[y][x][0] = (unsigned char)(x * 6);
            pixels[y][x][1] = (unsigned char)(y * 8);
            pixels[y][x][2] = (unsigned char)((x ^ y) * 8);
            pixels[y][x][3] = 255;
        }
    }
    cairn_picture picture = {
        .struct_size = sizeof picture, .width = 40, .height = 30, .pixels = pixels, .size = sizeof pixels};
    return picture;
}

/* Controls that differ from step to step. */
__attribute__((unused)) static cairn_controls controls(int i)
{
    cairn_controls c = {.struct_size = sizeof c, .mouse_dx = (float)i * 0.5f - 3, .mouse_dy = (float)-i};
    c.keys[1] = 1ull << (1 + i % 20);
    return c;
}

#endif
