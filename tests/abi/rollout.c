/* Rollouts: direct and queued steps, cancelled, paused, saved, and destroyed in every order. */
#include <pthread.h>
#include <stdint.h>
#include <unistd.h>

#include "check.h"

static cairn_device *device;
static cairn_world *world;

static cairn_rollout *make_rollout(uint64_t seed, uint32_t capacity)
{
    cairn_rollout_options options = {.struct_size = sizeof options, .seed = seed, .queue_capacity = capacity};
    cairn_rollout *rollout = NULL;
    OK(cairn_rollout_create(world, &options, &rollout));
    return rollout;
}

static cairn_rollout *make_seeded(uint64_t seed)
{
    cairn_rollout *rollout = make_rollout(seed, 0);
    cairn_picture picture = seed_picture();
    OK(cairn_rollout_append(rollout, &picture, NULL));
    return rollout;
}

/* A fingerprint of an anchor's picture and latent. */
static uint64_t anchor_print(cairn_anchor *anchor)
{
    static _Thread_local unsigned char pixels[72][128][4];
    static _Thread_local float latent[4 * 4 * 8];
    cairn_target target = {.struct_size = sizeof target, .width = 128, .height = 72, .pixels = pixels, .size = sizeof pixels};
    OK(cairn_anchor_read_picture(anchor, 0, &target));
    OK(cairn_anchor_read_latent(anchor, latent, 4 * 4 * 8));
    uint64_t hash = 1469598103934665603ull;
    const unsigned char *parts[2] = {&pixels[0][0][0], (const unsigned char *)latent};
    const size_t sizes[2] = {sizeof pixels, sizeof latent};
    for (int p = 0; p < 2; p++) {
        for (size_t i = 0; i < sizes[p]; i++) {
            hash = (hash ^ parts[p][i]) * 1099511628211ull;
        }
    }
    return hash;
}

static uint64_t last_print(cairn_rollout *rollout)
{
    cairn_anchor *anchor = NULL;
    OK(cairn_rollout_get_anchor(rollout, &anchor));
    uint64_t print = anchor_print(anchor);
    OK(cairn_anchor_destroy(anchor));
    return print;
}

enum { STEPS = 6 };

/* The fingerprints of STEPS steps of a seeded rollout. */
static void by_hand(uint64_t seed, uint64_t prints[STEPS])
{
    cairn_rollout *rollout = make_seeded(seed);
    for (int i = 0; i < STEPS; i++) {
        cairn_controls c = controls(i);
        cairn_step_info info = {.struct_size = sizeof info};
        OK(cairn_rollout_step(rollout, &c, &info));
        CHECK(info.latent == (uint64_t)i + 1 && info.denoise_passes == 4 && info.cache_passes == 1);
        CHECK((info.flags & CAIRN_STEP_COMMITTED) && info.denoise_ns > 0 && info.ring_bytes > 0);
        prints[i] = last_print(rollout);
    }
    OK(cairn_rollout_destroy(rollout));
}

static void a_rollout_reports_its_progress(void)
{
    cairn_rollout *rollout = make_rollout(7, 0);
    cairn_anchor *anchor = NULL;
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_rollout_get_anchor(rollout, &anchor));
    cairn_rollout_info info = {.struct_size = sizeof info};
    OK(cairn_rollout_get_info(rollout, &info));
    CHECK(info.latents == 0 && info.seed == 7 && info.latents_per_second == 15 && info.pictures_per_latent == 1);
    CHECK(strstr(info.operating_point, "g16,stock") == info.operating_point);
    cairn_picture picture = seed_picture();
    OK(cairn_rollout_append(rollout, &picture, NULL));
    OK(cairn_rollout_get_info(rollout, &info));
    CHECK(info.latents == 1);
    OK(cairn_rollout_get_anchor(rollout, &anchor));
    cairn_anchor_info about = {.struct_size = sizeof about};
    OK(cairn_anchor_get_info(anchor, &about));
    CHECK(about.latent == 0 && about.flags == CAIRN_ANCHOR_CUT && about.pictures == 1);
    CHECK(about.width == 128 && about.height == 72 && about.latent_channels == 4);
    /* The anchor remains valid after everything else is destroyed. */
    OK(cairn_rollout_destroy(rollout));
    anchor_print(anchor);
    OK(cairn_anchor_destroy(anchor));
}

