/**
 * Loads Cairn at run time instead of linking against it. This header needs only cairn.h, and works in C11 and C++17. A program that uses
 * it starts even if the library is missing, and can tell its user so.
 *
 *     cairn_ld cairn;
 *     char message[1024];
 *     if (cairn_ld_load(&cairn, "plugins/libcairn.so", message, sizeof message) != CAIRN_OK) {
 *         fprintf(stderr, "%s\n", message);
 *         return 1;
 *     }
 *     cairn_device *device = NULL;
 *     cairn_result r = cairn.cairn_device_create_cpu(NULL, &device);
 *     ...
 *     cairn_ld_unload(&cairn);
 *
 * cairn_ld_load resolves every function of cairn.h, so no pointer is null afterwards, except those of experimental functions if the
 * library is not of exactly the version of cairn.h. It fails, with a message, if the library cannot be loaded, has another binary
 * interface, is older than cairn.h or lacks a function; then nothing stays loaded.
 *
 * Where dlopen is not part of the C library, link with -ldl.
 */

#ifndef CAIRN_LD_H
#define CAIRN_LD_H

#include <stdio.h>
#include <string.h>

#if defined(_WIN32)
/* The library is not linked against, so nothing is imported. */
#ifndef CAIRN_STATIC
#define CAIRN_STATIC
#define CAIRN_LD_STATIC
#endif
#include "cairn.h"
#ifdef CAIRN_LD_STATIC
#undef CAIRN_STATIC
#undef CAIRN_LD_STATIC
#endif
#ifndef WIN32_LEAN_AND_MEAN
#define WIN32_LEAN_AND_MEAN
#endif
#ifndef NOMINMAX
#define NOMINMAX
#endif
#include <windows.h>
#else
#include "cairn.h"
#include <dlfcn.h>
#endif

