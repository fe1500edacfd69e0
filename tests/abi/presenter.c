/* Presenters and guidance: compared with an independent clock under seeded jitter, and used as a host does. */
#include <math.h>
#include <pthread.h>
#include <stdint.h>

#include "check.h"

enum { WIDTH = 40, HEIGHT = 24 };

static cairn_anchor *make_anchor(uint64_t number, uint32_t flags)
{
    static unsigned char pixels[HEIGHT][WIDTH][4];
    for (int y = 0; y < HEIGHT; y++) {
        for (int x = 0; x < WIDTH; x++) {
            unsigned moved = (unsigned)x + 2u * (unsigned)number;
            pixels[y][x][0] = (unsigned char)(moved * 9 % 200);
            pixels[y][x][1] = (unsigned char)(y * 7);
            pixels[y][x][2] = (unsigned char)((moved / 4 + (unsigned)y / 4) % 2 * 90);
            pixels[y][x][3] = 255;
        }
    }
    cairn_picture picture = {
        .struct_size = sizeof picture, .width = WIDTH, .height = HEIGHT, .pixels = pixels, .size = sizeof pixels};
    cairn_anchor *anchor = NULL;
    OK(cairn_anchor_create(&picture, number, flags, &anchor));
    return anchor;
}

static cairn_presenter *make_presenter(const cairn_presenter_options *options)
{
    cairn_presenter *presenter = NULL;
    OK(cairn_presenter_create(options, &presenter));
    return presenter;
}

static void push(cairn_presenter *presenter, uint64_t number, uint64_t now)
{
    cairn_anchor *anchor = make_anchor(number, number == 0 ? CAIRN_ANCHOR_CUT : 0);
    OK(cairn_presenter_push(presenter, anchor, NULL, now));
    OK(cairn_anchor_destroy(anchor)); /* the presenter keeps what it needs */
}

/* splitmix64 */
static uint64_t next_random(uint64_t *state)
{
    uint64_t z = (*state += 0x9E3779B97F4A7C15ull);
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9ull;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBull;
    return z ^ (z >> 31);
}

/* ---- The reference: it has no positions or fractions, keeps the due time of every anchor in a list, moves the whole list when an
   anchor is late, and searches the frame from the end. Times are in units of 1 / (3 * multiplier) ns, so that an interval of
   1/15 s and all of its parts are whole numbers. ---- */
enum { INTERVAL = 66666666 };
static int64_t due[400], unit, delay;
static int came;

static void reference_push(int64_t now, int catch_up)
{
    due[came] = came == 0 ? now + delay : due[came - 1] + INTERVAL * unit;
    int64_t move = now > due[came] ? now - due[came] : 0;
    if (catch_up && came > 0 && move == 0 && due[came] - now > delay) {
        int64_t most = INTERVAL / (4 * unit) * unit, excess = due[came] - now - delay;
        move = -(excess < most ? excess : most);
    }
    for (int i = 0; i <= came; i++) due[i] += move;
    came++;
}

/* The frame's source, the anchor that it starts from, and the number of intervals / multiplier after it. */
static uint32_t reference_query(int64_t now, int *from, int *step)
{
    *from = came - 1;
    while (*from > 0 && due[*from] > now) --*from;
    *step = 0;
    while (due[*from] + (*step + 1) * (int64_t)INTERVAL <= now && *step <= unit) ++*step;
    if (*step == 0) return CAIRN_FRAME_ANCHOR;
    if (*from < came - 1) return CAIRN_FRAME_GENERATED;
    return *step <= unit && *from > 0 ? CAIRN_FRAME_EXTRAPOLATED : CAIRN_FRAME_HELD;
}