static void only_declared_cuts_count(void)
{
    cairn_rollout *rollout = make_seeded(1);
    cairn_picture picture = seed_picture();
    cairn_controls c = controls(0);
    for (int i = 0; i < 4; i++) {
        if (i == 2) {
            OK(cairn_rollout_append(rollout, &picture, NULL));
        } else {
            OK(cairn_rollout_step(rollout, &c, NULL));
        }
        cairn_anchor *anchor = NULL;
        OK(cairn_rollout_get_anchor(rollout, &anchor));
        cairn_anchor_info about = {.struct_size = sizeof about};
        OK(cairn_anchor_get_info(anchor, &about));
        CHECK((about.flags == CAIRN_ANCHOR_CUT) == (i == 2));
        OK(cairn_anchor_destroy(anchor));
    }
    OK(cairn_rollout_destroy(rollout));
}

static void queued_steps_equal_direct_steps(void)
{
    uint64_t prints[STEPS];
    by_hand(3, prints);
    cairn_rollout *rollout = make_rollout(3, 2);
    uint64_t tickets[STEPS + 1];
    int submitted = 0, asked = 0;
    while (asked <= STEPS) {
        cairn_result r = CAIRN_OK;
        while (submitted <= STEPS && r == CAIRN_OK) {
            if (submitted == 0) {
                cairn_picture picture = seed_picture();
                r = cairn_rollout_submit_picture(rollout, &picture, &tickets[0]);
            } else {
                cairn_controls c = controls(submitted - 1);
                r = cairn_rollout_submit(rollout, &c, &tickets[submitted]);
            }
            submitted += r == CAIRN_OK;
        }
        CHECK(r == CAIRN_OK || r == CAIRN_QUEUE_FULL);
        CHECK(submitted - asked <= 2);
        cairn_anchor *anchor = NULL;
        cairn_step_info info = {.struct_size = sizeof info};
        OK(cairn_rollout_wait(rollout, tickets[asked], CAIRN_FOREVER, &info, &anchor));
        CHECK(info.latent == (uint64_t)asked);
        CHECK(asked == 0 || anchor_print(anchor) == prints[asked - 1]);
        OK(cairn_anchor_destroy(anchor));
        ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_rollout_poll(rollout, tickets[asked], NULL, NULL));
        asked++;
    }
    OK(cairn_rollout_destroy(rollout));
}

static void a_paused_queue_runs_single_steps(void)
{
    cairn_rollout *rollout = make_seeded(1);
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_rollout_single_step(rollout));
    OK(cairn_rollout_pause(rollout));
    ANSWERS(CAIRN_NOT_READY, cairn_rollout_single_step(rollout));
    cairn_controls c = controls(1);
    uint64_t tickets[2];
    OK(cairn_rollout_submit(rollout, &c, &tickets[0]));
    OK(cairn_rollout_submit(rollout, &c, &tickets[1]));
    ANSWERS(CAIRN_NOT_READY, cairn_rollout_wait(rollout, tickets[0], 20 * 1000 * 1000, NULL, NULL));
    ANSWERS(CAIRN_ERROR_BUSY, cairn_rollout_step(rollout, &c, NULL));
    ANSWERS(CAIRN_ERROR_BUSY, cairn_rollout_reset(rollout));
    OK(cairn_rollout_single_step(rollout));
    OK(cairn_rollout_wait(rollout, tickets[0], CAIRN_FOREVER, NULL, NULL));
    ANSWERS(CAIRN_NOT_READY, cairn_rollout_wait(rollout, tickets[1], 20 * 1000 * 1000, NULL, NULL));
    OK(cairn_rollout_resume(rollout));
    OK(cairn_rollout_wait(rollout, tickets[1], CAIRN_FOREVER, NULL, NULL));
    OK(cairn_rollout_destroy(rollout));
}

