/* The n-th allocation of an external size, file operation or call of ONNX Runtime fails, once and then permanently, for every n up to
   the end of a whole rollout. After each failure all objects are intact, and the next rollout gives the usual result. */
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <link.h>
#include <stdarg.h>
#include <stdint.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

#include "check.h"
#include "shim/onnxruntime.h"

/* ---- Failures: the library's calls come here, since the program's functions override those of the C library. ---- */
enum kind { NOTHING, ALLOCATIONS, FILES, RUNTIME };
static enum kind failing;
static int permanent;
/* For the failing kind of call: the number of calls, and the one that fails. */
static unsigned long calls, nth;
/* Set only while the library is called. It does nothing in parallel here, so n means the same call every time. */
static int in_library;

static int fails(enum kind kind)
{
    if (failing != kind || !in_library) return 0;
    unsigned long number = ++calls;
    return nth != 0 && (number == nth || (permanent && number > nth));
}

/* Smaller allocations do not depend on external sizes: they are text and bookkeeping, for which running out of memory ends the program. */
enum { SMALLEST_EXTERNAL = 20480 };

/* Address range of the library: only its own calls fail. ONNX Runtime's failures are simulated by its calls. */
static struct { uintptr_t from, to; } library;

static int find_library(struct dl_phdr_info *info, size_t size, void *unused)
{
    (void)size, (void)unused;
    for (int i = 0; strstr(info->dlpi_name, "libcairn") && i < info->dlpi_phnum; i++) {
        if (!(info->dlpi_phdr[i].p_flags & PF_X)) continue;
        library.from = info->dlpi_addr + info->dlpi_phdr[i].p_vaddr;
        library.to = library.from + info->dlpi_phdr[i].p_memsz;
    }
    return 0;
}

static int allocation_fails(size_t size, void *caller)
{
    int ours = (uintptr_t)caller >= library.from && (uintptr_t)caller < library.to;
    return size >= SMALLEST_EXTERNAL && ours && fails(ALLOCATIONS);
}

extern void *__libc_malloc(size_t size);
extern void *__libc_calloc(size_t count, size_t size);
extern void *__libc_realloc(void *old, size_t size);
extern void *__libc_memalign(size_t alignment, size_t size);

void *malloc(size_t size)
{
    return allocation_fails(size, __builtin_return_address(0)) ? NULL : __libc_malloc(size);
}

void *calloc(size_t count, size_t size)
{
    return allocation_fails(count * size, __builtin_return_address(0)) ? NULL : __libc_calloc(count, size);
}

void *realloc(void *old, size_t size)
{
    return allocation_fails(size, __builtin_return_address(0)) ? NULL : __libc_realloc(old, size);
}

int posix_memalign(void **to, size_t alignment, size_t size)
{
    void *made = allocation_fails(size, __builtin_return_address(0)) ? NULL : __libc_memalign(alignment, size);
    if (made) *to = made;
    return made ? 0 : ENOMEM;
}

static long refuse(void)
{
    errno = EIO;
    return -1;
}

ssize_t read(int file, void *to, size_t size)
{
    return fails(FILES) ? refuse() : syscall(SYS_read, file, to, size);
}

ssize_t write(int file, const void *from, size_t size)
{
    return file > 2 && fails(FILES) ? refuse() : syscall(SYS_write, file, from, size);
}

ssize_t pread64(int file, void *to, size_t size, off64_t at)
{
    return fails(FILES) ? refuse() : syscall(SYS_pread64, file, to, size, at);
}

ssize_t readv(int file, const struct iovec *to, int count)
{
    return fails(FILES) ? refuse() : syscall(SYS_readv, file, to, count);
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
    return (int)(fails(FILES) ? refuse() : syscall(SYS_openat, AT_FDCWD, path, flags, mode));
}

int statx(int folder, const char *path, int flags, unsigned mask, struct statx *to)
{
    return (int)(fails(FILES) ? refuse() : syscall(SYS_statx, folder, path, flags, mask, to));
}