static void frames_equal_the_reference_clocks(void)
{
    const int multipliers[] = {2, 3, 4, 6};
    int seen[6] = {0};
    for (uint64_t seed = 0; seed < 20; seed++) {
        int multiplier = multipliers[seed % 4];
        unit = multiplier;
        uint64_t random = seed, now = 1000000 + next_random(&random) % 1000000;
        uint64_t delay_ns = seed % 3 == 0 ? 66666667 : next_random(&random) % 100000000 + 1;
        delay = (int64_t)delay_ns * unit;
        came = 0;
        cairn_presenter_options options = {.struct_size = sizeof options, .multiplier = (uint32_t)multiplier,
            .interval_ns = INTERVAL, .delay_ns = delay_ns, .capacity = CAIRN_MAX_QUEUE,
            .flags = seed % 2 ? CAIRN_PRESENTER_CATCH_UP : 0};
        cairn_presenter *presenter = make_presenter(&options);
        cairn_frame frame = {.struct_size = sizeof frame};
        ANSWERS(CAIRN_NOT_READY, cairn_presenter_query(presenter, now, &frame));
        uint64_t ideal = now, jitter = next_random(&random) % 120000000 + 1;
        for (int i = 0; i < 120; i++) {
            uint64_t arrival = ideal + next_random(&random) % jitter;
            if (next_random(&random) % 16 == 0) ideal += next_random(&random) % 300000000; /* a stall */
            if (arrival < now) arrival = now;
            /* Queries at random times, and at every boundary to the nanosecond. */
            while (i > 0 && now < arrival) {
                uint64_t ask = now + next_random(&random) % 7000000;
                if (next_random(&random) % 2 == 0) ask = frame.until_ns - next_random(&random) % 2;
                if (ask < now || ask >= arrival) break;
                now = ask;
                int from = 0, step = 0;
                uint32_t source = reference_query((int64_t)now * unit, &from, &step);
                OK(cairn_presenter_query(presenter, now, &frame));
                seen[source]++;
                CHECK(frame.source == source);
                CHECK(frame.position == (uint64_t)(from * multiplier + step) || source == CAIRN_FRAME_HELD);
                CHECK(frame.previous == (uint64_t)from);
                CHECK(frame.current == (uint64_t)from + (source == CAIRN_FRAME_GENERATED));
                if (from > 0 || source != CAIRN_FRAME_HELD) {
                    int shown = step < multiplier ? step : multiplier;
                    CHECK(frame.t == (float)shown / (float)multiplier);
                }
                if (failed_checks) {
                    fprintf(stderr, "seed %d, anchor %d, time %llu\n", (int)seed, i, (unsigned long long)now);
                    return;
                }
            }
            now = arrival;
            push(presenter, (uint64_t)i, now);
            reference_push((int64_t)now * unit, seed % 2 != 0);
            ideal += INTERVAL;
        }
        OK(cairn_presenter_destroy(presenter));
    }
    CHECK(seen[CAIRN_FRAME_ANCHOR] > 500 && seen[CAIRN_FRAME_GENERATED] > 500);
    CHECK(seen[CAIRN_FRAME_EXTRAPOLATED] > 200 && seen[CAIRN_FRAME_HELD] > 50);
}