#ifdef __cplusplus
extern "C" {
#endif

/* Every function of cairn.h: its result, name and parameters. `cargo xtask fix` generates the lists. */
#define CAIRN_LD_FUNCTIONS(X) \
    X(uint32_t, cairn_abi_version, (void)) \
    X(uint32_t, cairn_version, (void)) \
    X(const char *, cairn_result_name, (cairn_result result)) \
    X(cairn_result, cairn_last_error, (char *text, size_t capacity, size_t *length)) \
    X(cairn_result, cairn_last_error_part, (uint32_t part, char *text, size_t capacity, size_t *length)) \
    X(cairn_result, cairn_set_log_callback, (uint32_t level, cairn_log_callback callback, void *user)) \
    X(cairn_result, cairn_set_threads, (const cairn_thread_options *options)) \
    X(cairn_result, cairn_set_scheduler, (const cairn_scheduler *scheduler)) \
    X(cairn_result, cairn_device_create_cpu, (const cairn_device_options *options, cairn_device **device)) \
    X(cairn_result, cairn_device_get_info, (const cairn_device *device, cairn_device_info *info)) \
    X(cairn_result, cairn_device_destroy, (cairn_device *device)) \
    X(cairn_result, cairn_adapters, (cairn_adapter *adapters, size_t stride, uint32_t capacity, uint32_t *count)) \
    X(cairn_result, cairn_device_requirements, (uint32_t kind, const cairn_device_options *options, cairn_requirement *requirements, size_t stride, uint32_t capacity, uint32_t *count)) \
    X(cairn_result, cairn_world_load, (const cairn_device *device, const cairn_world_options *options, cairn_world **world)) \
    X(cairn_result, cairn_world_get_info, (const cairn_world *world, cairn_world_info *info)) \
    X(cairn_result, cairn_world_get_memory, (const cairn_world *world, cairn_world_memory *memory)) \
    X(cairn_result, cairn_world_get_licence, (const cairn_world *world, char *text, size_t capacity, size_t *length)) \
    X(cairn_result, cairn_world_destroy, (cairn_world *world)) \
    X(cairn_result, cairn_anchor_create, (const cairn_picture *picture, uint64_t number, uint32_t flags, cairn_anchor **anchor)) \
    X(cairn_result, cairn_anchor_get_info, (const cairn_anchor *anchor, cairn_anchor_info *info)) \
    X(cairn_result, cairn_anchor_read_picture, (const cairn_anchor *anchor, uint32_t index, const cairn_target *target)) \
    X(cairn_result, cairn_anchor_read_latent, (const cairn_anchor *anchor, float *values, size_t count)) \
    X(cairn_result, cairn_anchor_destroy, (cairn_anchor *anchor)) \
    X(cairn_result, cairn_rollout_create, (const cairn_world *world, const cairn_rollout_options *options, cairn_rollout **rollout)) \
    X(cairn_result, cairn_rollout_destroy, (cairn_rollout *rollout)) \
    X(cairn_result, cairn_rollout_get_info, (const cairn_rollout *rollout, cairn_rollout_info *info)) \
    X(cairn_result, cairn_rollout_append, (cairn_rollout *rollout, const cairn_picture *picture, cairn_step_info *info)) \
    X(cairn_result, cairn_rollout_append_pictures, (cairn_rollout *rollout, const cairn_picture *pictures, uint32_t count, cairn_step_info *info)) \
    X(cairn_result, cairn_rollout_keep_encoder_stream, (cairn_rollout *rollout, uint32_t keep)) \
    X(cairn_result, cairn_rollout_step, (cairn_rollout *rollout, const cairn_controls *controls, cairn_step_info *info)) \
    X(cairn_result, cairn_rollout_reset, (cairn_rollout *rollout)) \
    X(cairn_result, cairn_rollout_rest, (cairn_rollout *rollout)) \
    X(cairn_result, cairn_rollout_set_budget, (cairn_rollout *rollout, uint64_t latent_ns, const char *schedules)) \
    X(cairn_result, cairn_rollout_get_anchor, (const cairn_rollout *rollout, cairn_anchor **anchor)) \
    X(cairn_result, cairn_rollout_submit, (const cairn_rollout *rollout, const cairn_controls *controls, uint64_t *ticket)) \
    X(cairn_result, cairn_rollout_submit_picture, (const cairn_rollout *rollout, const cairn_picture *picture, uint64_t *ticket)) \
    X(cairn_result, cairn_rollout_submit_pictures, (const cairn_rollout *rollout, const cairn_picture *pictures, uint32_t count, uint64_t *ticket)) \
    X(cairn_result, cairn_rollout_poll, (const cairn_rollout *rollout, uint64_t ticket, cairn_step_info *info, cairn_anchor **anchor)) \
    X(cairn_result, cairn_rollout_wait, (const cairn_rollout *rollout, uint64_t ticket, uint64_t timeout_ns, cairn_step_info *info, cairn_anchor **anchor)) \
    X(cairn_result, cairn_rollout_cancel, (const cairn_rollout *rollout)) \
    X(cairn_result, cairn_rollout_pause, (const cairn_rollout *rollout)) \
    X(cairn_result, cairn_rollout_resume, (const cairn_rollout *rollout)) \
    X(cairn_result, cairn_rollout_single_step, (const cairn_rollout *rollout)) \
    X(cairn_result, cairn_rollout_save, (const cairn_rollout *rollout, void *bytes, size_t capacity, size_t *size)) \
    X(cairn_result, cairn_rollout_save_file, (const cairn_rollout *rollout, const char *path)) \
    X(cairn_result, cairn_rollout_restore, (cairn_rollout *rollout, const void *bytes, size_t size)) \
    X(cairn_result, cairn_rollout_restore_file, (cairn_rollout *rollout, const char *path)) \
    X(cairn_result, cairn_guidance_create, (const cairn_anchor *previous, const cairn_anchor *current, uint32_t source, cairn_guidance **guidance)) \
    X(cairn_result, cairn_guidance_create_from_host, (const cairn_guidance_data *data, cairn_guidance **guidance)) \
    X(cairn_result, cairn_guidance_get_info, (const cairn_guidance *guidance, cairn_guidance_info *info)) \
    X(cairn_result, cairn_guidance_read_motion, (const cairn_guidance *guidance, uint16_t *values, size_t count)) \
    X(cairn_result, cairn_guidance_read_depth, (const cairn_guidance *guidance, float *values, size_t count)) \
    X(cairn_result, cairn_guidance_destroy, (cairn_guidance *guidance)) \
    X(cairn_result, cairn_presenter_create, (const cairn_presenter_options *options, cairn_presenter **presenter)) \
    X(cairn_result, cairn_presenter_push, (const cairn_presenter *presenter, const cairn_anchor *anchor, const cairn_guidance *guidance, uint64_t now_ns)) \
    X(cairn_result, cairn_presenter_query, (const cairn_presenter *presenter, uint64_t now_ns, cairn_frame *frame)) \
    X(cairn_result, cairn_presenter_draw, (cairn_presenter *presenter, uint64_t now_ns, const cairn_target *target, cairn_frame *frame)) \
    X(cairn_result, cairn_presenter_resize, (const cairn_presenter *presenter, uint32_t width, uint32_t height)) \
    X(cairn_result, cairn_presenter_set_overlay, (const cairn_presenter *presenter, const uint8_t *mask, size_t size, uint32_t width, uint32_t height)) \
    X(cairn_result, cairn_presenter_set_budget, (const cairn_presenter *presenter, uint64_t frame_ns)) \
    X(cairn_result, cairn_presenter_reset, (const cairn_presenter *presenter)) \
    X(cairn_result, cairn_presenter_destroy, (cairn_presenter *presenter)) \
    X(cairn_result, cairn_rollout_govern, (cairn_rollout *rollout, const cairn_budget *budget)) \
    X(cairn_result, cairn_script_create, (const char *text, size_t length, cairn_script **script)) \
    X(cairn_result, cairn_script_get_controls, (const cairn_script *script, uint64_t latent, uint32_t latents_per_second, cairn_controls *controls)) \
    X(cairn_result, cairn_script_get_duration, (const cairn_script *script, uint64_t *microseconds)) \
    X(cairn_result, cairn_script_get_text, (const cairn_script *script, char *text, size_t capacity, size_t *length)) \
    X(cairn_result, cairn_script_destroy, (cairn_script *script)) \
    X(cairn_result, cairn_recorder_create, (cairn_recorder **recorder)) \
    X(cairn_result, cairn_recorder_key, (cairn_recorder *recorder, uint64_t microseconds, uint32_t key, uint32_t down)) \
    X(cairn_result, cairn_recorder_mouse, (cairn_recorder *recorder, uint64_t microseconds, float dx, float dy)) \
    X(cairn_result, cairn_recorder_scroll, (cairn_recorder *recorder, uint64_t microseconds, int32_t notches)) \
    X(cairn_result, cairn_recorder_step, (cairn_recorder *recorder, uint64_t latent, uint32_t latents_per_second, const cairn_controls *controls)) \
    X(cairn_result, cairn_recorder_make_script, (cairn_recorder *recorder, uint64_t microseconds, cairn_script **script)) \
    X(cairn_result, cairn_recorder_destroy, (cairn_recorder *recorder)) \
    X(cairn_result, cairn_rollout_get_statistics, (const cairn_rollout *rollout, cairn_rollout_statistics *statistics)) \
    X(cairn_result, cairn_presenter_get_statistics, (const cairn_presenter *presenter, cairn_presenter_statistics *statistics))

/* The experimental ones, likewise. */
#define CAIRN_LD_EXPERIMENTAL(X) \
    X(cairn_result, cairn_device_create_gpu, (const char *adapter, const cairn_device_options *options, cairn_device **device)) \
    X(cairn_result, cairn_device_create_auto, (const cairn_device_options *options, char *refusals, size_t capacity, size_t *length, cairn_device **device)) \
    X(cairn_result, cairn_device_create_d3d12, (struct ID3D12Device *d3d12, struct ID3D12CommandQueue *queue, struct ID3D12CommandQueue *anchors, const cairn_device_options *options, cairn_device **device)) \
    X(cairn_result, cairn_device_create_adapter, (uint64_t luid, const cairn_device_options *options, cairn_device **device)) \
    X(cairn_result, cairn_device_set_d3d12, (const cairn_device *device, const cairn_d3d12_options *options)) \
    X(cairn_result, cairn_device_get_d3d12, (const cairn_device *device, struct ID3D12Device **d3d12, struct ID3D12CommandQueue **queue)) \
    X(cairn_result, cairn_rollout_append_d3d12, (cairn_rollout *rollout, struct ID3D12Resource *picture, uint32_t state, cairn_step_info *info)) \
    X(cairn_result, cairn_anchor_get_d3d12, (const cairn_anchor *anchor, uint32_t index, struct ID3D12Resource **texture, struct ID3D12Fence **fence, uint64_t *value)) \
    X(cairn_result, cairn_presenter_prepare_d3d12, (const cairn_presenter *presenter, const cairn_device *device, const cairn_d3d12_preparation *preparation)) \
    X(cairn_result, cairn_presenter_record_d3d12, (cairn_presenter *presenter, const cairn_device *device, uint64_t now_ns, const cairn_d3d12_recording *recording, cairn_frame *frame)) \
    X(cairn_result, cairn_presenter_submit_d3d12, (cairn_presenter *presenter, const cairn_device *device, uint64_t now_ns, struct ID3D12Resource *target, uint32_t before, uint32_t after, cairn_frame *frame, struct ID3D12Fence **fence, uint64_t *value)) \
    X(cairn_result, cairn_presenter_release_d3d12, (cairn_presenter *presenter)) \
    X(cairn_result, cairn_swapchain_wrap, (const cairn_device *device, const cairn_swapchain_options *options, struct IDXGISwapChain **own, cairn_swapchain **swapchain)) \
    X(cairn_result, cairn_swapchain_create, (const cairn_device *device, const cairn_swapchain_options *options, struct IDXGIFactory *factory, const struct DXGI_SWAP_CHAIN_DESC *description, cairn_swapchain **swapchain)) \
    X(cairn_result, cairn_swapchain_create_for_window, (const cairn_device *device, const cairn_swapchain_options *options, struct IDXGIFactory *factory, void *window, const struct DXGI_SWAP_CHAIN_DESC1 *description, const struct DXGI_SWAP_CHAIN_FULLSCREEN_DESC *fullscreen, cairn_swapchain **swapchain)) \
    X(cairn_result, cairn_swapchain_get_dxgi, (cairn_swapchain *swapchain, struct IDXGISwapChain4 **dxgi)) \
    X(cairn_result, cairn_swapchain_prepare, (cairn_swapchain *swapchain, ID3D12GraphicsCommandList *list, const cairn_swapchain_frame *frame)) \
    X(cairn_result, cairn_swapchain_set_interface, (cairn_swapchain *swapchain, ID3D12Resource *picture, uint32_t state, uint32_t flags)) \
    X(cairn_result, cairn_swapchain_set_pacing, (cairn_swapchain *swapchain, const cairn_swapchain_pacing *pacing)) \
    X(cairn_result, cairn_swapchain_pause, (cairn_swapchain *swapchain)) \
    X(cairn_result, cairn_swapchain_wait, (cairn_swapchain *swapchain)) \
    X(cairn_result, cairn_swapchain_fit, (cairn_swapchain *swapchain)) \
    X(cairn_result, cairn_swapchain_get_statistics, (const cairn_swapchain *swapchain, cairn_swapchain_statistics *statistics)) \
    X(cairn_result, cairn_swapchain_destroy, (cairn_swapchain *swapchain))

/** A loaded library: its functions by their own names. What is not loaded is all zero. */
typedef struct cairn_ld {
    /** What the system calls it; null when nothing is loaded. */
    void *library;
#define CAIRN_LD_MEMBER(result, name, parameters) result(*name) parameters;
    CAIRN_LD_FUNCTIONS(CAIRN_LD_MEMBER)
    CAIRN_LD_EXPERIMENTAL(CAIRN_LD_MEMBER)
#undef CAIRN_LD_MEMBER
} cairn_ld;

/* Inside. */

/** Writes "cairn_ld_load: `path`: `what`" into the caller's buffer, cut to its size; `result` goes back. */
static inline cairn_result cairn_ld_fail(
    cairn_result result, char *message, size_t capacity, const char *path, const char *what, const char *more,
    const char *remedy)
{
    if (message != NULL && capacity > 0) {
        /* A message that is too long for the buffer is cut there, which is what the caller asked for. */
        int length = snprintf(message, capacity, "cairn_ld_load: %s: %s%s. %s", path, what, more, remedy);
        if (length < 0) {
            message[0] = '\0';
        }
    }
    return result;
}

/** The text of a version number, as 1.2.3. */
static inline void cairn_ld_version(uint32_t version, char text[32])
{
    unsigned number = (unsigned)version;
    int length = snprintf(text, 32, "%u.%u.%u", number / 1000000u, number / 1000u % 1000u, number % 1000u);
    if (length < 0) {
        text[0] = '\0';
    }
}

#if defined(_WIN32)

/** Loads a file, given in UTF-8; the system's reason goes into `why` when it cannot. */
static inline void *cairn_ld_open(const char *path, char *why, size_t capacity)
{
    /* The longest path Windows takes, with its NUL. Not on the stack: it is 64 KiB, twice. */
    const DWORD longest = 32768;
    HANDLE heap = GetProcessHeap();
    wchar_t *wide = (wchar_t *)HeapAlloc(heap, 0, 2 * longest * sizeof(wchar_t));
    void *library = NULL;
    if (wide == NULL) {
        (void)snprintf(why, capacity, "no memory for its path");
        return NULL;
    }
    /* Safe search needs an absolute path; it then finds what lies beside the library, and never what lies in the current
       directory or on the PATH. */
    wchar_t *absolute = wide + longest;
    DWORD length = 0;
    if (MultiByteToWideChar(CP_UTF8, MB_ERR_INVALID_CHARS, path, -1, wide, (int)longest) > 0) {
        length = GetFullPathNameW(wide, longest, absolute, NULL);
    }
    if (length == 0 || length >= longest) {
        (void)snprintf(why, capacity, "the path is not UTF-8 or is too long");
    } else if (GetFileAttributesW(absolute) == INVALID_FILE_ATTRIBUTES) {
        (void)snprintf(why, capacity, "there is no such file");
    } else {
        library = (void *)LoadLibraryExW(
            absolute, NULL, LOAD_LIBRARY_SEARCH_DLL_LOAD_DIR | LOAD_LIBRARY_SEARCH_DEFAULT_DIRS);
        if (library == NULL) {
            const unsigned long code = (unsigned long)GetLastError();
            const char *meaning = code == ERROR_MOD_NOT_FOUND     ? ": a library that it needs is missing"
                                  : code == ERROR_BAD_EXE_FORMAT  ? ": it is no library of this kind of processor"
                                  : code == ERROR_ACCESS_DENIED   ? ": it may not be read"
                                  : code == ERROR_PROC_NOT_FOUND  ? ": a library that it needs is of another version"
                                                                  : "";
            (void)snprintf(why, capacity, "Windows answers with error %lu%s", code, meaning);
        }
    }
    HeapFree(heap, 0, wide);
    return library;
}

static inline void *cairn_ld_symbol(void *library, const char *name)
{
    /* A pointer to a function becomes one to an object by way of its bytes: a cast is not C. */
    FARPROC function = GetProcAddress((HMODULE)library, name);
    void *symbol = NULL;
    memcpy(&symbol, &function, sizeof symbol);
    return symbol;
}

static inline void cairn_ld_close(void *library)
{
    FreeLibrary((HMODULE)library);
}

#define CAIRN_LD_FILE "cairn.dll"

#else

/** Loads a file; the system's reason goes into `why` when it cannot. */
static inline void *cairn_ld_open(const char *path, char *why, size_t capacity)
{
    char here[4096];
    if (strchr(path, '/') == NULL) {
        /* A bare name is a file in the current directory, as everywhere; dlopen would search the system for it. */
        const int length = snprintf(here, sizeof here, "./%s", path);
        if (length < 0 || (size_t)length >= sizeof here) {
            (void)snprintf(why, capacity, "the path is too long");
            return NULL;
        }
        path = here;
    }
    void *library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    if (library == NULL) {
        const char *reason = dlerror();
        (void)snprintf(why, capacity, "%s", reason != NULL ? reason : "the system does not say why");
    }
    return library;
}

static inline void *cairn_ld_symbol(void *library, const char *name)
{
    return dlsym(library, name);
}

static inline void cairn_ld_close(void *library)
{
    (void)dlclose(library);
}

#if defined(__APPLE__)
#define CAIRN_LD_FILE "libcairn.dylib"
#else
#define CAIRN_LD_FILE "libcairn.so"
#endif

#endif

/* Use. */

/**
 * Loads the library at `path`, checks that it is the one this program was compiled for (cairn_abi_version equal,
 * cairn_version not older), and resolves all its functions.
 *
 * cairn: is overwritten, so unload a library that it has loaded first.
 * path: of the file; UTF-8 on Windows, elsewhere in the system's encoding. No folders are searched: a name without a directory is a
 * file in the current directory. Libraries that it needs are searched for beside it and in the system's folders.
 * message: at least capacity bytes, or null with capacity 0. Gets the reason of a failure, with the path and what can be done;
 * always ends in a NUL when capacity > 0. Empty on success.
 *
 * Ownership: on success the library is loaded until cairn_ld_unload; on failure nothing is, and cairn is all zero. path is read
 * during the call only.
 * Threads: any thread; one call at a time on the same cairn.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_ARGUMENT for null and an empty path; CAIRN_ERROR_IO when there is no such file or it
 * does not load; CAIRN_ERROR_UNSUPPORTED when it is not Cairn, has another binary interface, is older than cairn.h, or is incomplete.
 * Since: 0.1.0
 */
static inline cairn_result cairn_ld_load(cairn_ld *cairn, const char *path, char *message, size_t capacity)
{
    char why[512];
    char more[128];
    char found[32];
    char wanted[32];
    void *symbol = NULL;
    if (message != NULL && capacity > 0) {
        message[0] = '\0';
    }
    if (cairn != NULL) {
        memset(cairn, 0, sizeof *cairn);
    }
    if (cairn == NULL || path == NULL || path[0] == '\0') {
        return cairn_ld_fail(
            CAIRN_ERROR_INVALID_ARGUMENT, message, capacity, cairn == NULL ? "cairn" : "path",
            cairn != NULL && path != NULL ? "is empty" : "is a null pointer", "",
            "Give a cairn_ld and the path of " CAIRN_LD_FILE);
    }
    void *library = cairn_ld_open(path, why, sizeof why);
    if (library == NULL) {
        return cairn_ld_fail(
            CAIRN_ERROR_IO, message, capacity, path, "the library cannot be loaded: ", why,
            "Put " CAIRN_LD_FILE " there, or give the path of the library");
    }

    uint32_t (*version)(void) = NULL;
    symbol = cairn_ld_symbol(library, "cairn_abi_version");
    if (symbol == NULL) {
        cairn_ld_close(library);
        return cairn_ld_fail(
            CAIRN_ERROR_UNSUPPORTED, message, capacity, path, "this is no Cairn library: it has no cairn_abi_version", "",
            "Name the file that is " CAIRN_LD_FILE);
    }
    memcpy(&version, &symbol, sizeof version);
    const uint32_t abi = version();
    if (abi != CAIRN_ABI_VERSION) {
        (void)snprintf(more, sizeof more, "%u, and this program was compiled for %u", (unsigned)abi, (unsigned)CAIRN_ABI_VERSION);
        cairn_ld_close(library);
        return cairn_ld_fail(
            CAIRN_ERROR_UNSUPPORTED, message, capacity, path, "cairn_abi_version is ", more,
            "Use a library with the same number, or compile the program with that library's cairn.h");
    }
    symbol = cairn_ld_symbol(library, "cairn_version");
    memcpy(&version, &symbol, sizeof version);
    if (symbol != NULL && version() < CAIRN_VERSION) {
        cairn_ld_version(version(), found);
        cairn_ld_version(CAIRN_VERSION, wanted);
        (void)snprintf(more, sizeof more, "%s, and this program was compiled for %s", found, wanted);
        cairn_ld_close(library);
        return cairn_ld_fail(
            CAIRN_ERROR_UNSUPPORTED, message, capacity, path, "cairn_version is ", more, "Use a library that is not older");
    }

    const char *missing = NULL;
#define CAIRN_LD_RESOLVE(result, name, parameters)   \
    symbol = cairn_ld_symbol(library, #name);        \
    memcpy(&cairn->name, &symbol, sizeof cairn->name); \
    if (symbol == NULL && missing == NULL) {         \
        missing = #name;                             \
    }
    CAIRN_LD_FUNCTIONS(CAIRN_LD_RESOLVE)
#undef CAIRN_LD_RESOLVE
    if (missing != NULL) {
        memset(cairn, 0, sizeof *cairn);
        cairn_ld_close(library);
        return cairn_ld_fail(
            CAIRN_ERROR_UNSUPPORTED, message, capacity, path, "the library has no ", missing,
            "Use a complete library of this version");
    }
    /* In another version, an experimental function of the same name may have other parameters. */
    if (cairn->cairn_version() == CAIRN_VERSION) {
#define CAIRN_LD_TRY(result, name, parameters)       \
    symbol = cairn_ld_symbol(library, #name);        \
    memcpy(&cairn->name, &symbol, sizeof cairn->name);
        CAIRN_LD_EXPERIMENTAL(CAIRN_LD_TRY)
#undef CAIRN_LD_TRY
    }
    cairn->library = library;
    return CAIRN_OK;
}

/**
 * Unloads a library. Null, and a cairn without a loaded library, are allowed. Destroy all objects and end logging first: no function
 * of the library may be running. Once a device was created, the system keeps the library in memory until the process ends, and also ONNX
 * Runtime, which calls it; loading it again is then quick.
 *
 * Ownership: on success and on failure alike cairn is all zero, and nothing that came from the library may be used any more.
 * Threads: any thread; one call at a time on the same cairn.
 * Results: none; cannot fail.
 * Since: 0.1.0
 */
static inline void cairn_ld_unload(cairn_ld *cairn)
{
    if (cairn != NULL) {
        if (cairn->library != NULL) {
            cairn_ld_close(cairn->library);
        }
        memset(cairn, 0, sizeof *cairn);
    }
}

#ifdef __cplusplus
} /* extern "C" */
#endif

#endif /* CAIRN_LD_H */