int fsync(int file)
{
    return (int)(fails(FILES) ? refuse() : syscall(SYS_fsync, file));
}

int rename(const char *from, const char *to)
{
    return (int)(fails(FILES) ? refuse() : syscall(SYS_rename, from, to));
}

static int runtime_fails(void)
{
    return fails(RUNTIME);
}

/* ---- A whole rollout: load, start, seed, direct and queued steps, save, restore. ---- */
#define STATE "fail-nth-state.bin"
static cairn_device *device;

/* All objects of a rollout; `end` destroys each. */
struct all {
    cairn_world *world;
    cairn_rollout *rollout;
    cairn_anchor *anchor;
    unsigned char *state;
    size_t size;
};

static void end(struct all *all)
{
    OK(cairn_anchor_destroy(all->anchor));
    OK(cairn_rollout_destroy(all->rollout));
    OK(cairn_world_destroy(all->world));
    free(all->state);
}

static cairn_result load(struct all *all)
{
    cairn_world_options options = {
        .struct_size = sizeof options, .path = world_path(), .operating_point = "stock,g16,native,pictures:1"};
    return cairn_world_load(device, &options, &all->world);
}

static cairn_result step(struct all *all)
{
    cairn_controls c = controls(1);
    return cairn_rollout_step(all->rollout, &c, NULL);
}

/* Steps on the rollout's own thread. */
static cairn_result queue(struct all *all)
{
    cairn_controls c = controls(2);
    uint64_t ticket = 0;
    cairn_anchor *taken = NULL;
    cairn_result r = cairn_rollout_submit(all->rollout, &c, &ticket);
    if (r == CAIRN_OK) r = cairn_rollout_wait(all->rollout, ticket, CAIRN_FOREVER, NULL, &taken);
    CHECK((r == CAIRN_OK) == (taken != NULL));
    OK(cairn_anchor_destroy(taken));
    return r;
}

static cairn_result create(struct all *all)
{
    return cairn_rollout_create(all->world, NULL, &all->rollout);
}

static cairn_result seed(struct all *all)
{
    cairn_picture picture = seed_picture();
    return cairn_rollout_append(all->rollout, &picture, NULL);
}

static cairn_result get_anchor(struct all *all)
{
    cairn_anchor *taken = NULL;
    cairn_result r = cairn_rollout_get_anchor(all->rollout, &taken);
    CHECK((r == CAIRN_OK) == (taken != NULL));
    OK(cairn_anchor_destroy(taken));
    return r;
}

static cairn_result save(struct all *all)
{
    return cairn_rollout_save_file(all->rollout, STATE);
}

static cairn_result restore(struct all *all)
{
    return cairn_rollout_restore_file(all->rollout, STATE);
}

static cairn_result reset(struct all *all)
{
    return cairn_rollout_reset(all->rollout);
}

/* A part of a rollout; a failed part leaves everything unchanged. */
typedef cairn_result (*rollout_part)(struct all *all);
static const rollout_part rollout_parts[] = {load,    create, seed,  get_anchor, step, get_anchor, save,
                                             step,    restore, queue, reset,     seed, step};
enum { PARTS = sizeof rollout_parts / sizeof rollout_parts[0] };

static uint64_t fingerprint(struct all *all)
{
    OK(cairn_rollout_save(all->rollout, NULL, 0, &all->size));
    all->state = realloc(all->state, all->size);
    OK(cairn_rollout_save(all->rollout, all->state, all->size, &all->size));
    uint64_t print = 1469598103934665603ull;
    for (size_t i = 0; i < all->size; i++) print = (print ^ all->state[i]) * 1099511628211ull;
    return print;
}

/* Fingerprint of every complete rollout. */
static uint64_t complete_fingerprint;

static int is_expected_error(enum kind kind, cairn_result r)
{
    if (kind == ALLOCATIONS) return r == CAIRN_ERROR_OUT_OF_MEMORY || r == CAIRN_ERROR_DEVICE;
    if (kind == FILES) return r == CAIRN_ERROR_IO;
    return r == CAIRN_ERROR_DEVICE || r == CAIRN_ERROR_OUT_OF_MEMORY || r == CAIRN_ERROR_INVALID_BUNDLE;
}