static void a_second_of_frames_is_drawn(void)
{
    cairn_presenter_options options = {
        .struct_size = sizeof options, .multiplier = 4, .interval_ns = 60000000, .cpu = CAIRN_PREFER_REQUIRE};
    cairn_presenter *presenter = make_presenter(&options);
    static unsigned char pixels[HEIGHT][WIDTH][4], before[HEIGHT][WIDTH][4];
    cairn_target target = {
        .struct_size = sizeof target, .width = WIDTH, .height = HEIGHT, .pixels = pixels, .size = sizeof pixels};
    cairn_frame frame = {.struct_size = sizeof frame}, asked = frame;
    ANSWERS(CAIRN_NOT_READY, cairn_presenter_draw(presenter, 0, &target, &frame));
    for (uint64_t now = 0, number = 0; now < 1000000000; now += 5000000) {
        if (now % 60000000 == 0) push(presenter, number++, now);
        memcpy(before, pixels, sizeof pixels);
        OK(cairn_presenter_query(presenter, now, &asked));
        OK(cairn_presenter_draw(presenter, now, &target, &frame));
        CHECK(frame.position == asked.position && frame.t == asked.t && frame.since_ns == asked.since_ns);
        int same = memcmp(before, pixels, sizeof pixels) == 0;
        CHECK(same == ((frame.flags & CAIRN_FRAME_REPEATED) != 0));
        CHECK(frame.source == (frame.t > 0 ? CAIRN_FRAME_GENERATED : CAIRN_FRAME_ANCHOR));
    }
    cairn_presenter_statistics done = {.struct_size = sizeof done};
    OK(cairn_presenter_get_statistics(presenter, &done));
    CHECK(done.anchors == 17 && done.late_anchors == 0 && done.shown_held == 0 && done.shown_extrapolated == 0);
    CHECK(done.shown_anchors + done.shown_generated == 200 && done.shown_generated > 130 && done.repeated > 120);
    CHECK(strcmp(done.generator, "cpu") == 0 && done.preference[0] == 0);
    CHECK(done.generate_ns > 0 && done.guidance_ns > 0);
    /* No device made a frame, and all anchors but the last have been due. */
    CHECK(done.device_frames == 0 && done.device_lists_ns == 0 && done.under_way == 0 && done.waiting <= 1);
    CHECK(done.made_to_anchor == 0 && done.budget_changes == 0);
    OK(cairn_presenter_set_budget(presenter, 4000000));
    OK(cairn_presenter_get_statistics(presenter, &done));
    CHECK(done.made_to_anchor > 1 && done.budget_changes == 0);
    OK(cairn_presenter_set_budget(presenter, 0));
    /* An earlier host has a shorter struct. */
    struct { cairn_presenter_statistics statistics; uint64_t behind; } earlier = {.behind = 7};
    earlier.statistics.struct_size = 304;
    earlier.statistics.waiting = 0x5a5a5a5a;
    OK(cairn_presenter_get_statistics(presenter, &earlier.statistics));
    CHECK(earlier.statistics.anchors == 17 && earlier.statistics.waiting == 0x5a5a5a5a && earlier.behind == 7);
    /* A target must have the current size of frames. */
    OK(cairn_presenter_resize(presenter, WIDTH / 2, HEIGHT / 2));
    cairn_target half = {.struct_size = sizeof half, .width = WIDTH / 2, .height = HEIGHT / 2, .pixels = pixels,
        .size = sizeof pixels};
    OK(cairn_presenter_draw(presenter, 2000000000, &half, NULL));
    OK(cairn_presenter_resize(presenter, 0, 0));
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_presenter_draw(presenter, 2000000000, &half, NULL));
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_presenter_resize(presenter, 16385, 1));
    /* The overlay mask has the anchors' size. */
    static uint8_t mask[WIDTH * HEIGHT];
    OK(cairn_presenter_set_overlay(presenter, mask, sizeof mask, WIDTH, HEIGHT));
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_presenter_set_overlay(presenter, mask, WIDTH * (HEIGHT - 1), WIDTH, HEIGHT - 1));
    OK(cairn_presenter_set_overlay(presenter, NULL, 0, 0, 0));
    OK(cairn_presenter_reset(presenter));
    ANSWERS(CAIRN_NOT_READY, cairn_presenter_query(presenter, 2000000000, &asked));
    OK(cairn_presenter_destroy(presenter));
}