static void cancelling_leaves_the_rollout_consistent(void)
{
    uint64_t prints[STEPS];
    by_hand(5, prints);
    for (int moment = 0; moment < 20; moment++) {
        cairn_rollout *rollout = make_seeded(5);
        cairn_controls c = controls(0);
        uint64_t tickets[3];
        for (int i = 0; i < 3; i++) {
            OK(cairn_rollout_submit(rollout, &c, &tickets[i]));
        }
        usleep((useconds_t)moment * 300);
        OK(cairn_rollout_cancel(rollout));
        int made = 0, cancelled = 0;
        for (int i = 0; i < 3; i++) {
            cairn_result r = cairn_rollout_wait(rollout, tickets[i], CAIRN_FOREVER, NULL, NULL);
            CHECK(r == CAIRN_OK || r == CAIRN_ERROR_CANCELLED);
            CHECK(!(r == CAIRN_OK && cancelled));
            made += r == CAIRN_OK;
            cancelled += r != CAIRN_OK;
        }
        cairn_rollout_info info = {.struct_size = sizeof info};
        OK(cairn_rollout_get_info(rollout, &info));
        CHECK(info.latents == 1 + (uint64_t)made);
        /* A cancelled step has no effect. */
        if (made == 0) {
            for (int i = 0; i < 2; i++) {
                c = controls(i);
                OK(cairn_rollout_step(rollout, &c, NULL));
                CHECK(last_print(rollout) == prints[i]);
            }
        }
        OK(cairn_rollout_destroy(rollout));
    }
}

static void a_saved_state_continues_bit_for_bit(void)
{
    uint64_t prints[STEPS];
    by_hand(9, prints);
    cairn_rollout *rollout = make_seeded(9), *other = make_rollout(1, 0);
    cairn_controls c;
    for (int i = 0; i < 3; i++) {
        c = controls(i);
        OK(cairn_rollout_step(rollout, &c, NULL));
    }
    size_t size = 0, again = 0;
    OK(cairn_rollout_save(rollout, NULL, 0, &size));
    unsigned char *state = malloc(size);
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_rollout_save(rollout, state, size - 1, &again));
    OK(cairn_rollout_save(rollout, state, size, &again));
    CHECK(again == size);
    OK(cairn_rollout_save_file(rollout, "state.bin"));
    ANSWERS(CAIRN_ERROR_IO, cairn_rollout_save_file(rollout, "no/such/folder/state.bin"));
    for (int from_file = 0; from_file < 2; from_file++) {
        if (from_file) {
            OK(cairn_rollout_restore_file(other, "state.bin"));
        } else {
            OK(cairn_rollout_restore(other, state, size));
        }
        CHECK(last_print(other) == prints[2]);
        for (int i = 3; i < STEPS; i++) {
            c = controls(i);
            OK(cairn_rollout_step(other, &c, NULL));
            CHECK(last_print(other) == prints[i]);
        }
    }
    /* A damaged state is refused and changes nothing. */
    for (size_t at = 0; at < size; at += size / 50) {
        state[at] ^= 4;
        cairn_result r = cairn_rollout_restore(other, state, size);
        CHECK(r == CAIRN_ERROR_INVALID_STATE || r == CAIRN_ERROR_UNSUPPORTED);
        state[at] ^= 4;
        ANSWERS(CAIRN_ERROR_INVALID_STATE, cairn_rollout_restore(other, state, at));
    }
    CHECK(last_print(other) == prints[STEPS - 1]);
    ANSWERS(CAIRN_ERROR_IO, cairn_rollout_restore_file(other, "no-such-state.bin"));
    ANSWERS(CAIRN_ERROR_INVALID_STATE, cairn_rollout_restore_file(other, "."));
    free(state);
    OK(cairn_rollout_destroy(rollout));
    OK(cairn_rollout_destroy(other));
}

#ifdef CAIRN_WORLD_FIT_WINDOW /* The first header has neither this nor budgets. */
static void a_budget_limits_latents(void)
{
    cairn_rollout *rollout = make_seeded(1);
    cairn_controls c = controls(0);
    uint32_t passes[6];
    /* No latent takes only a nanosecond. */
    OK(cairn_rollout_set_budget(rollout, 1, "stock explicit:1:0.5:0"));
    for (int i = 0; i < 6; i++) {
        cairn_step_info info = {.struct_size = sizeof info};
        OK(cairn_rollout_step(rollout, &c, &info));
        passes[i] = info.denoise_passes;
    }
    CHECK(passes[0] > 2 && passes[1] == passes[0] && passes[2] == passes[0]);
    CHECK(passes[3] == 2 && passes[4] == 2 && passes[5] == 2);
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_rollout_set_budget(rollout, 1, "explicit:1:0.5:0 stock"));
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_rollout_set_budget(rollout, 1, "fast"));
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_rollout_set_budget(rollout, 0, "stock"));
    OK(cairn_rollout_set_budget(rollout, 0, ""));
    OK(cairn_rollout_destroy(rollout));
}
#endif

