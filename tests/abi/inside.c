/* Runs inside ONNX Runtime and file operations: parallel runs, and none after a cancel. */
#include <fcntl.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdint.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <time.h>
#include <unistd.h>

#include "check.h"
#include "shim/onnxruntime.h"

/* ---- The library's file calls come here: the program's functions override those of the C library. ---- */
static unsigned long file_calls;

ssize_t read(int file, void *to, size_t size)
{
    __atomic_add_fetch(&file_calls, 1, __ATOMIC_SEQ_CST);
    return syscall(SYS_read, file, to, size);
}

ssize_t pread64(int file, void *to, size_t size, off64_t at)
{
    __atomic_add_fetch(&file_calls, 1, __ATOMIC_SEQ_CST);
    return syscall(SYS_pread64, file, to, size, at);
}

ssize_t readv(int file, const struct iovec *to, int count)
{
    __atomic_add_fetch(&file_calls, 1, __ATOMIC_SEQ_CST);
    return syscall(SYS_readv, file, to, count);
}

int open64(const char *path, int flags, ...)
{
    int mode = 0;
    if (flags & O_CREAT) {
        va_list rest;
        va_start(rest, flags);
        mode = va_arg(rest, int);
        va_end(rest);
    }
    __atomic_add_fetch(&file_calls, 1, __ATOMIC_SEQ_CST);
    return (int)syscall(SYS_openat, AT_FDCWD, path, flags, mode);
}

static struct cairn_test_shim *shim = &cairn_test_shim;
static cairn_device *device;

static cairn_device *make_watched_device(void)
{
    cairn_device_options options = {.struct_size = sizeof options, .threads = 1, .flags = CAIRN_DEVICE_DETERMINISTIC,
        .onnxruntime = getenv("CAIRN_TEST_SHIM")};
    cairn_device *made = NULL;
    if (!options.onnxruntime) {
        fprintf(stderr, "set CAIRN_TEST_SHIM to the library of tests/abi/shim; cargo xtask test abi does\n");
        exit(2);
    }
    OK(cairn_device_create_cpu(&options, &made));
    return made;
}

static cairn_rollout *make_seeded(cairn_world *world)
{
    cairn_rollout *rollout = NULL;
    cairn_picture picture = seed_picture();
    OK(cairn_rollout_create(world, NULL, &rollout));
    OK(cairn_rollout_append(rollout, &picture, NULL));
    return rollout;
}

/* ---- Two worlds inside a run at the same time. ---- */
static pthread_mutex_t gate = PTHREAD_MUTEX_INITIALIZER;
static pthread_cond_t arrived = PTHREAD_COND_INITIALIZER;
static int inside, met;

/* Holds a run until another one is inside as well, or for ten seconds. */
static void wait_for_another(unsigned long number)
{
    (void)number;
    struct timespec end;
    clock_gettime(CLOCK_REALTIME, &end);
    end.tv_sec += 10;
    pthread_mutex_lock(&gate);
    inside++;
    if (inside == 2) {
        met = 1;
        pthread_cond_broadcast(&arrived);
    }
    while (!met && pthread_cond_timedwait(&arrived, &gate, &end) == 0) {
    }
    inside--;
    pthread_mutex_unlock(&gate);
}

static void *step_once(void *rollout)
{
    cairn_controls c = controls(1);
    OK(cairn_rollout_step(rollout, &c, NULL));
    return NULL;
}

static void two_worlds_run_in_parallel(void)
{
    cairn_world *worlds[2] = {make_world(device), make_world(device)};
    cairn_rollout *rollouts[2] = {make_seeded(worlds[0]), make_seeded(worlds[1])};
    pthread_t threads[2];
    shim->inside_run = wait_for_another;
    for (int i = 0; i < 2; i++) CHECK(pthread_create(&threads[i], NULL, step_once, rollouts[i]) == 0);
    for (int i = 0; i < 2; i++) pthread_join(threads[i], NULL);
    shim->inside_run = NULL;
    CHECK(met);
    for (int i = 0; i < 2; i++) {
        OK(cairn_rollout_destroy(rollouts[i]));
        OK(cairn_world_destroy(worlds[i]));
    }
}

/* ---- A cancelled load. ---- */
static unsigned long reports, last_report, calls_then, sessions_then;

static uint32_t stop_at_last(const cairn_load_progress *progress, void *user)
{
    (void)user;
    CHECK(progress->done <= progress->total);
    if (++reports < last_report) return 0;
    calls_then = __atomic_load_n(&file_calls, __ATOMIC_SEQ_CST);
    sessions_then = shim->sessions;
    return 1;
}