/* White of pictures has the same code value everywhere in HDR10 and scRGB: that of so many nits. */
static void hdr_colours_follow_their_standards(void)
{
    const struct { uint32_t space, format, nits; } cases[] = {
        {CAIRN_COLOUR_HDR10, CAIRN_FORMAT_RGB10A2, 0}, {CAIRN_COLOUR_HDR10, CAIRN_FORMAT_RGB10A2, 100},
        {CAIRN_COLOUR_SCRGB, CAIRN_FORMAT_RGBA16F, 160}, {CAIRN_COLOUR_SCRGB, CAIRN_FORMAT_RGBA16F, 80},
    };
    const uint64_t white[] = {594, 520, 0x4000, 0x3c00};
    static uint8_t bytes[WIDTH * HEIGHT * 4];
    memset(bytes, 0xff, sizeof bytes);
    cairn_picture picture = {.struct_size = sizeof picture, .width = WIDTH, .height = HEIGHT, .pixels = bytes, .size = sizeof bytes};
    cairn_anchor *anchor;
    OK(cairn_anchor_create(&picture, 0, 0, &anchor));
    for (int i = 0; i < 4; i++) {
        cairn_presenter_options options = {.struct_size = sizeof options, .interval_ns = 60000000,
            .colour_space = cases[i].space, .white_nits = cases[i].nits};
        cairn_presenter *presenter = make_presenter(&options);
        OK(cairn_presenter_push(presenter, anchor, NULL, 0));
        static uint64_t pixels[WIDTH * HEIGHT];
        cairn_target target = {.struct_size = sizeof target, .format = cases[i].format, .width = WIDTH, .height = HEIGHT,
            .pixels = pixels, .size = sizeof pixels};
        OK(cairn_presenter_draw(presenter, 90000000, &target, NULL));
        uint64_t level = cases[i].format == CAIRN_FORMAT_RGB10A2 ? pixels[7] & 1023 : pixels[7] & 0xffff;
        CHECK(level + 1 >= white[i] && level <= white[i] + 1);
        target.format = CAIRN_FORMAT_RGBA8;
        ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_presenter_draw(presenter, 90000000, &target, NULL));
        OK(cairn_presenter_destroy(presenter));
    }
    OK(cairn_anchor_destroy(anchor));
}

static void frames_have_the_requested_size_and_format(void)
{
    cairn_presenter_options options = {.struct_size = sizeof options, .interval_ns = 60000000, .width = 2 * WIDTH,
        .height = 2 * HEIGHT, .colour_space = CAIRN_COLOUR_LINEAR};
    cairn_presenter *presenter = make_presenter(&options);
    push(presenter, 0, 0);
    push(presenter, 1, 60000000);
    static uint16_t halves[2 * HEIGHT][2 * WIDTH + 3][4];
    memset(halves, 0x11, sizeof halves);
    cairn_target target = {.struct_size = sizeof target, .format = CAIRN_FORMAT_RGBA16F, .width = 2 * WIDTH,
        .height = 2 * HEIGHT, .pixels = halves, .size = sizeof halves, .row_pitch = sizeof halves[0]};
    OK(cairn_presenter_draw(presenter, 90000000, &target, NULL));
    for (int y = 0; y < 2 * HEIGHT; y++) {
        for (int x = 0; x < 2 * WIDTH + 3; x++) {
            for (int c = 0; c < 4; c++) {
                uint16_t half = halves[y][x][c];
                CHECK(x < 2 * WIDTH ? half <= 0x3c00 && (c < 3 || half == 0x3c00) : half == 0x1111);
            }
        }
    }
    target.format = CAIRN_FORMAT_RGBA8;
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_presenter_draw(presenter, 90000000, &target, NULL));
    target.format = CAIRN_FORMAT_RGBA16F;
    target.width = WIDTH;
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_presenter_draw(presenter, 90000000, &target, NULL));
    target.width = 2 * WIDTH;
    target.size = 100;
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_presenter_draw(presenter, 90000000, &target, NULL));
    OK(cairn_presenter_destroy(presenter));
}