/* Runs a rollout while the n-th call fails; a failed part is repeated without failures. Returns whether call n was reached. */
static int play(enum kind kind, unsigned long n, int always)
{
    struct all all = {0};
    calls = 0;
    for (int i = 0; i < PARTS; i++) {
        int living = all.rollout != NULL;
        uint64_t before = living ? fingerprint(&all) : 0;
        failing = kind, nth = n, permanent = always, in_library = 1;
        cairn_result r = rollout_parts[i](&all);
        in_library = 0, failing = NOTHING;
        if (r == CAIRN_OK) continue;
        if (!is_expected_error(kind, r) || strncmp(message(), "cairn_", 6)) {
            fprintf(stderr, "part %d with fault %lu of kind %d: %s (%s)\n", i, n, (int)kind, cairn_result_name(r), message());
            CHECK(!"the answer tells of the fault");
        }
        if (living && fingerprint(&all) != before) {
            fprintf(stderr, "part %d with fault %lu of kind %d has left something behind\n", i, n, (int)kind);
            CHECK(!"the rollout is as it was");
        }
        CHECK(access(STATE ".unfinished", F_OK) != 0);
        OK(rollout_parts[i](&all));
        if (always) nth = n = 0; /* the fault has been seen */
    }
    int reached = n == 0 || calls >= n;
    CHECK(fingerprint(&all) == complete_fingerprint);
    end(&all);
    return reached;
}

static unsigned long faults;

/* Whether the device is an adapter that the processor emulates, on which a rollout takes seconds. */
static int is_slow;

/* Fails one in `stride` of all n; in the long form every one, or a few on a slow device. */
static void fail_each(enum kind kind, unsigned long stride)
{
    if (getenv("CAIRN_THOROUGH")) stride = 1;
    struct all all = {0};
    failing = kind, nth = 0, calls = 0, in_library = 1;
    for (int i = 0; i < PARTS; i++) OK(rollout_parts[i](&all));
    in_library = 0, failing = NOTHING;
    unsigned long total = calls;
    complete_fingerprint = fingerprint(&all);
    end(&all);
    CHECK(total >= 10);
    if (is_slow) stride = total / 20;
    for (unsigned long n = 1; n <= total && !failed_checks; n += stride) {
        CHECK(play(kind, n, 0));
        play(kind, n, 1);
        faults += 2;
    }
    fprintf(stderr, "%lu of this kind in a rollout\n", total);
}

static void every_allocation_may_fail(void) { fail_each(ALLOCATIONS, 5); }
static void every_file_operation_may_fail(void) { fail_each(FILES, 3); }
static void every_call_of_the_runtime_may_fail(void) { fail_each(RUNTIME, 17); }

int main(void)
{
    cairn_device_options options = {.struct_size = sizeof options, .threads = 1, .flags = CAIRN_DEVICE_DETERMINISTIC,
        .onnxruntime = getenv("CAIRN_TEST_SHIM")};
    if (!options.onnxruntime) {
        fprintf(stderr, "set CAIRN_TEST_SHIM to the library of tests/abi/shim; cargo xtask test abi does\n");
        return 2;
    }
    cairn_test_shim.fails = runtime_fails;
    dl_iterate_phdr(find_library, NULL);
    const char *kind = getenv("CAIRN_TEST_DEVICE");
    is_slow = kind && strcmp(kind, "webgpu") == 0;
    if (is_slow) {
        options.webgpu = getenv("CAIRN_WEBGPU");
        OK(cairn_device_create_gpu("llvmpipe", &options, &device));
    } else {
        OK(cairn_device_create_cpu(&options, &device));
    }
    RUN(every_allocation_may_fail);
    RUN(every_file_operation_may_fail);
    RUN(every_call_of_the_runtime_may_fail);
    OK(cairn_device_destroy(device));
    return failed_tests != 0;
}