static cairn_result load(unsigned long stop, cairn_world **world)
{
    cairn_world_options options = {.struct_size = sizeof options, .path = world_path(), .progress = stop_at_last};
    options.operating_point = "stock,g16,native,pictures:1";
    reports = 0;
    last_report = stop;
    return cairn_world_load(device, &options, world);
}

static void a_cancelled_load_reads_no_file_and_creates_no_session(void)
{
    cairn_world *world = NULL;
    file_calls = 0;
    unsigned long sessions = shim->sessions;
    OK(load(~0ul, &world));
    OK(cairn_world_destroy(world));
    unsigned long all = reports;
    CHECK(file_calls > 8 && shim->sessions == sessions + 5 && all >= 8);
    for (unsigned long moment = 0; moment < 20; moment++) {
        world = NULL;
        unsigned long stop = 1 + moment * (all - 1) / 19;
        ANSWERS(CAIRN_ERROR_CANCELLED, load(stop, &world));
        CHECK(world == NULL && reports == stop);
        CHECK(file_calls == calls_then && shim->sessions == sessions_then);
        if (failed_checks) return;
        if (moment % 5 == 0) {
            OK(load(~0ul, &world));
            cairn_rollout *rollout = make_seeded(world);
            OK(cairn_rollout_destroy(rollout));
            OK(cairn_world_destroy(world));
        }
    }
}

/* ---- A cancelled rollout. ---- */
static cairn_rollout *stopped;
static unsigned long last_run, runs_then;

static void cancel_at_last(unsigned long number)
{
    if (number == last_run) {
        OK(cairn_rollout_cancel(stopped));
        runs_then = number;
    }
}

static void a_cancelled_rollout_starts_no_run(void)
{
    cairn_world *world = make_world(device);
    unsigned long total = 0;
    for (unsigned long moment = 0; moment <= 20; moment++) {
        stopped = make_seeded(world);
        cairn_controls c = controls(2);
        uint64_t tickets[4];
        OK(cairn_rollout_pause(stopped));
        for (int i = 0; i < 4; i++) OK(cairn_rollout_submit(stopped, &c, &tickets[i]));
        unsigned long before = shim->runs;
        /* The first time nothing is cancelled, to count the runs. */
        last_run = moment == 0 ? 0 : before + 1 + (moment - 1) * (total - 1) / 19;
        shim->inside_run = cancel_at_last;
        OK(cairn_rollout_resume(stopped));
        int made = 0;
        for (int i = 0; i < 4; i++) {
            cairn_result r = cairn_rollout_wait(stopped, tickets[i], CAIRN_FOREVER, NULL, NULL);
            CHECK(r == CAIRN_OK || r == CAIRN_ERROR_CANCELLED);
            made += r == CAIRN_OK;
        }
        shim->inside_run = NULL;
        if (moment == 0) {
            total = shim->runs - before;
            CHECK(made == 4 && total >= 20);
        } else {
            CHECK(shim->runs == last_run && runs_then == last_run);
            CHECK((made == 4) == (last_run == before + total));
        }
        /* Later requests are executed. */
        OK(cairn_rollout_step(stopped, &c, NULL));
        OK(cairn_rollout_destroy(stopped));
    }
    OK(cairn_world_destroy(world));
}

static void a_failed_run_leaves_the_rollout_unchanged(void)
{
    cairn_world *world = make_world(device);
    cairn_rollout *rollout = make_seeded(world);
    cairn_controls c = controls(3);
    for (unsigned long n = 1; n <= 6; n++) {
        cairn_rollout_info was = {.struct_size = sizeof was}, is = was;
        OK(cairn_rollout_get_info(rollout, &was));
        shim->fail_run = shim->runs + n;
        cairn_result r = cairn_rollout_step(rollout, &c, NULL);
        CHECK(r == CAIRN_OK || r == CAIRN_ERROR_DEVICE);
        CHECK(r == CAIRN_OK || strstr(message(), "a fault made by a test"));
        OK(cairn_rollout_get_info(rollout, &is));
        CHECK(is.latents == was.latents + (r == CAIRN_OK));
        shim->fail_run = 0;
        OK(cairn_rollout_step(rollout, &c, NULL));
    }
    OK(cairn_rollout_destroy(rollout));
    OK(cairn_world_destroy(world));
}

int main(void)
{
    device = make_watched_device();
    RUN(two_worlds_run_in_parallel);
    RUN(a_cancelled_load_reads_no_file_and_creates_no_session);
    RUN(a_cancelled_rollout_starts_no_run);
    RUN(a_failed_run_leaves_the_rollout_unchanged);
    OK(cairn_device_destroy(device));
    return failed_tests != 0;
}