static void preferences_are_met_or_refused(void)
{
    cairn_presenter_options options = {.struct_size = sizeof options, .interval_ns = 60000000};
    cairn_presenter *presenter = make_presenter(&options);
    cairn_presenter_statistics done = {.struct_size = sizeof done};
    OK(cairn_presenter_get_statistics(presenter, &done));
    CHECK(strcmp(done.generator, "cpu") == 0 && strncmp(done.preference, "fsr, shader: ", 13) == 0);
    OK(cairn_presenter_destroy(presenter));
    presenter = NULL;
    options.fsr = CAIRN_PREFER_REQUIRE;
    ANSWERS(CAIRN_ERROR_UNSUPPORTED, cairn_presenter_create(&options, &presenter));
    char field[32] = "";
    OK(cairn_last_error_part(CAIRN_LAST_ERROR_FIELD, field, sizeof field, NULL));
    CHECK(strcmp(field, "options.fsr") == 0);
    options.cpu = CAIRN_PREFER_REQUIRE;
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_presenter_create(&options, &presenter));
    options.fsr = CAIRN_PREFER_AUTO;
    options.upscaler = CAIRN_PREFER_REQUIRE;
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_presenter_create(&options, &presenter));
    OK(cairn_last_error_part(CAIRN_LAST_ERROR_FIELD, field, sizeof field, NULL));
    CHECK(strcmp(field, "options.upscaler") == 0);
    options.upscaler = CAIRN_PREFER_AUTO;
    options.fsr = 3;
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_presenter_create(&options, &presenter));
    options.fsr = 0;
    options.cpu = CAIRN_PREFER_NEVER;
    for (uint32_t m = 0; m < 10; m++) {
        options.multiplier = m;
        int known = m <= 4 || m == 6;
        ANSWERS(known ? CAIRN_OK : CAIRN_ERROR_INVALID_ARGUMENT, cairn_presenter_create(&options, &presenter));
        OK(cairn_presenter_destroy(presenter));
        presenter = NULL;
    }
    /* Without a generator the nearer anchor is shown. */
    options.multiplier = 2;
    presenter = make_presenter(&options);
    push(presenter, 0, 0);
    push(presenter, 1, 60000000);
    cairn_frame frame = {.struct_size = sizeof frame};
    OK(cairn_presenter_query(presenter, 90000000, &frame));
    CHECK(frame.source == CAIRN_FRAME_HELD && frame.previous == 1 && frame.flags == 0);
    OK(cairn_presenter_destroy(presenter));
}

static void guidance_is_created_and_read(void)
{
    cairn_anchor *first = make_anchor(0, 0), *second = make_anchor(1, 0);
    cairn_guidance *found = NULL, *own = NULL;
    OK(cairn_guidance_create(first, second, CAIRN_MOTION_AUTO, &found));
    cairn_guidance_info info = {.struct_size = sizeof info};
    OK(cairn_guidance_get_info(found, &info));
    CHECK(info.width == WIDTH && info.height == HEIGHT && info.near_plane == 0.1f && info.far_plane == 100.0f);
    static uint16_t motion[HEIGHT][WIDTH][2];
    static float depth[HEIGHT][WIDTH];
    OK(cairn_guidance_read_motion(found, &motion[0][0][0], sizeof motion / 2));
    OK(cairn_guidance_read_depth(found, &depth[0][0], WIDTH * HEIGHT));
    /* The picture moved two pixels to the left, so motion to the previous picture points right by two. */
    CHECK(motion[HEIGHT / 2][WIDTH / 2][0] >= 0x3e00 && motion[HEIGHT / 2][WIDTH / 2][0] <= 0x4100);
    CHECK(depth[3][3] == 0.5f);
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_guidance_read_depth(found, &depth[0][0], WIDTH * HEIGHT - 1));
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_guidance_create(first, second, CAIRN_MOTION_PAPER, &own));
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_guidance_create(first, second, CAIRN_MOTION_LATENTS, &own));
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_guidance_create(first, second, 4, &own));

    depth[0][0] = 0.25f;
    depth[0][1] = NAN;
    motion[0][0][0] = 0x7c00; /* infinite */
    motion[0][1][1] = 0x4400; /* 4 */
    cairn_guidance_data data = {.struct_size = sizeof data, .flags = CAIRN_DEPTH_INVERTED, .width = WIDTH, .height = HEIGHT,
        .motion = &motion[0][0][0], .motion_count = sizeof motion / 2, .depth = &depth[0][0], .depth_count = WIDTH * HEIGHT};
    OK(cairn_guidance_create_from_host(&data, &own));
    OK(cairn_guidance_read_motion(own, &motion[0][0][0], sizeof motion / 2));
    OK(cairn_guidance_read_depth(own, &depth[0][0], WIDTH * HEIGHT));
    CHECK(motion[0][0][0] == 0 && motion[0][1][1] == 0x4400 && depth[0][0] == 0.75f && depth[0][1] == 1.0f);
    cairn_guidance *refused = NULL;
    for (int i = 0; i < 9; i++) {
        cairn_guidance_data bad = data;
        if (i == 0) bad.flags = 3;
        if (i == 1) bad.flags = 4;
        if (i == 2) bad.motion_count--;
        if (i == 3) bad.depth_count++;
        if (i == 4) bad.motion = NULL;
        if (i == 5) bad.depth = NULL;
        if (i == 6) bad.near_plane = -1;
        if (i == 7) bad.vertical_fov = NAN;
        if (i == 8) bad.width = 0xffffffffu, bad.height = 0xffffffffu;
        ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_guidance_create_from_host(&bad, &refused));
        CHECK(refused == NULL);
    }
    cairn_presenter_options options = {.struct_size = sizeof options, .interval_ns = 60000000};
    cairn_presenter *presenter = make_presenter(&options);
    OK(cairn_presenter_push(presenter, first, NULL, 0));
    OK(cairn_presenter_push(presenter, second, own, 60000000));
    OK(cairn_guidance_destroy(own));
    OK(cairn_anchor_destroy(first));
    OK(cairn_anchor_destroy(second));
    static unsigned char pixels[HEIGHT][WIDTH][4];
    cairn_target target = {
        .struct_size = sizeof target, .width = WIDTH, .height = HEIGHT, .pixels = pixels, .size = sizeof pixels};
    OK(cairn_presenter_draw(presenter, 90000000, &target, NULL));
    cairn_presenter_statistics done = {.struct_size = sizeof done};
    OK(cairn_presenter_get_statistics(presenter, &done));
    CHECK(done.shown_generated == 1);
    OK(cairn_guidance_destroy(found));
    OK(cairn_presenter_destroy(presenter));
}