#ifdef CAIRN_MAX_BUDGET_WORLDS
static void one_budget_limits_latents_and_frames(void)
{
    cairn_rollout *rollout = make_seeded(1);
    cairn_presenter_options options = {.struct_size = sizeof options, .interval_ns = 66666667, .multiplier = 4};
    cairn_presenter *presenter = NULL;
    OK(cairn_presenter_create(&options, &presenter));
    cairn_controls c = controls(0);
    /* No latent takes only a nanosecond. */
    cairn_budget budget = {.struct_size = sizeof budget, .frame_ns = 1, .schedules = "stock explicit:1:0.5:0",
                           .worlds = (const cairn_world *const *)&world, .world_count = 1, .presenter = presenter};
    OK(cairn_rollout_govern(rollout, &budget));
    cairn_rollout_statistics s = {.struct_size = sizeof s};
    OK(cairn_rollout_get_statistics(rollout, &s));
    CHECK(s.governed_latents == 0 && s.governed_passes > 2 && s.governed_window > 0 && s.governed_made == 4);
    for (int i = 0; i < 8; i++) {
        cairn_step_info info = {.struct_size = sizeof info};
        OK(cairn_rollout_step(rollout, &c, &info));
        CHECK(i < 3 ? info.denoise_passes > 2 : info.denoise_passes == 2);
    }
    OK(cairn_rollout_get_statistics(rollout, &s));
    CHECK(s.governed_latents == 8 && s.governed_less == 1 && s.governed_more == 0 && s.governed_beyond > 0);
    CHECK(s.governed_passes == 2 && s.governed_made == 1 && s.governed_frame_ns > 1 && s.reserved == 0);
    cairn_presenter_statistics shown = {.struct_size = sizeof shown};
    OK(cairn_presenter_get_statistics(presenter, &shown));
    CHECK(shown.made_to_anchor == 1 && shown.budget_changes == 1);
    /* An invalid budget changes nothing. */
    cairn_budget wrong = budget;
    wrong.multiplier = 3;
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_rollout_govern(rollout, &wrong));
    wrong = budget, wrong.frame_ns = 0;
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_rollout_govern(rollout, &wrong));
    wrong = budget, wrong.worlds = NULL;
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_rollout_govern(rollout, &wrong));
    wrong = budget, wrong.world_count = CAIRN_MAX_BUDGET_WORLDS + 1;
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_rollout_govern(rollout, &wrong));
    const cairn_world *none[] = {(const cairn_world *)rollout};
    wrong = budget, wrong.worlds = none;
    ANSWERS(CAIRN_ERROR_INVALID_HANDLE, cairn_rollout_govern(rollout, &wrong));
    wrong = budget, wrong.presenter = (const cairn_presenter *)rollout;
    ANSWERS(CAIRN_ERROR_INVALID_HANDLE, cairn_rollout_govern(rollout, &wrong));
    wrong = budget, wrong.schedules = "explicit:1:0.5:0 stock";
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_rollout_govern(rollout, &wrong));
    wrong = budget, wrong.memory_mib = 1;
    ANSWERS(CAIRN_ERROR_OUT_OF_MEMORY, cairn_rollout_govern(rollout, &wrong));
    OK(cairn_presenter_get_statistics(presenter, &shown));
    CHECK(shown.made_to_anchor == 1);
    OK(cairn_rollout_govern(rollout, NULL));
    OK(cairn_presenter_destroy(presenter));
    OK(cairn_rollout_step(rollout, &c, NULL));
    OK(cairn_rollout_destroy(rollout));
}
#endif

static void wrong_controls_are_refused(void)
{
    cairn_rollout *rollout = make_seeded(1);
    const float bad[] = {0.0f / 0.0f, 1.0f / 0.0f, -1.0f / 0.0f, 32769.0f, -1e30f};
    for (int i = 0; i < 5; i++) {
        cairn_controls c = controls(0);
        uint64_t ticket = 77;
        c.mouse_dx = bad[i];
        ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_rollout_step(rollout, &c, NULL));
        c = controls(0);
        c.mouse_dy = bad[i];
        ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_rollout_submit(rollout, &c, &ticket));
        CHECK(ticket == 77);
        c = controls(0);
        c.scroll = bad[i];
        if (i < 3) {
            ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_rollout_step(rollout, &c, NULL));
        }
    }
    OK(cairn_rollout_destroy(rollout));
}

static void *wait_for_ever(void *argument)
{
    void **pair = argument;
    ANSWERS(CAIRN_ERROR_CANCELLED,
            cairn_rollout_wait(pair[0], *(uint64_t *)pair[1], CAIRN_FOREVER, NULL, NULL));
    return NULL;
}