/* One thread draws, two push and query. */
static cairn_presenter *shared;
static int stop_querying;

static void *keep_querying(void *unused)
{
    (void)unused;
    cairn_frame frame = {.struct_size = sizeof frame};
    for (uint64_t now = 0; !__atomic_load_n(&stop_querying, __ATOMIC_SEQ_CST); now += 1000000) {
        OK(cairn_presenter_query(shared, now, &frame));
        CHECK(frame.until_ns > frame.since_ns);
    }
    return NULL;
}

static void statistics_do_not_wait_for_a_picture(void)
{
    cairn_presenter_options options = {.struct_size = sizeof options, .interval_ns = 60000000, .capacity = 64};
    shared = make_presenter(&options);
    push(shared, 0, 0);
    pthread_t thread;
    CHECK(pthread_create(&thread, NULL, keep_querying, NULL) == 0);
    static unsigned char pixels[HEIGHT][WIDTH][4];
    cairn_target target = {
        .struct_size = sizeof target, .width = WIDTH, .height = HEIGHT, .pixels = pixels, .size = sizeof pixels};
    for (uint64_t i = 1; i < 60; i++) {
        push(shared, i, i * 60000000);
        OK(cairn_presenter_draw(shared, i * 60000000 + 30000000, &target, NULL));
    }
    __atomic_store_n(&stop_querying, 1, __ATOMIC_SEQ_CST);
    pthread_join(thread, NULL);
    OK(cairn_presenter_destroy(shared));
}