static void destruction_ends_waiting_calls(void)
{
    for (int paused = 0; paused < 2; paused++) {
        cairn_rollout *rollout = make_seeded(1);
        cairn_controls c = controls(0);
        uint64_t tickets[2];
        if (paused) OK(cairn_rollout_pause(rollout));
        for (int i = 0; i < 2; i++) OK(cairn_rollout_submit(rollout, &c, &tickets[i]));
        void *pair[2] = {rollout, &tickets[1]};
        pthread_t thread;
        if (paused) {
            CHECK(pthread_create(&thread, NULL, wait_for_ever, pair) == 0);
            usleep(20000);
        }
        OK(cairn_rollout_destroy(rollout));
        if (paused) pthread_join(thread, NULL);
        ANSWERS(CAIRN_ERROR_INVALID_HANDLE, cairn_rollout_poll(rollout, tickets[0], NULL, NULL));
    }
}

static void objects_of_a_rollout_may_be_destroyed_in_any_order(void)
{
    for (int order = 0; order < 24; order++) {
        cairn_device *d = make_device();
        cairn_world *w = make_world(d);
        cairn_rollout *r = NULL;
        cairn_anchor *a = NULL;
        uint64_t ticket = 0;
        cairn_picture picture = seed_picture();
        cairn_controls c = controls(0);
        OK(cairn_rollout_create(w, NULL, &r));
        OK(cairn_rollout_append(r, &picture, NULL));
        OK(cairn_rollout_get_anchor(r, &a));
        OK(cairn_rollout_submit(r, &c, &ticket)); /* work in flight */
        int left[4] = {0, 1, 2, 3}, n = order;
        for (int i = 4; i > 0; i--) {
            int pick = n % i, what = left[pick];
            n /= i;
            memmove(&left[pick], &left[pick + 1], sizeof(int) * (size_t)(3 - pick));
            if (what == 0) OK(cairn_device_destroy(d));
            if (what == 1) OK(cairn_world_destroy(w));
            if (what == 2) OK(cairn_rollout_destroy(r));
            if (what == 3) OK(cairn_anchor_destroy(a));
        }
    }
}

/* Two threads that step one rollout: each step succeeds completely or is refused as busy. */
static cairn_rollout *contested;
static int contested_made;

static void *step_hard(void *unused)
{
    (void)unused;
    for (int i = 0; i < 40; i++) {
        cairn_controls c = controls(0);
        cairn_result r = cairn_rollout_step(contested, &c, NULL);
        CHECK(r == CAIRN_OK || r == CAIRN_ERROR_BUSY);
        if (r == CAIRN_OK) __atomic_add_fetch(&contested_made, 1, __ATOMIC_SEQ_CST);
    }
    return NULL;
}

static void calls_from_a_second_thread_are_refused_without_harm(void)
{
    contested = make_seeded(1);
    pthread_t threads[3];
    for (int i = 0; i < 3; i++) CHECK(pthread_create(&threads[i], NULL, step_hard, NULL) == 0);
    for (int i = 0; i < 3; i++) pthread_join(threads[i], NULL);
    cairn_rollout_info info = {.struct_size = sizeof info};
    OK(cairn_rollout_get_info(contested, &info));
    CHECK(info.latents == 1 + (uint64_t)contested_made && contested_made >= 40);
    OK(cairn_rollout_destroy(contested));
}

int main(void)
{
    device = make_device();
    world = make_world(device);
    RUN(a_rollout_reports_its_progress);
    RUN(only_declared_cuts_count);
    RUN(queued_steps_equal_direct_steps);
    RUN(a_paused_queue_runs_single_steps);
    RUN(cancelling_leaves_the_rollout_consistent);
    RUN(a_saved_state_continues_bit_for_bit);
#ifdef CAIRN_WORLD_FIT_WINDOW
    RUN(a_budget_limits_latents);
#endif
#ifdef CAIRN_MAX_BUDGET_WORLDS
    RUN(one_budget_limits_latents_and_frames);
#endif
    RUN(wrong_controls_are_refused);
    RUN(destruction_ends_waiting_calls);
    RUN(objects_of_a_rollout_may_be_destroyed_in_any_order);
    RUN(calls_from_a_second_thread_are_refused_without_harm);
    cairn_world_destroy(world);
    cairn_device_destroy(device);
    return failed_tests != 0;
}