static void anchors_of_a_world_have_rate_latents_and_decoded_pictures(void)
{
    cairn_device *device = make_device();
    cairn_world_options world_options = {
        .struct_size = sizeof world_options, .path = world_path(), .operating_point = "stock,g16,native,pictures:4"};
    cairn_world *world = NULL;
    cairn_rollout *rollout = NULL;
    OK(cairn_world_load(device, &world_options, &world));
    OK(cairn_rollout_create(world, NULL, &rollout));
    cairn_picture picture = seed_picture();
    OK(cairn_rollout_append(rollout, &picture, NULL));
    for (int decoded = 0; decoded < 2; decoded++) {
        cairn_presenter_options options = {.struct_size = sizeof options, .multiplier = 4, .motion = CAIRN_MOTION_PAPER,
            .flags = decoded ? 0 : CAIRN_PRESENTER_NO_DECODED};
        cairn_presenter *presenter = make_presenter(&options);
        cairn_anchor *anchors[2] = {NULL, NULL};
        for (int i = 0; i < 2; i++) {
            cairn_controls c = controls(i);
            OK(cairn_rollout_step(rollout, &c, NULL));
            OK(cairn_rollout_get_anchor(rollout, &anchors[i]));
            OK(cairn_presenter_push(presenter, anchors[i], NULL, (uint64_t)i * 66666667));
        }
        static unsigned char pixels[72][128][4], own[72][128][4];
        cairn_target target = {
            .struct_size = sizeof target, .width = 128, .height = 72, .pixels = pixels, .size = sizeof pixels};
        for (uint32_t step = 1; step < 4; step++) {
            cairn_frame frame = {.struct_size = sizeof frame};
            OK(cairn_presenter_draw(presenter, 66666667 + step * 16666667, &target, &frame));
            if (decoded) {
                CHECK(frame.source == CAIRN_FRAME_DECODED);
                target.pixels = own;
                OK(cairn_anchor_read_picture(anchors[1], step - 1, &target));
                target.pixels = pixels;
                CHECK(memcmp(own, pixels, sizeof own) == 0);
            } else {
                /* Moving noise causes cuts. */
                CHECK(frame.source == CAIRN_FRAME_GENERATED || (frame.flags & CAIRN_FRAME_CUT));
            }
        }
        OK(cairn_anchor_destroy(anchors[0]));
        OK(cairn_anchor_destroy(anchors[1]));
        OK(cairn_presenter_destroy(presenter));
    }
    OK(cairn_rollout_destroy(rollout));
    OK(cairn_world_destroy(world));
    OK(cairn_device_destroy(device));
}

static void mismatched_arguments_are_refused(void)
{
    cairn_presenter *presenter = make_presenter(NULL);
    cairn_anchor *anchor = make_anchor(0, 0);
    /* A host's own picture has no rate, and the options have no interval. */
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_presenter_push(presenter, anchor, NULL, 0));
    OK(cairn_presenter_destroy(presenter));
    cairn_presenter_options options = {.struct_size = sizeof options, .interval_ns = 60000000, .capacity = 1};
    presenter = make_presenter(&options);
    OK(cairn_presenter_push(presenter, anchor, NULL, 0));
    OK(cairn_presenter_push(presenter, anchor, NULL, 0));
    ANSWERS(CAIRN_QUEUE_FULL, cairn_presenter_push(presenter, anchor, NULL, 0));
    ANSWERS(CAIRN_ERROR_INVALID_HANDLE, cairn_presenter_push(presenter, (cairn_anchor *)presenter, NULL, 0));
    ANSWERS(CAIRN_ERROR_INVALID_HANDLE, cairn_presenter_push(presenter, anchor, (cairn_guidance *)anchor, 0));
    unsigned char small[4] = {0};
    cairn_picture picture = {.struct_size = sizeof picture, .width = 1, .height = 1, .pixels = small, .size = 4};
    cairn_anchor *other = NULL;
    OK(cairn_anchor_create(&picture, 1, 0, &other));
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_presenter_push(presenter, other, NULL, 1000000000));
    /* A clock that jumps, backwards and to the largest time. */
    cairn_frame frame = {.struct_size = sizeof frame};
    const uint64_t times[] = {0, UINT64_MAX, 0, UINT64_MAX / 2, 1};
    for (int i = 0; i < 5; i++) OK(cairn_presenter_query(presenter, times[i], &frame));
    OK(cairn_anchor_destroy(other));
    OK(cairn_anchor_destroy(anchor));
    OK(cairn_presenter_destroy(presenter));
    OK(cairn_presenter_destroy(NULL));
    OK(cairn_guidance_destroy(NULL));
}

int main(void)
{
    RUN(frames_equal_the_reference_clocks);
    RUN(a_second_of_frames_is_drawn);
    RUN(frames_have_the_requested_size_and_format);
    RUN(hdr_colours_follow_their_standards);
    RUN(preferences_are_met_or_refused);
    RUN(guidance_is_created_and_read);
    RUN(statistics_do_not_wait_for_a_picture);
    RUN(anchors_of_a_world_have_rate_latents_and_decoded_pictures);
    RUN(mismatched_arguments_are_refused);
    return failed_tests != 0;
}
