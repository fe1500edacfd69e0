/* Made from src/abi by `cargo xtask fix`; changes here are lost. */

/**
 * Cairn: a generative world inside a game engine. A world model makes few pictures of high quality (anchors) from the player's
 * controls, and motion-guided frame generation makes the frames between them. This header declares the whole interface: link
 * against the shared library, or load it at run time.
 *
 * Read it from the top: first version, results and logging, then what is created once (device, world), what is called in every
 * frame (pictures and controls, anchors, rollouts, guidance, presenters), statistics, and last what is experimental and may change.
 *
 * A rollout, from a seed picture to the pictures of one second:
 *
 *     cairn_result play(const char *path, const cairn_picture *seed, const cairn_target *target)
 *     {
 *         cairn_device *device = NULL;
 *         cairn_world *world = NULL;
 *         cairn_rollout *rollout = NULL;
 *         cairn_world_options options = {.struct_size = sizeof options, .path = path};
 *         cairn_controls walk = {.struct_size = sizeof walk, .keys = {0, 1ull << 23}}; // W
 *         cairn_result r = cairn_device_create_cpu(NULL, &device);
 *         if (r == CAIRN_OK) r = cairn_world_load(device, &options, &world);
 *         if (r == CAIRN_OK) r = cairn_rollout_create(world, NULL, &rollout);
 *         if (r == CAIRN_OK) r = cairn_rollout_append(rollout, seed, NULL);
 *         for (int i = 0; i < 15 && r == CAIRN_OK; i++) {
 *             cairn_anchor *anchor = NULL;
 *             r = cairn_rollout_step(rollout, &walk, NULL);
 *             if (r == CAIRN_OK) r = cairn_rollout_get_anchor(rollout, &anchor);
 *             if (r == CAIRN_OK) r = cairn_anchor_read_picture(anchor, 0, target);
 *             cairn_anchor_destroy(anchor); // what can be destroyed may be null
 *         }
 *         cairn_rollout_destroy(rollout);
 *         cairn_world_destroy(world);
 *         cairn_device_destroy(device); // any order will do
 *         return r; // if negative, cairn_last_error() has the message
 *     }
 *
 * These rules hold for all functions:
 *
 * Handles. A pointer to an object, such as cairn_world *, is a number that only the library understands; never dereference it. A
 * handle that is null, destroyed, of another kind or made up gives CAIRN_ERROR_INVALID_HANDLE. Every object with a create function
 * has a destroy function, which accepts null and waits for calls in flight. Objects keep alive what they need, so they may be
 * destroyed in any order.
 *
 * Threads. Functions that take a pointer to const may be called by any number of threads at the same time. Those that take a
 * pointer that is not const allow one call at a time: a concurrent one gets CAIRN_ERROR_BUSY and does nothing. Calls at the wrong
 * time do not corrupt memory.
 *
 * Structs. Set struct_size to the struct's sizeof, also in structs that the library fills, and set unused fields to zero: zero is
 * every field's default. A host compiled with an older header, whose structs are shorter, works with a newer library; a host with
 * newer structs works if it sets nothing that the library does not know. The library never writes past struct_size.
 *
 * Results. 0 is success, a positive number is not an error, a negative one is. In addition to the results named at a function, any
 * function may return CAIRN_ERROR_INTERNAL, any that takes a handle CAIRN_ERROR_POISONED, and any that may return CAIRN_ERROR_DEVICE
 * also CAIRN_ERROR_DEVICE_REMOVED, once the graphics device is lost. A failed call has changed nothing,
 * and has written none of its results. All text is UTF-8.
 *
 * Memory. Unless a function says otherwise, the library reads or writes the caller's memory during the call only. It refuses null
 * and misaligned pointers and buffers that are too short; it cannot detect other invalid pointers.
 *
 * Callbacks are called without a lock held and may call Cairn, but must not destroy an object that a call further up the stack is
 * using, and must not throw. The library starts threads only for objects that need them, and writes files only when asked to.
 */

#ifndef CAIRN_H
#define CAIRN_H

#include <stddef.h>
#include <stdint.h>

/* Define CAIRN_STATIC where the library is linked statically. */
#if defined(_WIN32) && !defined(CAIRN_STATIC)
#define CAIRN_API __declspec(dllimport)
#else
#define CAIRN_API
#endif

#ifdef __cplusplus
extern "C" {
#endif

/* ---- 1. Version -------------------------------------------------------------------------------------------------- */

/**
 * The version of the binary interface that this header declares. Compare it with cairn_abi_version() of the loaded library.
 *
 * History: 1 was the first; since 2, devices are created with cairn_device_options.
 */
#define CAIRN_ABI_VERSION 2
/** The version of the library that this header belongs to: major * 1000000 + minor * 1000 + patch. */
#define CAIRN_VERSION 1000

/**
 * The version of the loaded library's binary interface. If it differs from CAIRN_ABI_VERSION of the header, call nothing else:
 * structs or functions have changed.
 *
 * Ownership: nothing is handed over, on success or on failure.
 * Threads: any thread, at any time.
 * Results: the number itself; cannot fail.
 * Since: 0.1.0
 */
CAIRN_API uint32_t cairn_abi_version(void);

/**
 * The version of the loaded library, in the form of CAIRN_VERSION. If the binary interface is equal and the library is not older
 * than the header, the library has everything that the header declares.
 *
 * Ownership: nothing is handed over, on success or on failure.
 * Threads: any thread, at any time.
 * Results: the number itself; cannot fail.
 * Since: 0.1.0
 */
CAIRN_API uint32_t cairn_version(void);

/* ---- 2. Results -------------------------------------------------------------------------------------------------- */

/** A part of the last error: the name of the function that failed. */
#define CAIRN_LAST_ERROR_FUNCTION 1
/** A part of the last error: the argument, file or field that is wrong, such as "options.threads". */
#define CAIRN_LAST_ERROR_FIELD 2
/** A part of the last error: what is wrong, one sentence without a final stop. */
#define CAIRN_LAST_ERROR_CAUSE 3
/** A part of the last error: what can be done, an imperative sentence without a final stop. */
#define CAIRN_LAST_ERROR_REMEDY 4

/**
 * The result of a call: 0 is success, a positive number is not an error, a negative one is. A number never gets another meaning;
 * a newer library may return numbers that this header does not know, whose sign has the same meaning.
 */
typedef int32_t cairn_result;

/** Success. */
#define CAIRN_OK 0
/** Not an error: the result is not available yet. Ask again later. */
#define CAIRN_NOT_READY 1
/** Not an error: a text was longer than the buffer, which holds its beginning. */
#define CAIRN_TRUNCATED 2
/** Not an error: the queue is full and nothing was added to it. Take results from it, then try again. */
#define CAIRN_QUEUE_FULL 3
/** An argument is outside its range, not finite, null, misaligned or not UTF-8. The message names it. */
#define CAIRN_ERROR_INVALID_ARGUMENT (-1)
/** The handle is null, was destroyed, belongs to another kind of object, or never was one. */
#define CAIRN_ERROR_INVALID_HANDLE (-2)
/** A struct_size is not one that the struct has had, or it is larger and sets bytes that this library does not know. */
#define CAIRN_ERROR_STRUCT_SIZE (-3)
/** The object is in use by a call that allows no other beside it. Nothing was done. */
#define CAIRN_ERROR_BUSY (-4)
/** A valid request that this build, platform, device or world cannot serve. */
#define CAIRN_ERROR_UNSUPPORTED (-5)
/** More memory is needed than is available or allowed. The message has the numbers. */
#define CAIRN_ERROR_OUT_OF_MEMORY (-6)
/** The operating system refused a file operation. */
#define CAIRN_ERROR_IO (-7)
/** The world's bundle is damaged, tampered with, or breaks the format. */
#define CAIRN_ERROR_INVALID_BUNDLE (-8)
/** ONNX Runtime, or AMD's libraries for a call that needs them, is missing or has the wrong version. */
#define CAIRN_ERROR_RUNTIME_MISSING (-9)
/** ONNX Runtime or the device failed while running. */
#define CAIRN_ERROR_DEVICE (-10)
/** A saved state is damaged, or belongs to another world. */
#define CAIRN_ERROR_INVALID_STATE (-11)
/** The host cancelled the work. */
#define CAIRN_ERROR_CANCELLED (-12)
/** An earlier call on this object failed by a fault of the library. The object can only be destroyed. */
#define CAIRN_ERROR_POISONED (-13)

/**
 * A fault of the library. The objects that the call was using are poisoned; all others still work. Please report the message.
 */
#define CAIRN_ERROR_INTERNAL (-14)

/**
 * The graphics device was removed: for example, its driver was replaced, a command hung, or the adapter was taken out. The message
 * has the reason. Destroy everything that was made on the device, and create a new one.
 */
#define CAIRN_ERROR_DEVICE_REMOVED (-15)

/**
 * The name of a result, such as "CAIRN_ERROR_IO"; "unknown result" for a number that this library never returns.
 *
 * Ownership: the text is static and must not be freed, on success or on failure.
 * Threads: any thread, at any time.
 * Results: the text; never null, cannot fail.
 * Since: 0.1.0
 */
CAIRN_API const char *cairn_result_name(cairn_result result);

/**
 * The message of the calling thread's latest failed call: what went wrong, with which argument or file, and what can be done. It
 * begins with the name of the function. Empty when no call of this thread has failed yet. Successful calls do not change it.
 *
 * text: at least capacity bytes, or null with capacity 0 to learn the length. Always ends in a NUL when capacity > 0.
 * length: gets the length in bytes of the whole message, without the NUL; may be null.
 *
 * Ownership: the text is copied; on failure nothing is written.
 * Threads: any thread, at any time; each thread has its own message.
 * Results: CAIRN_OK; CAIRN_TRUNCATED; CAIRN_ERROR_INVALID_ARGUMENT, which leaves the message as it was.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_last_error(char *text, size_t capacity, size_t *length);

/**
 * One part of the message of cairn_last_error, for hosts that show the parts separately or raise exceptions.
 *
 * part: CAIRN_LAST_ERROR_FUNCTION to CAIRN_LAST_ERROR_REMEDY. A part that the message does not have is empty.
 * text: at least capacity bytes, or null with capacity 0 to learn the length. Always ends in a NUL when capacity > 0.
 * length: gets the length in bytes of the whole part, without the NUL; may be null.
 *
 * Ownership: the text is copied; on failure nothing is written.
 * Threads: any thread, at any time; each thread has its own message.
 * Results: CAIRN_OK; CAIRN_TRUNCATED; CAIRN_ERROR_INVALID_ARGUMENT, also for another part, which leaves the message as it was.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_last_error_part(uint32_t part, char *text, size_t capacity, size_t *length);

/* ---- 3. Logging -------------------------------------------------------------------------------------------------- */

/** No messages. */
#define CAIRN_LOG_OFF 0
/** Something failed. */
#define CAIRN_LOG_ERROR 1
/** Something unexpected happened, and the work continues. */
#define CAIRN_LOG_WARNING 2
/** Information for users. */
#define CAIRN_LOG_INFO 3
/** Information for developers. */
#define CAIRN_LOG_DEBUG 4
/** All messages. */
#define CAIRN_LOG_TRACE 5

/**
 * Gets one message. level is one of CAIRN_LOG_ERROR to CAIRN_LOG_TRACE; target names the part of the library, such as
 * "cairn::onnxruntime"; both texts are UTF-8 and valid during the call only. user is the pointer that was set with the callback.
 *
 * It is called on the thread that logs the message, also on several at once, without any lock held. It may call Cairn, but must not
 * destroy an object that a call further up the stack is using, and must not throw. Messages that its own thread logs while it runs
 * are dropped.
 */
typedef void (*cairn_log_callback)(uint32_t level, const char *target, const char *message, void *user);

/**
 * Sets the callback that gets messages up to level, CAIRN_LOG_OFF to CAIRN_LOG_TRACE. A null callback ends logging. The whole process
 * has one callback; without one nothing is logged.
 *
 * When this returns, the former callback is not running and will not be called again, so the memory of its user pointer may be freed.
 *
 * Ownership: user stays the caller's; on success it must live until another callback is set, on failure nothing changes.
 * Threads: any thread; waits for calls of the former callback. Not from within that callback.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_ARGUMENT for another level; CAIRN_ERROR_BUSY from within the former callback;
 * CAIRN_ERROR_UNSUPPORTED when the library is linked into a program that has set a logger of its own.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_set_log_callback(uint32_t level, cairn_log_callback callback, void *user);

/* ---- 4. Threads -------------------------------------------------------------------------------------------------- */

/**
 * The library's own threads run below normal priority, so that a game's threads run first: THREAD_PRIORITY_BELOW_NORMAL on Windows,
 * a nice value raised by 5 on Linux.
 */
#define CAIRN_PRIORITY_BELOW_NORMAL 0
/** The library's own threads run at normal priority; on Linux at that of the thread whose call starts them. */
#define CAIRN_PRIORITY_NORMAL 1

/**
 * The library's own threads run at the lowest priority: THREAD_PRIORITY_LOWEST on Windows, a nice value raised by 10 on Linux.
 */
#define CAIRN_PRIORITY_LOWEST 2
/** The largest number of the library's own threads, and the largest concurrency of a host's job system. */
#define CAIRN_MAX_THREADS 1024

/**
 * Options of the library's own threads. They share work on pictures with the calling thread: frame generation on the processor,
 * motion, resampling.
 */
typedef struct cairn_thread_options {
    /** sizeof(cairn_thread_options) */
    uint32_t struct_size;
    /**
     * Number of threads, 1 to CAIRN_MAX_THREADS, in addition to the calling ones; 0 for one less than the physical cores that this
     * process may use, but at least one.
     */
    uint32_t threads;
    /** CAIRN_PRIORITY_BELOW_NORMAL, CAIRN_PRIORITY_NORMAL or CAIRN_PRIORITY_LOWEST */
    uint32_t priority;
    /** 0 */
    uint32_t reserved;
} cairn_thread_options;

/**
 * Does one share of the library's work; data is the pointer that cairn_run_callback got. May be called on any thread. If the work is
 * already complete, the call returns at once; it must not come after the library is unloaded.
 */
typedef void (*cairn_job)(void *data);

/**
 * Calls job(data) up to jobs times, on any number of threads at the same time, including the calling one, and returns when these
 * calls have returned. Each call does a different share of the work. When the callback has made fewer calls, or none, the library
 * does the rest on the calling thread, and it waits for calls that have not returned. user is the pointer in cairn_scheduler.
 *
 * It is called on threads that call the library, also on several at once, without any lock held, and never within a job. It may call
 * Cairn, but must not destroy an object that a call further up the stack is using, and must not throw.
 */
typedef void (*cairn_run_callback)(void *user, uint32_t jobs, cairn_job job, void *data);

/** A host's job system. */
typedef struct cairn_scheduler {
    /** sizeof(cairn_scheduler) */
    uint32_t struct_size;
    /** The largest number of jobs that run at the same time, 1 to CAIRN_MAX_THREADS. */
    uint32_t concurrency;
    /** Runs jobs; required. */
    cairn_run_callback run;
    /** Passed to the callback. */
    void *user;
} cairn_scheduler;

/**
 * Sets the number and the priority of the library's own threads, for the whole process. They start with the first work that is
 * shared, and have ended when the call that destroys the last object returns. Their number changes no result.
 *
 * options: may be null for the defaults.
 *
 * Ownership: options stays the caller's, on success and on failure; a failure changes nothing.
 * Threads: any thread, while there is no object of this library.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_BUSY while there is an object.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_set_threads(const cairn_thread_options *options);

/**
 * Makes the library share its work on the host's job system instead of starting threads of its own, for the whole process. This
 * changes no result.
 *
 * scheduler: null for the library's own threads.
 *
 * Ownership: scheduler stays the caller's and is copied; on success its user must live until another is set, on failure nothing
 * changes.
 * Threads: any thread, while there is no object of this library.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_BUSY while there is an object.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_set_scheduler(const cairn_scheduler *scheduler);

/* ---- 5. Create: devices ------------------------------------------------------------------------------------------ */

/** The host's processor, by ONNX Runtime's CPU provider. */
#define CAIRN_DEVICE_CPU 1
/** A Direct3D 12 adapter, by ONNX Runtime's DirectML provider. */
#define CAIRN_DEVICE_D3D12 2
/** A graphics adapter, by ONNX Runtime's WebGPU provider. */
#define CAIRN_DEVICE_WEBGPU 3
/** Float32. */
#define CAIRN_PRECISION_F32 1
/** Float16. */
#define CAIRN_PRECISION_F16 2

/**
 * A flag of cairn_device_options: uses ONNX Runtime's deterministic kernels only. At a fixed thread count its CPU kernels repeat bit
 * for bit without the flag, too. On a Direct3D 12 device it means what CAIRN_D3D12_DETERMINISTIC means. The WebGPU provider has no such
 * kernels: on Intel adapters it may add in another order each time.
 */
#define CAIRN_DEVICE_DETERMINISTIC 1

/**
 * A flag of cairn_device_options: environment variables and the user's cache directory may name libraries, which are loaded into
 * the process. For tools: in a game, anyone who sets its environment variables can run code in it.
 */
#define CAIRN_DEVICE_ENVIRONMENT 2

/** A device that runs worlds. */
typedef struct cairn_device cairn_device;

/**
 * Options of a device, and the paths of the libraries it needs. All zero: one thread for each physical core, and libraries beside
 * this one or beside the program.
 */
typedef struct cairn_device_options {
    /** sizeof(cairn_device_options) */
    uint32_t struct_size;
    /**
     * Threads of a CPU device that share one pass, 1 to 1024, including the caller's; 0 for one for each physical core. The last bits
     * of a rollout's numbers depend on it. Direct3D 12 devices ignore it.
     */
    uint32_t threads;
    /** CAIRN_DEVICE_DETERMINISTIC and CAIRN_DEVICE_ENVIRONMENT, or 0. */
    uint32_t flags;
    /** 0 */
    uint32_t reserved;
    /**
     * Path of the library file of ONNX Runtime 1.24 or newer (tested: 1.24.4 and 1.32.0), UTF-8. A process uses one file only. A host
     * with a Direct3D 12 device needs onnxruntime.dll of onnxruntime-directml 1.24.4, with DirectML.dll beside it, which also runs CPU
     * devices. Null: searches beside this library, then beside the program. With CAIRN_DEVICE_ENVIRONMENT, searches the user's cache
     * directory last; if the environment variable CAIRN_ONNXRUNTIME is set, uses the file it names instead of searching.
     */
    const char *onnxruntime;
    /**
     * Folder of AMD's libraries for FSR, UTF-8, for presenters and swap chains on a Direct3D 12 device. Null: beside this library, else
     * beside the program. With CAIRN_DEVICE_ENVIRONMENT, if the environment variable CAIRN_FFX_DIR is set, only the folder it names.
     */
    const char *ffx;
    /**
     * Path of the library of ONNX Runtime's WebGPU provider, UTF-8, for cairn_device_create_gpu. Null: beside ONNX Runtime's library. With
     * CAIRN_DEVICE_ENVIRONMENT, if the environment variable CAIRN_WEBGPU is set, the file it names.
     */
    const char *webgpu;
} cairn_device_options;

/** Properties of a device. */
typedef struct cairn_device_info {
    /** sizeof(cairn_device_info) */
    uint32_t struct_size;
    /** CAIRN_DEVICE_CPU, CAIRN_DEVICE_D3D12 or CAIRN_DEVICE_WEBGPU */
    uint32_t kind;
    /** Default precision of worlds: CAIRN_PRECISION_F32 or CAIRN_PRECISION_F16 */
    uint32_t precision;
    /** Threads that share one pass. */
    uint32_t threads;
    /** Description for people, such as "ONNX Runtime 1.24.4 CPU, 8 threads"; UTF-8. */
    char description[128];
    /**
     * MiB of its adapter's memory that the system grants to the process at present; may change at any time; 0 if unknown.
     */
    uint32_t memory_budget_mib;
    /** MiB of its adapter's memory that the whole process uses, the host included. */
    uint32_t memory_used_mib;
} cairn_device_info;

/**
 * Creates a device on the host's processor and loads ONNX Runtime. Works on every system.
 *
 * options: may be null for the defaults.
 *
 * Ownership: on success *device is the caller's, for cairn_device_destroy; on failure it is not written. What options point
 * to is read during the call only. ONNX Runtime can be started only once: it stays loaded until the process ends, and so does this
 * library, which it calls.
 * Threads: any thread, at any time. Takes a fraction of a second the first time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_RUNTIME_MISSING when ONNX Runtime is
 * missing, is too old, or computes a small graph wrongly; CAIRN_ERROR_UNSUPPORTED when the process already uses another file of it;
 * CAIRN_ERROR_DEVICE when it does not start.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_device_create_cpu(const cairn_device_options *options, cairn_device **device);

/**
 * Creates a device on a graphics adapter, by ONNX Runtime's WebGPU provider: by Vulkan on Linux, and on Windows by Direct3D 12, or by Vulkan if
 * a copy of the system's vulkan-1.dll lies beside the provider's library. Experimental: this function may change without a new
 * CAIRN_ABI_VERSION. The provider's library is of the PyPI package onnxruntime-ep-webgpu 0.4.0: libonnxruntime_providers_webgpu.so, on Windows
 * onnxruntime_providers_webgpu.dll. Worlds are float16 where the adapter has it.
 *
 * adapter: a part of the adapter's name in any case, its vendor such as "0x1002", or its number among those that Vulkan lists, UTF-8. An adapter
 * that the processor emulates is used only if it is named so. Null for the fastest; it must be null where the provider uses Direct3D 12. All
 * such devices of a process use one adapter, and their work takes turns.
 * options: may be null for the defaults. threads and ffx are not used.
 *
 * Ownership: on success *device is the caller's, for cairn_device_destroy; on failure it is not written. What adapter and options point to is
 * read during the call only. ONNX Runtime, the provider and this library stay loaded until the process ends.
 * Threads: any thread, at any time. Takes a fraction of a second the first time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_ARGUMENT, also when no adapter is named so; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_RUNTIME_MISSING when
 * ONNX Runtime or the provider's library is missing or has another version; CAIRN_ERROR_UNSUPPORTED when there is no such adapter, or the
 * process already uses another one; CAIRN_ERROR_DEVICE when the adapter does not work; CAIRN_ERROR_DEVICE_REMOVED when the process's device is
 * lost and something that was made on it is left: destroy its rollouts, worlds and devices first.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_device_create_gpu(
    const char *adapter, const cairn_device_options *options, cairn_device **device);

/**
 * Creates the best device of this machine: on Windows by DirectML on the first Direct3D 12 adapter, elsewhere and where that is not possible
 * as cairn_device_create_gpu with no name, else on the processor as cairn_device_create_cpu. Adapters that the processor emulates are not taken.
 * A host that has a Direct3D 12 device uses cairn_device_create_d3d12 with that. cairn_device_get_info names the kind that was taken.
 * Experimental: this function may change without a new CAIRN_ABI_VERSION.
 *
 * options: may be null for the defaults. threads are for a CPU device.
 * refusals: gets a line for each better kind that was not taken, with the reason, for people; UTF-8, cut to whole characters. At least capacity
 * bytes, or null with capacity 0. Always ends in a NUL when capacity > 0. The same is in the log.
 * length: gets the length without the NUL; may be null.
 *
 * Ownership: on success *device is the caller's, for cairn_device_destroy; on failure it is not written. What options point to is read during
 * the call only. ONNX Runtime and this library stay loaded until the process ends.
 * Threads: any thread, at any time. Takes up to seconds the first time.
 * Results: CAIRN_OK; CAIRN_TRUNCATED when the device is there and refusals do not fit; else as cairn_device_create_cpu.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_device_create_auto(
    const cairn_device_options *options, char *refusals, size_t capacity, size_t *length, cairn_device **device);

/**
 * Gives the properties of a device.
 *
 * Ownership: info stays the caller's and is filled on success; on failure it is not written.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_device_get_info(const cairn_device *device, cairn_device_info *info);

/**
 * Destroys the handle of a device; null is allowed. Worlds that run on the device keep it alive.
 *
 * Ownership: on success device is no longer a handle; on failure it is unchanged.
 * Threads: any thread; waits for calls in flight on the device. Not from within their callbacks.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_BUSY from within a callback of a call on it.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_device_destroy(cairn_device *device);

/** The operating system and the build of this library. */
#define CAIRN_REQUIREMENT_PLATFORM 1
/** ONNX Runtime's library. */
#define CAIRN_REQUIREMENT_ONNXRUNTIME 2
/** Memory of the system. */
#define CAIRN_REQUIREMENT_MEMORY 3
/** AMD's libraries for FSR: one entry for each file that was found. */
#define CAIRN_REQUIREMENT_FSR_LIBRARIES 4
/** A provider of FSR frame generation for the first adapter. */
#define CAIRN_REQUIREMENT_FSR_PROVIDER 5
/** The system's build number, for FSR. */
#define CAIRN_REQUIREMENT_FSR_SYSTEM 6
/** Direct3D 12's library, for FSR: the system's, or that of the Agility SDK that a program brings. */
#define CAIRN_REQUIREMENT_FSR_DIRECT3D 7
/** The shader model of the first adapter, for FSR. */
#define CAIRN_REQUIREMENT_FSR_SHADER_MODEL 8
/** The library's own shaders on the first adapter, for frames between anchors. */
#define CAIRN_REQUIREMENT_SHADERS 9
/** The library of ONNX Runtime's WebGPU provider. */
#define CAIRN_REQUIREMENT_WEBGPU 10
/** A graphics adapter for the WebGPU provider. */
#define CAIRN_REQUIREMENT_ADAPTER 11
/** The requirement is met. */
#define CAIRN_REQUIREMENT_MET 1
/** The requirement is not met, and the device cannot be created. */
#define CAIRN_REQUIREMENT_NOT_MET 2
/** Whether the requirement is met depends on the world, or the system does not report it. */
#define CAIRN_REQUIREMENT_UNKNOWN 3
/** The requirement is not met, and a device can be created without it; cairn_requirement.needed says what needs it. */
#define CAIRN_REQUIREMENT_OPTIONAL 4

/** A processor or an adapter on which a device can be created. */
typedef struct cairn_adapter {
    /** The stride of the array. */
    uint32_t struct_size;
    /** CAIRN_DEVICE_CPU, CAIRN_DEVICE_D3D12 or CAIRN_DEVICE_WEBGPU */
    uint32_t kind;
    /** Its index among those of its kind, from 0. As text it names a WebGPU adapter for cairn_device_create_gpu. */
    uint32_t index;
    /** 0 */
    uint32_t reserved;
    /** The LUID of a Direct3D 12 adapter, low part first; else 0. */
    uint64_t luid;
    /** Bytes of the adapter's own memory, or for the processor of the system's memory; 0 if unknown. */
    uint64_t memory;
    /** Name, for people; UTF-8. */
    char name[128];
} cairn_adapter;

/** One requirement of a device. */
typedef struct cairn_requirement {
    /** The stride of the array. */
    uint32_t struct_size;
    /** CAIRN_REQUIREMENT_PLATFORM to CAIRN_REQUIREMENT_ADAPTER; a newer library may have more. */
    uint32_t what;
    /** CAIRN_REQUIREMENT_MET, CAIRN_REQUIREMENT_NOT_MET, CAIRN_REQUIREMENT_UNKNOWN or CAIRN_REQUIREMENT_OPTIONAL */
    uint32_t status;
    /** 0 */
    uint32_t reserved;
    /** What is needed, for people; UTF-8. */
    char needed[96];
    /** What was found; UTF-8. */
    char found[512];
} cairn_requirement;

/**
 * Lists what devices can be created on: always the processor, on Windows the Direct3D 12 adapters if this build can use them, and on Linux
 * the adapters that Vulkan lists, which need the library of the WebGPU provider as well (cairn_device_requirements).
 *
 * adapters: an array of capacity elements, stride bytes apart, usually sizeof(cairn_adapter); null with capacity 0 to learn
 * the count.
 * count: gets the total number, which may be more than capacity.
 *
 * Ownership: the array stays the caller's and is filled on success; on failure it is not written.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE for a stride that is no size of cairn_adapter.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_adapters(cairn_adapter *adapters, size_t stride, uint32_t capacity, uint32_t *count);

/**
 * Lists what a device of that kind needs and what was found, so that a player can be shown why a feature is unavailable.
 *
 * kind: CAIRN_DEVICE_CPU, CAIRN_DEVICE_D3D12 or CAIRN_DEVICE_WEBGPU.
 * options: the options that the device would be created with; may be null.
 * requirements: an array of capacity elements, stride bytes apart, usually sizeof(cairn_requirement); null with capacity 0 to
 * learn the count.
 * count: gets the total number, which may be more than capacity.
 *
 * Ownership: the array stays the caller's and is filled on success; on failure it is not written.
 * Threads: any thread, at any time. Searches for ONNX Runtime where options say and loads it as cairn_device_create_cpu does; for
 * CAIRN_DEVICE_D3D12 also AMD's libraries, which stay loaded. Of these, only files that AMD has signed are loaded. For CAIRN_DEVICE_WEBGPU
 * also the provider's library, which stays loaded.
 * Results: CAIRN_OK, also when something is missing; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_device_requirements(
    uint32_t kind, const cairn_device_options *options, cairn_requirement *requirements, size_t stride,
    uint32_t capacity, uint32_t *count);

/* ---- 6. Create: worlds ------------------------------------------------------------------------------------------- */

/** A stage of loading: reads and checks files; done and total count bytes. */
#define CAIRN_LOAD_READING 1
/** A stage of loading: ONNX Runtime prepares the graphs; done and total count graphs. */
#define CAIRN_LOAD_PREPARING 2

/**
 * A flag of cairn_world_options: if the global window needs more memory than memory_limit or than the adapter has free, the widest
 * window that fits is used instead, and cairn_rollout_info names it. Without the flag the load fails.
 */
#define CAIRN_WORLD_FIT_WINDOW 1

/**
 * A flag of cairn_world_options, for graphs in CAIRN_PRECISION_F16: makes one latent with the bundle's f32 graphs as well and compares
 * the two. The load fails with CAIRN_ERROR_UNSUPPORTED if a value passes float16's largest number, 65504, or the latent's relative
 * error is more than 3 %; the message names the tensor or layer, and the remedy. The f32 graphs of the transformer are loaded first and
 * dropped then; they need about twice the memory of the f16 graphs' weights. The result depends only on the bundle and the device: one
 * load of both needs it, for example after an installation or a driver's update.
 */
#define CAIRN_WORLD_CHECK_PRECISION 2

/** A loaded world. It may have any number of rollouts, which share its weights. */
typedef struct cairn_world cairn_world;

/** Progress of loading. */
typedef struct cairn_load_progress {
    /** sizeof(cairn_load_progress) in this library. */
    uint32_t struct_size;
    /** CAIRN_LOAD_READING, then CAIRN_LOAD_PREPARING */
    uint32_t stage;
    /** Units of the stage that are done. */
    uint64_t done;
    /** Units of the stage in total. */
    uint64_t total;
} cairn_load_progress;

/**
 * Gets the progress of a load, on the thread that called cairn_world_load, after every mebibyte and every graph, without any lock
 * held. progress is valid during the call only; user is the pointer in the options. If the callback does not return 0, the load ends
 * with CAIRN_ERROR_CANCELLED before anything more is read or run. It may call Cairn, except to destroy the device, and must not throw.
 */
typedef uint32_t (*cairn_load_callback)(const struct cairn_load_progress *progress, void *user);

/** Options of loading a world. */
typedef struct cairn_world_options {
    /** sizeof(cairn_world_options) */
    uint32_t struct_size;
    /** CAIRN_PRECISION_F32 or CAIRN_PRECISION_F16; 0 for the device's default. */
    uint32_t precision;
    /**
     * Path of the bundle, a directory or an archive, UTF-8. Null for the world embedded in this library, if there is one.
     */
    const char *path;
    /**
     * Operating point of its rollouts, UTF-8: a preset ("coherence", "baseline-128", "baseline-112", "baseline-doubled", "decoded-60",
     * "heavy", "stock"), with changes after commas: "stock,g64,native". Null for "stock" with the bundle's own global window. The global
     * window is fixed for the world; the rest may differ from rollout to rollout, but "joined" needs a world that was loaded with it.
     */
    const char *operating_point;
    /** Limit in bytes on the memory of the world with one rollout; 0 for what the system has available. */
    uint64_t memory_limit;
    /** Gets the progress and can cancel the load; null for none. */
    cairn_load_callback progress;
    /** Passed to the callback. */
    void *user;
    /** CAIRN_WORLD_FIT_WINDOW, CAIRN_WORLD_CHECK_PRECISION */
    uint32_t flags;
    /** 0 */
    uint32_t reserved;
    /**
     * Number of slices of the transformer, 1 to the number of its layers: graphs of consecutive layers that run one after the other. Between
     * two slices of a pass an engine's frame gets its turn on the device, and cairn_rollout_cancel ends the step. On the processor every
     * number of slices gives the same bits in CAIRN_PRECISION_F32. More slices need more memory. 0 for 1, or with longest_submission_us for as
     * many as the limit needs.
     */
    uint32_t slices;
    /**
     * Limit on the time of a slice in microseconds; 0 for none. With slices 0, passes are measured at load, by the device's own clock if
     * it has one, and the transformer gets the fewest slices of which the longest is within the limit; if none is, as many as there are
     * layers, or as fit in memory. cairn_world_info has the number and the time. Such a load takes several times as long. On Direct3D 12,
     * rollouts of this world also wait before they submit more work than this, as with cairn_d3d12_options.longest_submission_us.
     */
    uint32_t longest_submission_us;
} cairn_world_options;

/** Properties of a world. */
typedef struct cairn_world_info {
    /** sizeof(cairn_world_info) */
    uint32_t struct_size;
    /** Precision of the graphs: CAIRN_PRECISION_F32 or CAIRN_PRECISION_F16 */
    uint32_t precision;
    /** Size of an anchor's pictures, in square pixels. */
    uint32_t render_width;
    /** See render_width. */
    uint32_t render_height;
    /** Size of the autoencoder's decoded pictures, whose pixels may not be square. */
    uint32_t decoded_width;
    /** See decoded_width. */
    uint32_t decoded_height;
    /** Shape of a latent: [channels, height, width]. */
    uint32_t latent_channels;
    /** See latent_channels. */
    uint32_t latent_height;
    /** See latent_channels. */
    uint32_t latent_width;
    /** Tokens of a latent. */
    uint32_t tokens;
    /** Layers of the transformer. */
    uint32_t layers;
    /** Pictures decoded from one latent. */
    uint32_t pictures_per_latent;
    /** Context window of a local layer, in latents. */
    uint32_t local_window;
    /** g: context window of a global layer, in latents, as loaded. */
    uint32_t global_window;
    /** The largest g that the bundle allows. */
    uint32_t max_global_window;
    /** g is a multiple of this. */
    uint32_t global_dilation;
    /** Latents per second of world time for which the model was made. */
    uint32_t latents_per_second;
    /** Number of keys that the model knows: virtual-key codes from 0 to this minus 1. */
    uint32_t keys;
    /** The world's name, for people; UTF-8. */
    char name[128];
    /** The licence as an SPDX expression; cairn_world_get_licence has its text. */
    char licence[64];
    /** The bundle's identity: SHA-256 of its manifest, in hexadecimal. */
    char digest[72];
    /** Slices of the transformer. */
    uint32_t slices;
    /**
     * Time of the longest slice in microseconds, as measured at load; 0 if the number of slices was not chosen by
     * cairn_world_options.longest_submission_us.
     */
    uint32_t longest_slice_us;
} cairn_world_info;

/** Bytes that a world and one rollout need. */
typedef struct cairn_world_memory {
    /** sizeof(cairn_world_memory) */
    uint32_t struct_size;
    /** 0 */
    uint32_t reserved;
    /** The bundle's files, while they are loaded. */
    uint64_t bundle;
    /**
     * Weights as ONNX Runtime holds them, and those that the world keeps in the host's memory for noise levels that it has not seen yet.
     */
    uint64_t weights;
    /**
     * Keys and values of one rollout's ring. Each further rollout needs this, the slabs, and a part of the intermediate values.
     */
    uint64_t ring;
    /** Keys and values of the current latent. */
    uint64_t slabs;
    /** Intermediate values of a pass, and the largest matrix that a pass unpacks from 8 or 4 bits. */
    uint64_t intermediates;
    /** Intermediate values, pictures and state of encoder and decoder. */
    uint64_t autoencoder;
    /** Overhead of ONNX Runtime's allocator. */
    uint64_t arena;
    /** The sum. */
    uint64_t total;
} cairn_world_memory;

/**
 * Loads a world: reads and checks the bundle, compares the memory it needs with the memory available, and prepares its graphs. Takes
 * seconds to minutes with real weights, so call it off the render thread; the callback reports progress and can cancel the load.
 *
 * device: kept alive by the world.
 *
 * Ownership: on success *world is the caller's, for cairn_world_destroy; on failure it is not written and nothing is kept. What
 * options point to is read during the call only.
 * Threads: any thread, at any time, also several loads at once.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT, also for an operating point that does not fit the
 * world, for more slices than the transformer can have, and for joined passes in slices or with a limit on submissions; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_IO; CAIRN_ERROR_INVALID_BUNDLE;
 * CAIRN_ERROR_UNSUPPORTED for another version of the format, a precision the bundle does not have or that CAIRN_WORLD_CHECK_PRECISION
 * refuses, joined passes that the bundle does not have, or no embedded world; CAIRN_ERROR_OUT_OF_MEMORY with the numbers;
 * CAIRN_ERROR_DEVICE; CAIRN_ERROR_CANCELLED.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_world_load(
    const cairn_device *device, const cairn_world_options *options, cairn_world **world);

/**
 * Gives the properties of a world.
 *
 * Ownership: info stays the caller's and is filled on success; on failure it is not written.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_world_get_info(const cairn_world *world, cairn_world_info *info);

/**
 * Gives the memory that a world with one rollout needs, as computed before loading.
 *
 * Ownership: memory stays the caller's and is filled on success; on failure it is not written.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_world_get_memory(const cairn_world *world, cairn_world_memory *memory);

/**
 * Copies the text of the world's licence; empty if the bundle has none.
 *
 * text: at least capacity bytes, or null with capacity 0 to learn the length. Always ends in a NUL when capacity > 0.
 * length: gets the length in bytes of the whole text, without the NUL; may be null.
 *
 * Ownership: the text is copied; on failure nothing is written.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_TRUNCATED; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_world_get_licence(const cairn_world *world, char *text, size_t capacity, size_t *length);

/**
 * Destroys the handle of a world; null is allowed. Its rollouts keep it alive.
 *
 * Ownership: on success world is no longer a handle; on failure it is unchanged.
 * Threads: any thread; waits for calls in flight on the world.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_BUSY from within a callback of a call on it.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_world_destroy(cairn_world *world);

/* ---- 7. Per frame: pictures and controls ------------------------------------------------------------------------- */

/** Four bytes to a pixel, red first; display-referred sRGB, alpha straight. The default. */
#define CAIRN_FORMAT_RGBA8 0
/** Four bytes to a pixel, blue first; otherwise the same. */
#define CAIRN_FORMAT_BGRA8 1
/** Four half floats to a pixel, red first: sRGB or linear 0 to 1, scRGB 0 to white_nits / 80; for targets only. */
#define CAIRN_FORMAT_RGBA16F 2
/** Four bytes to a pixel: ten bits each of red (lowest), green and blue, two of alpha; for targets only. */
#define CAIRN_FORMAT_RGB10A2 3

/** A picture in the host's memory, which the library reads during the call only. */
typedef struct cairn_picture {
    /** sizeof(cairn_picture) */
    uint32_t struct_size;
    /** CAIRN_FORMAT_RGBA8 or CAIRN_FORMAT_BGRA8 */
    uint32_t format;
    /** In pixels, 1 to 16384. */
    uint32_t width;
    /** In pixels, 1 to 16384. */
    uint32_t height;
    /** The top left pixel; rows run from top to bottom. Any alignment. */
    const void *pixels;
    /** Bytes that may be read from there. */
    uint64_t size;
    /** Bytes from one row to the next; 0 for width * 4. */
    uint64_t row_pitch;
} cairn_picture;

/**
 * Memory of the host into which the library writes a picture, during the call only. Bytes between rows are not changed.
 */
typedef struct cairn_target {
    /** sizeof(cairn_target) */
    uint32_t struct_size;
    /** CAIRN_FORMAT_RGBA8, CAIRN_FORMAT_BGRA8, CAIRN_FORMAT_RGBA16F or CAIRN_FORMAT_RGB10A2 */
    uint32_t format;
    /** In pixels; must be the picture's width. */
    uint32_t width;
    /** In pixels; must be the picture's height. */
    uint32_t height;
    /** The top left pixel; rows run from top to bottom. Any alignment. */
    void *pixels;
    /** Bytes that may be written from there. */
    uint64_t size;
    /** Bytes from one row to the next; 0 for rows without a gap. */
    uint64_t row_pitch;
} cairn_target;

/** Controls of one latent step. All zero: nothing moves, no key is held. */
typedef struct cairn_controls {
    /** sizeof(cairn_controls) */
    uint32_t struct_size;
    /** Horizontal mouse motion in raw counts, summed over the step, right positive; -32768 to 32768. */
    float mouse_dx;
    /** Vertical mouse motion, down positive; otherwise as mouse_dx. */
    float mouse_dy;
    /** Wheel motion, up positive; any finite number. Only its sign counts. */
    float scroll;
    /**
     * Keys and mouse buttons held at any time during the step, by Windows virtual-key code: bit code % 64 of word code / 64.
     * W is 0x57: bit 23 of the second word.
     */
    uint64_t keys[4];
} cairn_controls;

/* ---- 8. Per frame: anchors --------------------------------------------------------------------------------------- */

/**
 * A flag of cairn_anchor_info: the anchor does not continue the previous one, so nothing may be generated between them. It is the first
 * of a rollout, after a reset or a restored state, or a picture that was appended.
 */
#define CAIRN_ANCHOR_CUT 1

/** An anchor: an immutable copy, independent of its rollout. */
typedef struct cairn_anchor cairn_anchor;

/** Properties of an anchor. */
typedef struct cairn_anchor_info {
    /** sizeof(cairn_anchor_info) */
    uint32_t struct_size;
    /** CAIRN_ANCHOR_CUT, or 0 */
    uint32_t flags;
    /** Number of its latent in the rollout, from 0. Its world time is latent / latents_per_second seconds. */
    uint64_t latent;
    /** Latents per second of world time; 0 for a host's own picture. */
    uint32_t latents_per_second;
    /** Number of its pictures, in order of time; the last is the anchor itself. */
    uint32_t pictures;
    /** Size of its pictures, in square pixels. */
    uint32_t width;
    /** See width. */
    uint32_t height;
    /** Shape of its latent, [channels, height, width]; all 0 if it has none. */
    uint32_t latent_channels;
    /** See latent_channels. */
    uint32_t latent_height;
    /** See latent_channels. */
    uint32_t latent_width;
    /** 0 */
    uint32_t reserved;
} cairn_anchor_info;

/**
 * Makes an anchor from a picture of the host's own, for frame generation without a world.
 *
 * number: increases by one from anchor to anchor.
 * flags: CAIRN_ANCHOR_CUT if it does not continue the previous anchor, or 0.
 *
 * Ownership: on success *anchor is the caller's, for cairn_anchor_destroy; on failure it is not written. The picture is copied.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_OUT_OF_MEMORY.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_anchor_create(
    const cairn_picture *picture, uint64_t number, uint32_t flags, cairn_anchor **anchor);

/**
 * Gives the properties of an anchor.
 *
 * Ownership: info stays the caller's and is filled on success; on failure it is not written.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_anchor_get_info(const cairn_anchor *anchor, cairn_anchor_info *info);

/**
 * Copies one of an anchor's pictures into the host's memory.
 *
 * index: 0 to pictures - 1, in order of time.
 * target: of the anchor's size.
 *
 * Ownership: the pixels are copied, on success; on failure none is written.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_anchor_read_picture(
    const cairn_anchor *anchor, uint32_t index, const cairn_target *target);

/**
 * Copies an anchor's latent: float32, [channels, height, width], the last index varying fastest.
 *
 * count: size of the array in numbers; must be channels * height * width.
 *
 * Ownership: the numbers are copied, on success; on failure none is written.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_UNSUPPORTED for an anchor without a
 * latent.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_anchor_read_latent(const cairn_anchor *anchor, float *values, size_t count);

/**
 * Destroys the handle of an anchor; null is allowed. Guidance and presenters that were given it keep what they need.
 *
 * Ownership: on success anchor is no longer a handle; on failure it is unchanged.
 * Threads: any thread; waits for calls in flight on the anchor.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_BUSY from within a callback of a call on it.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_anchor_destroy(cairn_anchor *anchor);

/* ---- 9. Per frame: rollouts -------------------------------------------------------------------------------------- */

/** The largest capacity of a rollout's queue, in steps. */
#define CAIRN_MAX_QUEUE 64

/**
 * A flag of cairn_step_info: keys and values of the latent were copied into the ring; with joined passes, those of the latent before.
 */
#define CAIRN_STEP_COMMITTED 1

/** One running instance of a world: its memory of the past (a ring of keys and values), its clocks and its noise. */
typedef struct cairn_rollout cairn_rollout;

/** Options of a rollout. All zero: the world's operating point, and seed 0. */
typedef struct cairn_rollout_options {
    /** sizeof(cairn_rollout_options) */
    uint32_t struct_size;
    /**
     * Largest number of steps that are waiting, running, or done with a result not yet fetched, 1 to CAIRN_MAX_QUEUE; 0 for 4.
     */
    uint32_t queue_capacity;
    /** Seed of all noise: the same seed, world, device and controls give the same pictures, bit for bit. */
    uint64_t seed;
    /** As in cairn_world_options, with the world's global window; null for the world's operating point. */
    const char *operating_point;
} cairn_rollout_options;

/** Properties and progress of a rollout. */
typedef struct cairn_rollout_info {
    /** sizeof(cairn_rollout_info) */
    uint32_t struct_size;
    /** Pictures of each anchor. */
    uint32_t pictures_per_latent;
    /** Latents made so far. */
    uint64_t latents;
    /** Seed of its noise. */
    uint64_t seed;
    /** Latents per second of world time; each step's controls are summed over one latent. */
    uint32_t latents_per_second;
    /** Presentation rate of the operating point, in pictures per second. */
    uint32_t presented_rate;
    /**
     * The operating point, UTF-8; cut off if it is longer than 191 bytes, as one with many explicit noise levels is.
     */
    char operating_point[192];
} cairn_rollout_info;

/** Report on one step. Times are nanoseconds of wall time. */
typedef struct cairn_step_info {
    /** sizeof(cairn_step_info) */
    uint32_t struct_size;
    /** CAIRN_STEP_COMMITTED, or 0 */
    uint32_t flags;
    /** Number of the latent made, from 0. */
    uint64_t latent;
    /** Denoise passes. */
    uint32_t denoise_passes;
    /** Cache passes, which compute keys and values for the ring. */
    uint32_t cache_passes;
    /** Encoding a picture into a latent. */
    uint64_t encode_ns;
    /** All denoise passes. */
    uint64_t denoise_ns;
    /** All cache passes. */
    uint64_t cache_ns;
    /** Checking results and copying them into the ring. */
    uint64_t commit_ns;
    /** Decoding the latent. */
    uint64_t decode_ns;
    /** Bytes copied into the ring. */
    uint64_t ring_bytes;
} cairn_step_info;

/**
 * Creates a rollout without latents. Append a seed picture before the first step.
 *
 * world: kept alive by the rollout. options: may be null for the defaults.
 *
 * Ownership: on success *rollout is the caller's, for cairn_rollout_destroy; on failure it is not written. What options point to
 * is read during the call only.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE;
 * CAIRN_ERROR_OUT_OF_MEMORY with the numbers; CAIRN_ERROR_DEVICE.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_rollout_create(
    const cairn_world *world, const cairn_rollout_options *options, cairn_rollout **rollout);

/**
 * Destroys the handle of a rollout; null is allowed. Queued steps are dropped, and the step in progress ends before its next pass or slice.
 *
 * Ownership: on success rollout is no longer a handle; on failure it is unchanged. Anchors that were taken from it remain.
 * Threads: any thread; waits for calls in flight on the rollout, and for its worker.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_BUSY from within a callback of a call on it.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_rollout_destroy(cairn_rollout *rollout);

/**
 * Gives the properties and progress of a rollout.
 *
 * Ownership: info stays the caller's and is filled on success; on failure it is not written.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_BUSY while a
 * step is running.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_rollout_get_info(const cairn_rollout *rollout, cairn_rollout_info *info);

/**
 * Appends a picture of any size: the seed, or later an edit of the scene. It becomes a latent of its own, with a cache pass that puts
 * it into the rollout's memory. Runs on the calling thread.
 *
 * info: may be null.
 *
 * Ownership: the picture is copied; info stays the caller's and is filled on success; on failure it is not written and the
 * rollout is as it was.
 * Threads: one call at a time; a concurrent one, and one while steps are queued, gets CAIRN_ERROR_BUSY.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_BUSY;
 * CAIRN_ERROR_OUT_OF_MEMORY; CAIRN_ERROR_DEVICE; CAIRN_ERROR_CANCELLED; CAIRN_ERROR_UNSUPPORTED when a clock has run out.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_rollout_append(
    cairn_rollout *rollout, const cairn_picture *picture, cairn_step_info *info);

/**
 * Appends consecutive pictures of any sizes as one latent, so that a moving scene keeps moving. cairn_rollout_append does so with one
 * picture, as a still. Runs on the calling thread.
 *
 * pictures: an array, the oldest first, with the same struct_size in each. count: 4, the pictures of a latent; or 1, for a still.
 * info: may be null.
 *
 * Ownership: the pictures are copied; info stays the caller's and is filled on success; on failure it is not written and the
 * rollout is as it was.
 * Threads: one call at a time; a concurrent one, and one while steps are queued, gets CAIRN_ERROR_BUSY.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_BUSY;
 * CAIRN_ERROR_OUT_OF_MEMORY; CAIRN_ERROR_DEVICE; CAIRN_ERROR_CANCELLED; CAIRN_ERROR_UNSUPPORTED when a clock has run out.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_rollout_append_pictures(
    cairn_rollout *rollout, const cairn_picture *pictures, uint32_t count, cairn_step_info *info);

/**
 * Sets whether the encoder keeps its state from one appended picture to the next, as in the released engine, or starts anew with each (the
 * default). Its state is empty after this call, and after cairn_rollout_reset. It is part of a saved state, which can be restored only into
 * a rollout with the same setting.
 *
 * keep: 1 to keep the encoder's state, 0 to start anew with each picture.
 *
 * Ownership: nothing is handed over, on success or on failure.
 * Threads: one call at a time; a concurrent one, and one while steps are queued, gets CAIRN_ERROR_BUSY.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_BUSY; CAIRN_ERROR_UNSUPPORTED if the
 * bundle's encoder does not take its state as an input; CAIRN_ERROR_OUT_OF_MEMORY; CAIRN_ERROR_DEVICE.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_rollout_keep_encoder_stream(cairn_rollout *rollout, uint32_t keep);

/**
 * Makes the next latent with these controls, which cover 1 / latents_per_second seconds of world time. Runs on the calling thread.
 *
 * info: may be null.
 *
 * Ownership: controls are read during the call; info stays the caller's and is filled on success; on failure it is not
 * written and the rollout is as it was.
 * Threads: one call at a time; a concurrent one, and one while steps are queued, gets CAIRN_ERROR_BUSY.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_BUSY;
 * CAIRN_ERROR_OUT_OF_MEMORY; CAIRN_ERROR_DEVICE; CAIRN_ERROR_CANCELLED; CAIRN_ERROR_UNSUPPORTED for a key that the world does
 * not know, and when a clock has run out.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_rollout_step(
    cairn_rollout *rollout, const cairn_controls *controls, cairn_step_info *info);

/**
 * Resets a rollout to its start with the same seed: no latents, empty memory.
 *
 * Ownership: nothing is handed over, on success or on failure.
 * Threads: one call at a time; a concurrent one, and one while steps are queued, gets CAIRN_ERROR_BUSY.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_BUSY; CAIRN_ERROR_OUT_OF_MEMORY; CAIRN_ERROR_DEVICE.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_rollout_reset(cairn_rollout *rollout);

/**
 * Frees the device memory of a rollout that makes no latents for a while: waits for its work, then evicts its rings, latents and pictures
 * with their contents. The next call that needs them makes them resident again; the device's queue waits for that, and no thread does if
 * Windows has ID3D12Device3. If there is not enough memory, that call returns CAIRN_ERROR_OUT_OF_MEMORY, changes nothing and may be
 * repeated. The world's weights are evicted once all of its rollouts rest; anchors are not. On a CPU device nothing happens.
 * cairn_rollout_pause also rests a rollout with a queue.
 *
 * Ownership: nothing is handed over, on success or on failure.
 * Threads: one call at a time; a concurrent one, and one while steps are queued, gets CAIRN_ERROR_BUSY.
 * Results: CAIRN_OK, also if it rests already; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_BUSY; CAIRN_ERROR_DEVICE;
 * CAIRN_ERROR_DEVICE_REMOVED.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_rollout_rest(cairn_rollout *rollout);

/**
 * Limits the wall time per latent, decoding included. Latents use the first of the schedules until that takes too long, then one with
 * fewer passes, and again one with more when there is time. The choice depends on the times of previous latents, so the same controls may
 * give other pictures the next time. Changes are logged; cairn_step_info has the number of passes of a latent, and
 * cairn_rollout_info the schedule of the next one. Restoring a state removes the limit.
 *
 * latent_ns: limit in nanoseconds per latent.
 * schedules: one to eight as in operating points, separated by spaces, each with fewer passes than the one before:
 * "stock explicit:1:0.5:0 explicit:1:0". An empty text removes the limit and leaves the schedule as it is.
 *
 * Ownership: nothing is handed over, on success or on failure.
 * Threads: one call at a time; a concurrent one, and one while steps are queued, gets CAIRN_ERROR_BUSY.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_BUSY.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_rollout_set_budget(cairn_rollout *rollout, uint64_t latent_ns, const char *schedules);

/**
 * Copies the last anchor: its pictures and its latent.
 *
 * Ownership: on success *anchor is the caller's, for cairn_anchor_destroy; on failure it is not written.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT, also before the first latent; CAIRN_ERROR_BUSY
 * while a step is running; CAIRN_ERROR_OUT_OF_MEMORY; CAIRN_ERROR_DEVICE.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_rollout_get_anchor(const cairn_rollout *rollout, cairn_anchor **anchor);

/* ---- 10. Per frame: the queue of a rollout ----------------------------------------------------------------------- */

/** A timeout without limit. */
#define CAIRN_FOREVER UINT64_MAX

/**
 * Queues a step for the rollout's own thread, which runs steps in the order in which they were queued. A step that fails leaves the
 * rollout unchanged and cancels the steps queued after it.
 *
 * ticket: gets the number that identifies the result.
 *
 * Ownership: controls are read during the call; *ticket is written on success only, not on failure.
 * Threads: any thread, at any time. Returns at once.
 * Results: CAIRN_OK; CAIRN_QUEUE_FULL; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE;
 * CAIRN_ERROR_OUT_OF_MEMORY.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_rollout_submit(
    const cairn_rollout *rollout, const cairn_controls *controls, uint64_t *ticket);

/**
 * Queues a picture to be appended as by cairn_rollout_append.
 *
 * ticket: gets the number that identifies the result.
 *
 * Ownership: the picture is copied; *ticket is written on success only, not on failure.
 * Threads: any thread, at any time. Returns at once.
 * Results: CAIRN_OK; CAIRN_QUEUE_FULL; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE;
 * CAIRN_ERROR_OUT_OF_MEMORY.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_rollout_submit_picture(
    const cairn_rollout *rollout, const cairn_picture *picture, uint64_t *ticket);

/**
 * Queues pictures to be appended as by cairn_rollout_append_pictures.
 *
 * pictures, count: as for cairn_rollout_append_pictures. ticket: gets the number that identifies the result.
 *
 * Ownership: the pictures are copied; *ticket is written on success only, not on failure.
 * Threads: any thread, at any time. Returns at once.
 * Results: CAIRN_OK; CAIRN_QUEUE_FULL; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE;
 * CAIRN_ERROR_OUT_OF_MEMORY.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_rollout_submit_pictures(
    const cairn_rollout *rollout, const cairn_picture *pictures, uint32_t count, uint64_t *ticket);

/**
 * Fetches the result of a queued step, without waiting. A ticket's result can be fetched once, which frees its place in the queue.
 * A failed step's message becomes the last error of the calling thread.
 *
 * info, anchor: get the step's report and its anchor; each may be null. An anchor that is not fetched is lost.
 *
 * Ownership: on success *anchor is the caller's, for cairn_anchor_destroy, and info is filled; on failure neither is written.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_NOT_READY while it waits or runs; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT, also for a
 * ticket whose result was fetched; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_CANCELLED; and the results of cairn_rollout_step and
 * cairn_rollout_append.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_rollout_poll(
    const cairn_rollout *rollout, uint64_t ticket, cairn_step_info *info, cairn_anchor **anchor);

/**
 * Waits for a queued step to end, and fetches its result as cairn_rollout_poll does.
 *
 * timeout_ns: longest wait in nanoseconds; CAIRN_FOREVER for no limit. While the queue is paused, waiting steps do not run.
 *
 * Ownership: on success *anchor is the caller's, for cairn_anchor_destroy, and info is filled; on failure neither is written.
 * Threads: any thread, at any time. Destroying the rollout ends the wait with CAIRN_ERROR_CANCELLED.
 * Results: CAIRN_OK; CAIRN_NOT_READY after the timeout; CAIRN_ERROR_BUSY from within a callback of a call or a step of the rollout,
 * which would wait for itself; and all others of cairn_rollout_poll.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_rollout_wait(
    const cairn_rollout *rollout, uint64_t ticket, uint64_t timeout_ns, cairn_step_info *info, cairn_anchor **anchor);

/**
 * Cancels all work of a rollout: queued steps do not run, and a step in progress, queued or on another thread, ends before its next
 * pass. Each gets CAIRN_ERROR_CANCELLED and leaves the rollout unchanged. Steps submitted later are not affected. Does not wait.
 *
 * Ownership: nothing is handed over, on success or on failure.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_rollout_cancel(const cairn_rollout *rollout);

/**
 * Pauses the queue: the step in progress completes, and no other begins. Steps may still be queued. A rollout whose queue was used is then
 * rested, as by cairn_rollout_rest, until its memory is needed; meanwhile it is in use, as while a step is running.
 *
 * Ownership: nothing is handed over, on success or on failure.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_rollout_pause(const cairn_rollout *rollout);

/**
 * Resumes a paused queue.
 *
 * Ownership: nothing is handed over, on success or on failure.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK, also when it was not paused; CAIRN_ERROR_INVALID_HANDLE.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_rollout_resume(const cairn_rollout *rollout);

/**
 * Lets exactly one step of a paused queue run.
 *
 * Ownership: nothing is handed over, on success or on failure.
 * Threads: any thread, at any time. Does not wait for the step.
 * Results: CAIRN_OK; CAIRN_NOT_READY when no step is queued, or all were released already; CAIRN_ERROR_INVALID_HANDLE;
 * CAIRN_ERROR_INVALID_ARGUMENT when the queue is not paused.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_rollout_single_step(const cairn_rollout *rollout);

/* ---- 11. Per frame: the state of a rollout ----------------------------------------------------------------------- */

/**
 * Copies the whole state of a rollout: its memory, clocks, seed, operating point and last pictures. A rollout that restores it
 * continues bit for bit the same, in this process or another, on the same kind of device.
 *
 * bytes: capacity bytes, or null with capacity 0 to learn the size.
 * size: gets the size of the state. It depends on the operating point, which a budget or a governor may change, and on whether the encoder's
 * stream is kept, so ask before each save.
 *
 * Ownership: the state is copied; on failure nothing is written.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT, also when the capacity is too small;
 * CAIRN_ERROR_BUSY while a step is running; CAIRN_ERROR_OUT_OF_MEMORY; CAIRN_ERROR_DEVICE.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_rollout_save(const cairn_rollout *rollout, void *bytes, size_t capacity, size_t *size);

/**
 * Writes the whole state of a rollout to a file, completely or not at all: to a temporary file beside it, which is then renamed.
 *
 * path: UTF-8; an existing file is replaced.
 *
 * Ownership: path is read during the call; on success the file is the caller's, on failure an existing file is unchanged.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_BUSY while a step is running;
 * CAIRN_ERROR_IO; CAIRN_ERROR_OUT_OF_MEMORY; CAIRN_ERROR_DEVICE.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_rollout_save_file(const cairn_rollout *rollout, const char *path);

/**
 * Restores a state that was saved from a rollout of the same bundle, precision and global window. The rollout gets the state's seed
 * and operating point.
 *
 * Ownership: bytes are read during the call; on failure the rollout is unchanged, on success it is as the saved one was.
 * Threads: one call at a time; a concurrent one, and one while steps are queued, gets CAIRN_ERROR_BUSY.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_BUSY; CAIRN_ERROR_INVALID_STATE;
 * CAIRN_ERROR_UNSUPPORTED for a state of another version; CAIRN_ERROR_DEVICE.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_rollout_restore(cairn_rollout *rollout, const void *bytes, size_t size);

/**
 * Restores a state from a file, as cairn_rollout_restore does from memory.
 *
 * path: UTF-8.
 *
 * Ownership: path is read during the call; on failure the rollout is unchanged, on success it is as the saved one was.
 * Threads: one call at a time; a concurrent one, and one while steps are queued, gets CAIRN_ERROR_BUSY.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_BUSY; CAIRN_ERROR_IO;
 * CAIRN_ERROR_INVALID_STATE; CAIRN_ERROR_UNSUPPORTED; CAIRN_ERROR_OUT_OF_MEMORY; CAIRN_ERROR_DEVICE.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_rollout_restore_file(cairn_rollout *rollout, const char *path);

/* ---- 12. Per frame: guidance ------------------------------------------------------------------------------------- */

/** Motion from the source with the best scores (docs/motion.md); today CAIRN_MOTION_PICTURES. */
#define CAIRN_MOTION_AUTO 0
/** Motion from the two pictures: dense optical flow. */
#define CAIRN_MOTION_PICTURES 1
/** Motion from the two latents, by the paper's method. Only anchors of a world have latents. */
#define CAIRN_MOTION_PAPER 2
/** Motion from block matching of the two latents. Only anchors of a world have latents. */
#define CAIRN_MOTION_LATENTS 3
/** A flag of cairn_guidance_data: depth is 1 near and 0 far. */
#define CAIRN_DEPTH_INVERTED 1
/** A flag of cairn_guidance_data: depth is the distance along the view axis, in the units of near_plane. */
#define CAIRN_DEPTH_LINEAR 2

/**
 * Motion and depth of a pair of anchors, both of the anchors' size. Immutable.
 *
 * Motion is in pixels, a half float each for x and y, stored at the current anchor's pixel and pointing from the current anchor to
 * the previous one, y down. Depth is device depth of the current anchor, 0 near and 1 far.
 */
typedef struct cairn_guidance cairn_guidance;

/** Motion and depth from the host, in its memory. */
typedef struct cairn_guidance_data {
    /** sizeof(cairn_guidance_data) */
    uint32_t struct_size;
    /** CAIRN_DEPTH_INVERTED, CAIRN_DEPTH_LINEAR, or 0 for device depth with 0 near */
    uint32_t flags;
    /** Size in pixels, 1 to 16384; must be the anchors'. */
    uint32_t width;
    /** See width. */
    uint32_t height;
    /**
     * Half floats x, y for each pixel, row by row without padding, with the meaning they have in cairn_guidance. Non-finite values
     * count as 0.
     */
    const uint16_t *motion;
    /** Number of half floats: width * height * 2. */
    uint64_t motion_count;
    /** One value for each pixel, row by row without padding; null for no depth. */
    const float *depth;
    /** Number of values: width * height, or 0. */
    uint64_t depth_count;
    /** Distance of the near plane, above 0; 0 in near_plane, far_plane and vertical_fov for 0.1, 100 and 60 degrees. */
    float near_plane;
    /** Distance of the far plane, above near_plane; may be infinite. */
    float far_plane;
    /** Vertical field of view in radians, inside (0, pi). */
    float vertical_fov;
    /** 0 */
    uint32_t reserved;
} cairn_guidance_data;

/** Properties of guidance. */
typedef struct cairn_guidance_info {
    /** sizeof(cairn_guidance_info) */
    uint32_t struct_size;
    /** In pixels. */
    uint32_t width;
    /** In pixels. */
    uint32_t height;
    /** Distance of the near plane. */
    float near_plane;
    /** Distance of the far plane; may be infinite. */
    float far_plane;
    /** Vertical field of view in radians. */
    float vertical_fov;
} cairn_guidance_info;

/**
 * Finds motion and depth of a pair of anchors. Takes milliseconds, on the calling thread. A presenter does this itself when a frame first
 * needs it; call this to do it off the render thread, or to inspect the result.
 *
 * source: CAIRN_MOTION_AUTO, CAIRN_MOTION_PICTURES, CAIRN_MOTION_PAPER or CAIRN_MOTION_LATENTS.
 *
 * Ownership: on success *guidance is the caller's, for cairn_guidance_destroy; on failure it is not written.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT, also for anchors of different sizes and for missing
 * latents; CAIRN_ERROR_OUT_OF_MEMORY.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_guidance_create(
    const cairn_anchor *previous, const cairn_anchor *current, uint32_t source, cairn_guidance **guidance);

/**
 * Makes guidance from the host's own motion and depth, such as an engine's.
 *
 * Ownership: on success *guidance is the caller's, for cairn_guidance_destroy; on failure it is not written. What data points
 * to is copied.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_OUT_OF_MEMORY.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_guidance_create_from_host(const cairn_guidance_data *data, cairn_guidance **guidance);

/**
 * Gives the properties of guidance.
 *
 * Ownership: info stays the caller's and is filled on success; on failure it is not written.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_guidance_get_info(const cairn_guidance *guidance, cairn_guidance_info *info);

/**
 * Copies the motion: half floats x, y for each pixel, row by row.
 *
 * count: size of the array in half floats; must be width * height * 2.
 *
 * Ownership: the numbers are copied, on success; on failure none is written.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_guidance_read_motion(const cairn_guidance *guidance, uint16_t *values, size_t count);

/**
 * Copies the depth: device depth for each pixel, 0 near, row by row.
 *
 * count: size of the array in numbers; must be width * height.
 *
 * Ownership: the numbers are copied, on success; on failure none is written.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_guidance_read_depth(const cairn_guidance *guidance, float *values, size_t count);

/**
 * Destroys the handle of guidance; null is allowed. Presenters that were given it keep what they need.
 *
 * Ownership: on success guidance is no longer a handle; on failure it is unchanged.
 * Threads: any thread; waits for calls in flight on the guidance.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_BUSY from within a callback of a call on it.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_guidance_destroy(cairn_guidance *guidance);

/* ---- 13. Per frame: presenters ----------------------------------------------------------------------------------- */

/** Uses the generator if possible. */
#define CAIRN_PREFER_AUTO 0

/**
 * Requires the generator: creating the presenter, or preparing its frames for Direct3D 12, fails if it cannot be used.
 */
#define CAIRN_PREFER_REQUIRE 1
/** Never uses the generator. */
#define CAIRN_PREFER_NEVER 2

/**
 * A flag of cairn_presenter_options: holds the last anchor while the next one is late, instead of extrapolating its motion.
 */
#define CAIRN_PRESENTER_HOLD_LATE 1

/**
 * A flag of cairn_presenter_options: after a late anchor, frames are shown earlier by a quarter of a frame's duration per anchor, until
 * anchors are due delay_ns after their arrival again. For hosts that make anchors at a steady pace instead of as fast as possible.
 */
#define CAIRN_PRESENTER_CATCH_UP 2

/**
 * A flag of cairn_presenter_options: generates frames even if an anchor has as many decoded pictures as frames are shown per anchor.
 * Without it those pictures are shown instead.
 */
#define CAIRN_PRESENTER_NO_DECODED 4

/**
 * A flag of cairn_presenter_options: anchors keep their aspect ratio in frames of another ratio, centred between black bars. Without it
 * they are stretched.
 */
#define CAIRN_PRESENTER_LETTERBOX 8
/** Display-referred sRGB, like pictures in memory. */
#define CAIRN_COLOUR_SRGB 0
/** Linear, sRGB primaries, 1 is white; only for CAIRN_FORMAT_RGBA16F and for textures of R11G11B10_FLOAT. */
#define CAIRN_COLOUR_LINEAR 1
/** scRGB: linear, sRGB primaries, 1 is 80 nits; only for CAIRN_FORMAT_RGBA16F. */
#define CAIRN_COLOUR_SCRGB 2
/** HDR10: PQ transfer function, BT.2020 primaries; only for CAIRN_FORMAT_RGB10A2. */
#define CAIRN_COLOUR_HDR10 3
/** The frame is an anchor. */
#define CAIRN_FRAME_ANCHOR 1
/** The frame is a decoded picture that came with the later anchor. */
#define CAIRN_FRAME_DECODED 2
/** The frame is interpolated between two anchors. */
#define CAIRN_FRAME_GENERATED 3
/** The frame is extrapolated from the last anchor, because the next one is late. */
#define CAIRN_FRAME_EXTRAPOLATED 4

/**
 * The frame holds a picture, because nothing can be generated: between two anchors the nearer one, after an interval of extrapolation the
 * last anchor extrapolated by that interval, else the last anchor.
 */
#define CAIRN_FRAME_HELD 5
/** A flag of cairn_frame: the frame was not generated because of a cut. */
#define CAIRN_FRAME_CUT 1
/** A flag of cairn_frame: the frame is identical to the one drawn before. */
#define CAIRN_FRAME_REPEATED 2
/** A flag of cairn_frame: an anchor replaces the frame, because cairn_presenter_prepare_d3d12 was not called for it. */
#define CAIRN_FRAME_UNPREPARED 4

/**
 * Shows a stream of anchors at a steady rate: takes anchors as they arrive, decides which frame is due, generates it and writes it into
 * the host's memory or into a texture. No clock decides what is shown: every time is the host's, in nanoseconds from any origin.
 *
 * Anchor i is due at origin + i * interval; origin is the arrival of the first anchor plus the delay. Between two anchors that have
 * arrived, frames are generated. While the next anchor is late, the motion of the last one is extrapolated for at most an interval; then
 * the picture is held. An anchor that arrives after it was due is due on arrival, and all later ones are delayed by as much: a world
 * that is too slow is shown slowly, and no frame is skipped.
 */
typedef struct cairn_presenter cairn_presenter;

/** Options of a presenter. All zero: two frames per anchor, and anchors are due one interval after their arrival. */
typedef struct cairn_presenter_options {
    /** sizeof(cairn_presenter_options) */
    uint32_t struct_size;
    /** Frames per anchor: 1, 2, 3, 4 or 6; 0 for 2. */
    uint32_t multiplier;
    /** Width of the frames in pixels, 1 to 16384; 0 in width and height for the anchors' size. */
    uint32_t width;
    /** Height of the frames in pixels, 1 to 16384. */
    uint32_t height;
    /**
     * Nanoseconds from one anchor to the next, at most 60 seconds; 0 for the interval of the first anchor's latents_per_second.
     */
    uint64_t interval_ns;
    /**
     * Nanoseconds from an anchor's arrival until it is due, at most 60 seconds; 0 for one interval. Frames between two anchors need the
     * later one: with a delay below (multiplier - 1) / multiplier of an interval some of them are
     * extrapolated or held instead.
     */
    uint64_t delay_ns;
    /**
     * CAIRN_PRESENTER_HOLD_LATE, CAIRN_PRESENTER_CATCH_UP, CAIRN_PRESENTER_NO_DECODED and CAIRN_PRESENTER_LETTERBOX, or 0.
     */
    uint32_t flags;
    /** Largest number of anchors that wait to become due, 1 to CAIRN_MAX_QUEUE; 0 for 4. */
    uint32_t capacity;
    /** Source of motion for anchors that are pushed without guidance: CAIRN_MOTION_AUTO and so on. */
    uint32_t motion;
    /** CAIRN_COLOUR_SRGB to CAIRN_COLOUR_HDR10 */
    uint32_t colour_space;
    /**
     * AMD FidelityFX frame generation, for frames half way between two anchors that are made for Direct3D 12: CAIRN_PREFER_AUTO and
     * so on. Needs the library's own shaders, which make all other frames.
     */
    uint32_t fsr;
    /** The library's own shaders, for frames made for Direct3D 12: CAIRN_PREFER_AUTO and so on. */
    uint32_t shader;
    /** The library's own generator on the processor: CAIRN_PREFER_AUTO and so on. */
    uint32_t cpu;
    /** 0 */
    uint32_t reserved;
    /**
     * Brightness of the pictures' white in CAIRN_COLOUR_SCRGB and CAIRN_COLOUR_HDR10, 1 to 10000 nits; 0 for 203. Must be 0 for the
     * other colour spaces.
     */
    uint32_t white_nits;
    /** 0 */
    uint32_t reserved_too;
    /**
     * AMD FidelityFX upscaling, for frames for Direct3D 12 that are larger than anchors: CAIRN_PREFER_AUTO and so on. It upscales anchors
     * before frames are generated between them. Without it each frame is resized by a spatial filter. Needs the library's own shaders.
     */
    uint32_t upscaler;
    /** 0 */
    uint32_t reserved_also;
} cairn_presenter_options;

/** Information about a frame of a presenter. */
typedef struct cairn_frame {
    /** sizeof(cairn_frame) */
    uint32_t struct_size;
    /** How it is made: CAIRN_FRAME_ANCHOR to CAIRN_FRAME_HELD. */
    uint32_t source;
    /**
     * Position in the stream: anchor i, counted from 0 in order of arrival, is at i * multiplier. It may step back when a late anchor
     * arrives.
     */
    uint64_t position;
    /** When it is due. For the first anchor this may be in the future: it is shown from its arrival on. */
    uint64_t since_ns;
    /** When the next frame is due, if no anchor is late. */
    uint64_t until_ns;
    /** Number of the anchor that it shows or starts from. */
    uint64_t previous;
    /** Number of the anchor that it leads to; the same as previous if it leads to none. */
    uint64_t current;
    /** Time since the previous anchor in intervals, 0 to 1. */
    float t;
    /** CAIRN_FRAME_CUT, CAIRN_FRAME_REPEATED and CAIRN_FRAME_UNPREPARED, or 0. */
    uint32_t flags;
} cairn_frame;

/**
 * Creates a presenter.
 *
 * options: may be null for the defaults.
 *
 * Ownership: on success *presenter is the caller's, for cairn_presenter_destroy; on failure it is not written.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_UNSUPPORTED for a required generator
 * that this build or system does not have; CAIRN_ERROR_OUT_OF_MEMORY.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_presenter_create(const cairn_presenter_options *options, cairn_presenter **presenter);

/**
 * Pushes the next anchor. If its number is not one above the last, or it has CAIRN_ANCHOR_CUT, there is a cut before it: nothing is
 * generated between it and the anchor before. An anchor that a Direct3D 12 device still works on arrives once its fence is signalled.
 * The fence is checked whenever a frame is requested, and no queue waits for it; until then the anchor counts as late.
 *
 * guidance: motion from this anchor back to the one before; null to have the presenter extract it.
 * now_ns: time of arrival on the host's clock.
 *
 * Ownership: anchor and guidance stay the caller's; on success the presenter keeps a reference to their contents, on failure none.
 * Threads: any thread, at any time, also while a frame is drawn. A time before the latest one that was passed counts as the latest.
 * Results: CAIRN_OK; CAIRN_QUEUE_FULL if capacity anchors wait already; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT, also for
 * another size than the first anchor's, and if neither the options nor the first anchor have an interval.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_presenter_push(
    const cairn_presenter *presenter, const cairn_anchor *anchor, const cairn_guidance *guidance, uint64_t now_ns);

/**
 * Returns which frame is due, without making it. Takes less than a microsecond.
 *
 * now_ns: when it will be shown, on the host's clock.
 *
 * Ownership: frame stays the caller's and is filled on success; on failure, and without a frame, it is not written.
 * Threads: any thread, at any time, also while a frame is drawn.
 * Results: CAIRN_OK; CAIRN_NOT_READY before the first anchor has arrived; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT;
 * CAIRN_ERROR_STRUCT_SIZE.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_presenter_query(const cairn_presenter *presenter, uint64_t now_ns, cairn_frame *frame);

/**
 * Makes the frame that is due and writes it into memory. A frame that is still due at the next call is written again without being made
 * again. The generator may detect a cut that cairn_presenter_query does not know; frame tells what was drawn.
 *
 * now_ns: when it will be shown, on the host's clock.
 * target: of the frames' size.
 * frame: may be null.
 *
 * Ownership: on success the pixels are copied and frame is filled; on failure, and without a frame, neither is written.
 * Threads: one call at a time; a concurrent one gets CAIRN_ERROR_BUSY.
 * Results: CAIRN_OK; CAIRN_NOT_READY before the first anchor has arrived; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT, also
 * if CAIRN_MOTION_PAPER or CAIRN_MOTION_LATENTS is used with an anchor without a latent; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_BUSY;
 * CAIRN_ERROR_OUT_OF_MEMORY; CAIRN_ERROR_UNSUPPORTED if the options require a generator for Direct3D 12.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_presenter_draw(
    cairn_presenter *presenter, uint64_t now_ns, const cairn_target *target, cairn_frame *frame);

/**
 * Changes the size of the frames, for example with a window's. The stream continues; the next frame has the new size.
 *
 * width, height: as in cairn_presenter_options; both 0 for the anchors' size.
 *
 * Ownership: nothing is handed over, on success or on failure.
 * Threads: any thread, at any time, also while a frame is drawn.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_presenter_resize(const cairn_presenter *presenter, uint32_t width, uint32_t height);

/**
 * Sets the mask of a static overlay, such as a HUD, that covers the anchors and does not move with them, from the next frame on. Without a
 * mask, generators detect static pixels from colours that do not change. All generators use it. cairn_presenter_reset removes it.
 *
 * mask: one byte per pixel of an anchor, row by row from the top left, 0 where there is no overlay; null, with all other arguments 0, to
 * remove the mask.
 * size: bytes of mask: width * height.
 * width, height: the anchors' size in pixels.
 *
 * Ownership: on success the mask is copied; on failure it is not.
 * Threads: any thread, at any time, also while a frame is drawn.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT, also for another size than that of the anchors that
 * were pushed; CAIRN_ERROR_OUT_OF_MEMORY.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_presenter_set_overlay(
    const cairn_presenter *presenter, const uint8_t *mask, size_t size, uint32_t width, uint32_t height);

/**
 * Limits the device time of frames for Direct3D 12. If the budget is too small for all frames, only every second, third or sixth frame of
 * an interval is generated, depending on the multiplier, and the others repeat the previous one; if it suffices again, more are generated.
 * The choice depends on the device times of completed frames. Changes are logged and counted in the statistics.
 *
 * frame_ns: nanoseconds of device time per shown frame, averaged over an interval and including the work done once per anchor; 0 for no
 * budget.
 *
 * Ownership: nothing is handed over, on success or on failure.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_presenter_set_budget(const cairn_presenter *presenter, uint64_t frame_ns);

/**
 * Discards all anchors and their times: the next anchor is a first one again and may have any size.
 *
 * Ownership: nothing is handed over, on success or on failure.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_presenter_reset(const cairn_presenter *presenter);

/**
 * Destroys the handle of a presenter; null is allowed.
 *
 * Ownership: on success presenter is no longer a handle; on failure it is unchanged.
 * Threads: any thread; waits for calls in flight on the presenter.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_BUSY from within a callback of a call on it.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_presenter_destroy(cairn_presenter *presenter);

/* ---- 14. Per frame: budgets -------------------------------------------------------------------------------------- */

/** Largest number of worlds of a budget. */
#define CAIRN_MAX_BUDGET_WORLDS 8

/** Budget of a rollout and its frames: time, memory or both. */
typedef struct cairn_budget {
    /** sizeof(cairn_budget) */
    uint32_t struct_size;
    /**
     * Frames shown per anchor, at most 64; with a presenter its multiplier. 0 for the presenter's multiplier, or 1 without a presenter.
     */
    uint32_t multiplier;
    /** Limit of device time per shown frame, in nanoseconds, including the passes that make anchors; 0 for no limit. */
    uint64_t frame_ns;
    /**
     * Limit of the memory that the world in use and its rollout need according to cairn_world_get_memory, in MiB; 0 for no limit.
     */
    uint64_t memory_mib;
    /**
     * Schedules as in operating points, separated by spaces, at most 8, each with fewer passes than the one before: "stock
     * explicit:1:0.5:0"; null for the rollout's own only.
     */
    const char *schedules;
    /**
     * Further worlds of the same bundle, loaded with other global windows, to which the rollout may move. A window with a slice that was longer than
     * longest_submission_us when its world was loaded is used only if no window that fits the memory keeps to it. May be null: the window then does
     * not change.
     */
    const cairn_world *const *worlds;
    /** Number of worlds, at most CAIRN_MAX_BUDGET_WORLDS. */
    uint32_t world_count;
    /** 0 */
    uint32_t reserved;
    /** A presenter whose frames the budget includes; may be null. */
    const cairn_presenter *presenter;
} cairn_budget;

/**
 * Keeps a rollout, and the frames of a presenter, within a budget. From measured times (by the device's clock if it has one, else wall time)
 * it chooses the number of passes per latent, the global window and the number of frames generated between anchors. It reduces passes first,
 * then frames, and the window last; it raises each again when there is time. It also narrows the window when the device's memory runs short.
 * The same controls may therefore give other pictures the next time. A change of window happens before a step, goes through the host's memory
 * and takes a while. No world is loaded for it, because that takes seconds to minutes and the memory of the weights once more: load worlds
 * for the windows that you allow beforehand, on a thread of your own. Changes are logged and counted in cairn_rollout_statistics.
 *
 * Replaces cairn_rollout_set_budget and cairn_presenter_set_budget. The budget ends with cairn_rollout_set_budget, with a restored state and
 * with the rollout; cairn_presenter_set_budget removes the presenter from it.
 *
 * budget: null ends the budget and keeps the present settings.
 *
 * Ownership: the budget is read during the call; on success its worlds are kept alive until it ends, its presenter is not; on failure
 * nothing changes.
 * Threads: one call at a time; a concurrent one, and one while steps are queued, gets CAIRN_ERROR_BUSY.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_BUSY;
 * CAIRN_ERROR_OUT_OF_MEMORY, with the numbers and the window to stay below, if even the narrowest of the worlds needs too much.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_rollout_govern(cairn_rollout *rollout, const cairn_budget *budget);

/* ---- 15. Per frame: input written down, and played again --------------------------------------------------------- */

/** A player's input by world time, in the format of docs/control-script.md. Immutable. */
typedef struct cairn_script cairn_script;

/**
 * Reads a control script.
 *
 * text: length bytes of UTF-8, without a NUL.
 *
 * Ownership: on success *script is the caller's, for cairn_script_destroy; on failure it is not written. The text is read during
 * the call.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_ARGUMENT, with line and column of the error; CAIRN_ERROR_UNSUPPORTED for a newer version
 * of the format.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_script_create(const char *text, size_t length, cairn_script **script);

/**
 * Gives the controls of a latent step: the script's input from (latent - 1) / latents_per_second seconds up to latent /
 * latents_per_second seconds. Consecutive steps miss no input and count none twice. After the script's end nothing moves.
 *
 * latent: number of the step's latent, from 1; 0 is the seed's, which has no controls.
 * latents_per_second: the rollout's, 1 to 240.
 *
 * Ownership: controls stay the caller's and are filled on success, ready for cairn_rollout_step; on failure they are not written.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT, also when the mouse moves farther in the step than
 * cairn_controls allows; CAIRN_ERROR_STRUCT_SIZE.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_script_get_controls(
    const cairn_script *script, uint64_t latent, uint32_t latents_per_second, cairn_controls *controls);

/**
 * Gives the duration of a script: up to its explicit end, or if it has none, up to the end of its last event or motion.
 *
 * microseconds: gets the duration in microseconds of world time.
 *
 * Ownership: *microseconds is written on success; on failure it is not.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_script_get_duration(const cairn_script *script, uint64_t *microseconds);

/**
 * Copies the text of a script in the format's canonical form, for a file.
 *
 * text: at least capacity bytes, or null with capacity 0 to learn the length. Always ends in a NUL when capacity > 0.
 * length: gets the length in bytes of the whole text, without the NUL; may be null.
 *
 * Ownership: the text is copied; on failure nothing is written.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_TRUNCATED; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_script_get_text(const cairn_script *script, char *text, size_t capacity, size_t *length);

/**
 * Destroys the handle of a script; null is allowed.
 *
 * Ownership: on success script is no longer a handle; on failure it is unchanged.
 * Threads: any thread; waits for calls in flight on the script.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_BUSY from within a callback of a call on it.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_script_destroy(cairn_script *script);

/**
 * Records a player's input and makes a script of it. The input is single events as they happen, or the controls of whole latent steps.
 */
typedef struct cairn_recorder cairn_recorder;

/**
 * Creates a recorder with an empty recording.
 *
 * Ownership: on success *recorder is the caller's, for cairn_recorder_destroy; on failure it is not written.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_OUT_OF_MEMORY.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_recorder_create(cairn_recorder **recorder);

/**
 * Records that a key or mouse button went down or up. An event that does not change its state, such as a keyboard's auto-repeat, is
 * ignored.
 *
 * microseconds: world time; events must come in order of time.
 * key: a Windows virtual-key code, 0 to 255.
 * down: 1 or 0.
 *
 * Ownership: nothing is handed over, on success or on failure.
 * Threads: one call at a time; a concurrent one gets CAIRN_ERROR_BUSY.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT, also for a time that no script has, and when
 * the recording is full; CAIRN_ERROR_BUSY.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_recorder_key(cairn_recorder *recorder, uint64_t microseconds, uint32_t key, uint32_t down);

/**
 * Records that the mouse moved by dx (right positive) and dy (down positive) counts.
 *
 * microseconds: world time; events must come in order of time.
 *
 * Ownership: nothing is handed over, on success or on failure.
 * Threads: one call at a time; a concurrent one gets CAIRN_ERROR_BUSY.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT for what no script may hold, such as a number that is not
 * finite, and when the recording is full; CAIRN_ERROR_BUSY.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_recorder_mouse(cairn_recorder *recorder, uint64_t microseconds, float dx, float dy);

/**
 * Records that the wheel turned by this many notches, up positive.
 *
 * microseconds: world time; events must come in order of time.
 *
 * Ownership: nothing is handed over, on success or on failure.
 * Threads: one call at a time; a concurrent one gets CAIRN_ERROR_BUSY.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT for what no script may hold, and when the
 * recording is full; CAIRN_ERROR_BUSY.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_recorder_scroll(cairn_recorder *recorder, uint64_t microseconds, int32_t notches);

/**
 * Records the controls of a latent step. If every step is recorded, in order and without a gap, cairn_script_get_controls gives them
 * back bit for bit.
 *
 * latent: number of the step's latent, from 1.
 * latents_per_second: the rollout's, 1 to 240.
 *
 * Ownership: controls are read during the call; nothing is handed over, on success or on failure.
 * Threads: one call at a time; a concurrent one gets CAIRN_ERROR_BUSY.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT, also for a time that no script has, and when
 * the recording is full; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_BUSY.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_recorder_step(
    cairn_recorder *recorder, uint64_t latent, uint32_t latents_per_second, const cairn_controls *controls);

/**
 * Makes a script of the recording so far. It ends at microseconds of world time; keys that are still held are released there. The
 * recording continues.
 *
 * Ownership: on success *script is the caller's, for cairn_script_destroy; on failure it is not written.
 * Threads: one call at a time; a concurrent one gets CAIRN_ERROR_BUSY.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT, also when the recording has input after that time;
 * CAIRN_ERROR_BUSY; CAIRN_ERROR_OUT_OF_MEMORY.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_recorder_make_script(
    cairn_recorder *recorder, uint64_t microseconds, cairn_script **script);

/**
 * Destroys the handle of a recorder; null is allowed. Scripts that were made of it remain.
 *
 * Ownership: on success recorder is no longer a handle; on failure it is unchanged.
 * Threads: any thread; waits for calls in flight on the recorder.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_BUSY from within a callback of a call on it.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_recorder_destroy(cairn_recorder *recorder);

/* ---- 16. Queries: statistics ------------------------------------------------------------------------------------- */

/**
 * Statistics of a rollout since it was created, as of the end of its last step. Times are nanoseconds of wall time unless a field says otherwise.
 */
typedef struct cairn_rollout_statistics {
    /** sizeof(cairn_rollout_statistics) */
    uint32_t struct_size;
    /** Steps in its queue now, waiting or running. */
    uint32_t queue_depth;
    /** Latents made, including appended ones. */
    uint64_t latents;
    /** Denoise passes. */
    uint64_t denoise_passes;
    /** Cache passes, which compute keys and values for the ring. */
    uint64_t cache_passes;
    /** Passes of the decoder, including those that only prime it. */
    uint64_t decode_passes;
    /** Time of encoding pictures into latents. */
    uint64_t encode_ns;
    /** Time of denoise passes. */
    uint64_t denoise_ns;
    /** Time of cache passes. */
    uint64_t cache_ns;
    /** Time of checking results and copying them into the ring. */
    uint64_t commit_ns;
    /** Time of decoding latents. */
    uint64_t decode_ns;
    /** Time of reading pictures back and resizing them. */
    uint64_t resize_ns;
    /** Bytes from the host to the device. */
    uint64_t uploaded_bytes;
    /** Bytes copied within the device. */
    uint64_t copied_bytes;
    /** Bytes from the device to the host. */
    uint64_t read_bytes;
    /** The part of copied_bytes that went into the ring. */
    uint64_t ring_bytes;
    /**
     * Passes of the transformer whose time was measured by the clock of a Direct3D 12 device; 0 on other devices, like all fields up to
     * other_passes. Their times include other work that the queue did meanwhile.
     */
    uint64_t device_passes;
    /** Total time of these passes, in nanoseconds of the device's clock. */
    uint64_t device_passes_ns;
    /** Time of the longest of these passes, or of the longest slice of one, in nanoseconds of the device's clock. */
    uint64_t device_pass_longest_ns;
    /** Passes of the decoder whose time was measured by the device's clock. */
    uint64_t device_decodes;
    /** Total time of these passes, in nanoseconds of the device's clock. */
    uint64_t device_decodes_ns;
    /** Time of the longest of these passes, in nanoseconds of the device's clock. */
    uint64_t device_decode_longest_ns;
    /** Copies into the ring whose time was measured by the device's clock. */
    uint64_t device_commits;
    /** Total time of these copies, in nanoseconds of the device's clock. */
    uint64_t device_commits_ns;
    /** Nanoseconds of wall time inside ONNX Runtime, which records the device's command lists and submits them. */
    uint64_t runtime_ns;
    /** Nanoseconds of wall time spent waiting for the device. */
    uint64_t waited_ns;
    /** Number of waits because of longest_submission_us of cairn_d3d12_options or of cairn_world_options. */
    uint64_t yields;
    /** Passes with buffers of their own that run from captured commands: see cairn_d3d12_options.captured_passes. */
    uint32_t captured_passes;
    /**
     * Other passes with buffers of their own: not captured, or their captured results are not known to be identical bit for bit.
     */
    uint32_t other_passes;
    /**
     * Nanoseconds per shown frame, as last measured under the budget of cairn_rollout_govern. This and the fields below belong to that budget,
     * or to the last one that ended.
     */
    uint64_t governed_frame_ns;
    /** Latents measured. */
    uint64_t governed_latents;
    /** Frames measured. */
    uint64_t governed_frames;
    /** How often quality was reduced because frames took too long. */
    uint64_t governed_less;
    /** How often quality was raised again. */
    uint64_t governed_more;
    /** How often the window was narrowed because the device's memory was short. */
    uint64_t governed_short_of_memory;
    /** How often frames took too long although quality could not be reduced further. */
    uint64_t governed_beyond;
    /** Denoise passes per latent from now on; 0 if there never was a budget, like the next two fields. */
    uint32_t governed_passes;
    /** The global window from now on. */
    uint32_t governed_window;
    /** Different frames shown per anchor, the anchor included. */
    uint32_t governed_made;
    /** 0 */
    uint32_t reserved;
} cairn_rollout_statistics;

/** Statistics of a presenter since it was created. */
typedef struct cairn_presenter_statistics {
    /** sizeof(cairn_presenter_statistics) */
    uint32_t struct_size;
    /** 0 */
    uint32_t reserved;
    /** Anchors that arrived. */
    uint64_t anchors;
    /** Anchors that arrived after they were due. */
    uint64_t late_anchors;
    /** Nanoseconds by which late anchors have delayed the stream. */
    uint64_t slipped_ns;
    /** Frames drawn that were anchors. Drawing the same frame again counts again, here and below. */
    uint64_t shown_anchors;
    /** Frames drawn that were decoded pictures of an anchor. */
    uint64_t shown_decoded;
    /** Frames drawn that were interpolated between anchors. */
    uint64_t shown_generated;
    /** Frames drawn that were extrapolated from the last anchor. */
    uint64_t shown_extrapolated;
    /** Frames drawn that held a picture because nothing could be generated. */
    uint64_t shown_held;
    /** Frames drawn, of any kind, that repeated the previous one. */
    uint64_t repeated;
    /** Frames drawn that were not generated because of a cut. */
    uint64_t cuts;
    /** Nanoseconds spent on extracting motion and depth. */
    uint64_t guidance_ns;
    /** Nanoseconds spent on generating frames. */
    uint64_t generate_ns;
    /** Nanoseconds spent on resizing frames. */
    uint64_t resize_ns;
    /** The last frame's generator, such as "cpu" or, with its provider's version, "fsr 3.1.5"; empty for none. */
    char generator[32];
    /** Why a preferred generator is not used, for people; UTF-8. */
    char preference[160];
    /** Anchors that have arrived and are not due, as of the latest time that was passed. */
    uint32_t waiting;
    /** Frames for Direct3D 12 that were submitted and have not completed. */
    uint32_t under_way;
    /**
     * Frames for Direct3D 12 whose time was measured by the device's clock. Their times include other work that the queue did meanwhile.
     */
    uint64_t device_frames;
    /** Total time of these frames, in nanoseconds of the device's clock. */
    uint64_t device_frames_ns;
    /** Time of the longest of these frames, in nanoseconds of the device's clock. */
    uint64_t device_frame_longest_ns;
    /** Time of the last of these frames, in nanoseconds of the device's clock. */
    uint64_t device_frame_last_ns;
    /**
     * The presenter's own lists whose time was measured by the device's clock: they upload pictures, extract motion and depth, and prepare
     * the work that all frames of a pair share.
     */
    uint64_t device_lists;
    /** Total time of these lists, in nanoseconds of the device's clock. */
    uint64_t device_lists_ns;
    /** Time of the longest of these lists, in nanoseconds of the device's clock. */
    uint64_t device_list_longest_ns;
    /**
     * Different frames shown per anchor, the anchor included, under a budget of cairn_presenter_set_budget; the others repeat the previous
     * one. 0 if there never was a budget.
     */
    uint32_t made_to_anchor;
    /** How often that number has changed. */
    uint32_t budget_changes;
    /**
     * Upscaler of the last frame: "spatial", AMD's with its version as in "fsr 4.0.3", or empty if frames have the anchors' size.
     */
    char upscaler[32];
    /** Why AMD's upscaler is not used, for people; UTF-8. */
    char upscaling[160];
    /** Frames for Direct3D 12 replaced by an anchor: CAIRN_FRAME_UNPREPARED. */
    uint64_t unprepared;
    /**
     * Direct3D objects and AMD contexts created while frames were recorded or submitted: 0 if all frames were prepared.
     */
    uint64_t objects_made;
    /** Recorded frames whose fences have not been signalled. */
    uint32_t lists_pending;
    /** Pushed anchors whose fences have not been signalled. */
    uint32_t anchors_under_way;
} cairn_presenter_statistics;

/**
 * Returns statistics of a rollout. Does not wait for a step that is running.
 *
 * Ownership: statistics stay the caller's and are filled on success; on failure they are not written.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_rollout_get_statistics(const cairn_rollout *rollout, cairn_rollout_statistics *statistics);

/**
 * Returns statistics of a presenter.
 *
 * Ownership: statistics stay the caller's and are filled on success; on failure they are not written.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_BUSY from within a
 * callback of a call that records frames of the presenter.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_presenter_get_statistics(
    const cairn_presenter *presenter, cairn_presenter_statistics *statistics);

/* ---- 17. Experimental: Direct3D 12 ------------------------------------------------------------------------------- */

/** A flag of cairn_d3d12_options: uses ONNX Runtime's deterministic kernels only, and captures no passes. */
#define CAIRN_D3D12_DETERMINISTIC 1
/** Largest number of recorded frames whose lists may not have run: see cairn_d3d12_preparation.lists. */
#define CAIRN_MAX_LISTS 16
/** A flag of cairn_d3d12_preparation: frames are only submitted, so no memory is allocated for recorded ones. */
#define CAIRN_PREPARE_SUBMIT_ONLY 1

/** Direct3D 12's own, declared so that its header is not needed. */
typedef struct ID3D12CommandQueue ID3D12CommandQueue;

/** Direct3D 12's own, declared so that its header is not needed. */
typedef struct ID3D12Device ID3D12Device;

/** Direct3D 12's own, declared so that its header is not needed. */
typedef struct ID3D12Fence ID3D12Fence;

/** Direct3D 12's own, declared so that its header is not needed. */
typedef struct ID3D12GraphicsCommandList ID3D12GraphicsCommandList;

/** Direct3D 12's own, declared so that its header is not needed. */
typedef struct ID3D12Resource ID3D12Resource;

/** Options of worlds on a Direct3D 12 device. All zero: the options of a new device. */
typedef struct cairn_d3d12_options {
    /** sizeof(cairn_d3d12_options) */
    uint32_t struct_size;
    /** CAIRN_D3D12_DETERMINISTIC, or 0. */
    uint32_t flags;
    /**
     * Largest number of passes of each of a world's graphs that ONNX Runtime may capture: it keeps their commands, and such a pass takes
     * almost no time of the processor. A rollout has at most two per graph; those of destroyed rollouts are kept as long as the world. A
     * captured pass is used only if it gives the same bits as a normal one, which its first runs show. 0 for none.
     */
    uint32_t captured_passes;
    /**
     * Longest work of a rollout that may be queued on the anchors' queue at a time, in microseconds of the device's clock, so that the
     * engine's frames run in between. A pass that would exceed it waits for the work that is queued already. Passes are split only into
     * the slices of their world (cairn_world_options): cairn_rollout_statistics has the longest one and the number of waits. 0 for no limit.
     */
    uint32_t longest_submission_us;
} cairn_d3d12_options;

/**
 * Returns pipelines that cairn_pipelines_store_callback received in an earlier run. Called on the preparing thread: first with null and 0,
 * to return the number of bytes, 0 for none; then with memory of that size, to fill it and return the same number.
 */
typedef uint64_t (*cairn_pipelines_load_callback)(void *bytes, uint64_t capacity, void *user);

/**
 * Receives the pipelines of a device. Called on the preparing thread; the bytes are valid during the call only. Bytes of another adapter,
 * driver or version of the library, and damaged ones, are ignored when they are loaded.
 */
typedef void (*cairn_pipelines_store_callback)(const void *bytes, uint64_t size, void *user);

/**
 * Sizes and formats to prepare frames for Direct3D 12 for. All zero: frames of the presenter's size in any format, from anchors of the size
 * of those that have arrived.
 */
typedef struct cairn_d3d12_preparation {
    /** sizeof(cairn_d3d12_preparation) */
    uint32_t struct_size;
    /** DXGI_FORMAT of the targets; 0 for any supported format, with memory for the widest. */
    uint32_t format;
    /** Width of the targets in pixels; 0 in width and height for the size of the presenter's frames. */
    uint32_t width;
    /** Height of the targets in pixels. */
    uint32_t height;
    /**
     * Width of the anchors in pixels, 1 to 16384; 0 in anchor_width and anchor_height for the size of the anchors that have arrived.
     */
    uint32_t anchor_width;
    /** Height of the anchors in pixels, 1 to 16384. */
    uint32_t anchor_height;
    /** Pictures per anchor, as cairn_anchor_info.pictures; 0 for 1. */
    uint32_t anchor_pictures;
    /**
     * As in cairn_anchor_info, if options.motion is CAIRN_MOTION_PAPER; else 0, like latent_height and latent_width.
     */
    uint32_t latent_channels;
    /** As in cairn_anchor_info. */
    uint32_t latent_height;
    /** As in cairn_anchor_info. */
    uint32_t latent_width;
    /**
     * Largest number of frames recorded into the engine's lists that may not have run, 1 to CAIRN_MAX_LISTS; 0 for 4. Each takes the memory
     * of a frame.
     */
    uint32_t lists;
    /** CAIRN_PREPARE_SUBMIT_ONLY, or 0. */
    uint32_t flags;
    /** Returns pipelines of an earlier run; may be null. */
    cairn_pipelines_load_callback load;
    /** Receives pipelines for the next run; may be null. */
    cairn_pipelines_store_callback store;
    /** Passed to both callbacks. */
    void *user;
} cairn_d3d12_preparation;

/** A command list of the engine's that a frame is recorded into, and the frame's target. */
typedef struct cairn_d3d12_recording {
    /** sizeof(cairn_d3d12_recording) */
    uint32_t struct_size;
    /** D3D12_RESOURCE_STATES of the target before the frame. */
    uint32_t state_before;
    /** D3D12_RESOURCE_STATES of the target after the frame. */
    uint32_t state_after;
    /** 0 */
    uint32_t reserved;
    /** Command list, open for recording, of the type of the device's queue. */
    struct ID3D12GraphicsCommandList *list;
    /**
     * Texture of the frames' size, two-dimensional with one mip level, slice and sample; RGBA8, BGRA8, RGB10A2, RGBA16F or R11G11B10_FLOAT,
     * including the sRGB and typeless variants; RGBA16F or R11G11B10_FLOAT if the presenter's colour space is CAIRN_COLOUR_LINEAR.
     */
    struct ID3D12Resource *target;
    /** A fence of the host's, of the same device. */
    struct ID3D12Fence *fence;
    /** Value that the host signals on the queue that executes the list, after the list. */
    uint64_t fence_value;
} cairn_d3d12_recording;

/**
 * Creates a device on an engine's own Direct3D 12 device. Experimental: this chapter may change without a new CAIRN_ABI_VERSION. If the
 * library has no Direct3D 12 part, every function of the chapter returns CAIRN_ERROR_UNSUPPORTED.
 *
 * d3d12, queue: the engine's; frames are generated and copied on the queue, which must be of type direct or compute.
 * anchors: a compute queue of the same device for the world's passes, so that they do not delay frames; null for one of the library's
 * own.
 * options: may be null for the defaults.
 *
 * Ownership: on success *device is the caller's, for cairn_device_destroy, and holds a reference to each object until it is
 * destroyed; on failure it is not written and no reference is held. What options point to is read during the call only.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_ARGUMENT, also for an object of another kind or device; CAIRN_ERROR_STRUCT_SIZE;
 * CAIRN_ERROR_UNSUPPORTED; CAIRN_ERROR_RUNTIME_MISSING; CAIRN_ERROR_DEVICE; CAIRN_ERROR_DEVICE_REMOVED.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_device_create_d3d12(
    struct ID3D12Device *d3d12, struct ID3D12CommandQueue *queue, struct ID3D12CommandQueue *anchors,
    const cairn_device_options *options, cairn_device **device);

/**
 * Creates a device on an adapter, for hosts without an engine: with a Direct3D 12 device of the library's own.
 *
 * luid: LUID of the adapter, as in cairn_adapter.
 * options: may be null for the defaults.
 *
 * Ownership: on success *device is the caller's, for cairn_device_destroy; on failure it is not written. What options point to is
 * read during the call only.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_ARGUMENT for a LUID that no adapter has; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_UNSUPPORTED;
 * CAIRN_ERROR_RUNTIME_MISSING; CAIRN_ERROR_DEVICE; CAIRN_ERROR_DEVICE_REMOVED.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_device_create_adapter(
    uint64_t luid, const cairn_device_options *options, cairn_device **device);

/**
 * Sets the options of a device for worlds that are loaded, and rollouts that are created, from now on.
 *
 * Ownership: options are read during the call; nothing is handed over, on success or on failure.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_UNSUPPORTED, also
 * for a CPU device.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_device_set_d3d12(const cairn_device *device, const cairn_d3d12_options *options);

/**
 * Returns the Direct3D 12 device and the queue that a device runs on.
 *
 * Ownership: on success *d3d12 and *queue each have one more reference, which the caller releases; on failure neither is written.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_UNSUPPORTED, also for a CPU device.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_device_get_d3d12(
    const cairn_device *device, struct ID3D12Device **d3d12, struct ID3D12CommandQueue **queue);

/**
 * Appends a texture, as cairn_rollout_append appends a picture: the seed, or an edit of the scene.
 *
 * picture: two-dimensional, RGBA8 or BGRA8, one slice. It is read on the device's queue after the work that the queue already has, and must
 * live until this returns.
 * state: D3D12_RESOURCE_STATES of the texture when it is read; it is left in that state.
 * info: may be null.
 *
 * Ownership: the texture stays the caller's; info is filled on success; on failure it is not written and the rollout is as it was.
 * Threads: one call at a time; a concurrent one, and one while steps are queued, gets CAIRN_ERROR_BUSY.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_BUSY;
 * CAIRN_ERROR_UNSUPPORTED; CAIRN_ERROR_OUT_OF_MEMORY; CAIRN_ERROR_DEVICE; CAIRN_ERROR_CANCELLED.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_rollout_append_d3d12(
    cairn_rollout *rollout, struct ID3D12Resource *picture, uint32_t state, cairn_step_info *info);

/**
 * Returns a picture of an anchor as a texture, with the fence value that guards it.
 *
 * index: 0 to pictures - 1, in order of time.
 * texture: gets a texture in RGBA8 of the anchor's size, in state COMMON, in which it must be left.
 * fence, value: get the fence and the value to wait for before the texture is read. Once the fence has the value, the texture does not
 * change. Read it on the device's queue, or on another one while no presenter or rollout of the device works: their lists change its
 * state and back.
 *
 * Ownership: on success *texture and *fence each have one more reference, which the caller releases; on failure nothing is written.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_UNSUPPORTED, also for an anchor that was
 * not made on a Direct3D 12 device.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_anchor_get_d3d12(
    const cairn_anchor *anchor, uint32_t index, struct ID3D12Resource **texture, struct ID3D12Fence **fence,
    uint64_t *value);

/**
 * Creates everything that frames for Direct3D 12 need: pipelines, textures, memory, AMD's libraries with their contexts, and the test that
 * these must pass. Afterwards cairn_presenter_record_d3d12 and cairn_presenter_submit_d3d12 create nothing for frames of these sizes and
 * this format. Call it on a loading thread: it blocks until all is created, for seconds the first time.
 *
 * Until it was called, and for frames of another size, format or device, those two show the nearest anchor instead of each frame, resized on
 * the processor and flagged with CAIRN_FRAME_UNPREPARED: call it again when targets change their size. The preparation before is used until
 * the call returns, and stays in use if the call fails, unless there is no memory for both.
 *
 * Pipelines live as long as the device, and its presenters share them. With callbacks the host keeps them from one run of the program to the
 * next, if the driver supports it; the library writes no file. load is called once per device; store is called if pipelines were compiled
 * that were neither loaded nor stored before, with all pipelines of the device.
 *
 * device: the device on whose queue frames will be made.
 *
 * Ownership: preparation is read during the call; user stays the caller's; nothing is handed over, on success or on failure.
 * Threads: any thread, also while another one pushes, queries, records or submits; a second one that prepares the same presenter gets
 * CAIRN_ERROR_BUSY. Callbacks may call any function but those that destroy the presenter or the device.
 * Results: CAIRN_OK; CAIRN_NOT_READY if no anchor has arrived and the preparation has no anchor size;
 * CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_BUSY; CAIRN_ERROR_UNSUPPORTED, also for a CPU
 * device and if a required generator or upscaler cannot be used; CAIRN_ERROR_RUNTIME_MISSING if AMD's libraries are required and
 * missing; CAIRN_ERROR_OUT_OF_MEMORY; CAIRN_ERROR_DEVICE; CAIRN_ERROR_DEVICE_REMOVED.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_presenter_prepare_d3d12(
    const cairn_presenter *presenter, const cairn_device *device, const cairn_d3d12_preparation *preparation);

/**
 * Makes the frame that is due on the device's queue, the same frame that cairn_presenter_draw writes into memory, and records its copy into
 * the engine's command list. Compute shaders make it unless options.shader is CAIRN_PREFER_NEVER; if they cannot be used, the processor
 * makes it: cairn_presenter_get_statistics tells which, and why. Records a barrier, a copy and a barrier into the list; changes nothing else of
 * it.
 *
 * The list may be executed early or late, in another order than it was recorded in, or never. The memory that it copies from is reused once
 * the fence has its value, and not before; nothing waits for it. Several lists may share a value that is signalled after all of them. If a
 * list is dropped, the host signals its value, or calls cairn_presenter_release_d3d12.
 *
 * Across a cut that only the generator detects, the nearer anchor is shown, too. frame tells so only if the processor made the frame; the
 * statistics count the cut once the frame has run.
 *
 * device: the device on whose queue the list will run; on another queue the list must wait for the work that the device's queue has so far.
 * now_ns: when it will be shown, on the host's clock.
 * recording: its two states must be ones that the list can name: a compute list cannot name RENDER_TARGET. The presenter must live until the
 * list has run.
 * frame: may be null.
 *
 * Ownership: all objects stay the caller's, and the presenter holds a reference to the fence until it has its value; on success frame is
 * filled; on failure it is not written and no frame is recorded.
 * Threads: one call at a time; a concurrent one gets CAIRN_ERROR_BUSY. Does not wait for a thread that prepares.
 * Results: CAIRN_OK; CAIRN_NOT_READY before the first anchor has arrived; CAIRN_QUEUE_FULL if as many lists as were prepared may not have
 * run: nothing is recorded, and the target keeps its contents; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT, also without a fence,
 * for a fence of another device or one that has the value already, and if CAIRN_MOTION_PAPER or CAIRN_MOTION_LATENTS is used with an anchor
 * without a latent; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_BUSY; CAIRN_ERROR_UNSUPPORTED, also for a CPU device; CAIRN_ERROR_OUT_OF_MEMORY;
 * CAIRN_ERROR_DEVICE; CAIRN_ERROR_DEVICE_REMOVED.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_presenter_record_d3d12(
    cairn_presenter *presenter, const cairn_device *device, uint64_t now_ns, const cairn_d3d12_recording *recording,
    cairn_frame *frame);

/**
 * Makes the frame that is due in a texture, in a list of the presenter's own that it submits to the device's queue after all earlier work.
 * Waits if three earlier frames have not run.
 *
 * device, now_ns, frame: as for cairn_presenter_record_d3d12.
 * target, before, after: the texture and its states, as in cairn_d3d12_recording. The presenter may hold a reference to target until the third
 * frame after it is made or cairn_presenter_release_d3d12 is called.
 * fence, value: get the fence and the value to wait for before the frame is read outside the queue, and before target is freed.
 *
 * Ownership: target stays the caller's; on success *fence has one more reference, which the caller releases, and frame is filled;
 * on failure nothing is written and no frame was submitted.
 * Threads: one call at a time; a concurrent one gets CAIRN_ERROR_BUSY. The queue may be used by others at the same time.
 * Results: CAIRN_OK; CAIRN_NOT_READY, CAIRN_QUEUE_FULL and the errors, as of cairn_presenter_record_d3d12.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_presenter_submit_d3d12(
    cairn_presenter *presenter, const cairn_device *device, uint64_t now_ns, struct ID3D12Resource *target,
    uint32_t before, uint32_t after, cairn_frame *frame, struct ID3D12Fence **fence, uint64_t *value);

/**
 * Waits until all frames have run and releases their targets, as a swap chain requires before its buffers are resized. Every list that a
 * frame was recorded into must have been submitted to the queue, or must never run: the memory it copies from is reused whether or not its
 * fence has its value.
 *
 * Ownership: nothing is handed over, on success or on failure.
 * Threads: one call at a time; a concurrent one gets CAIRN_ERROR_BUSY.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_BUSY; CAIRN_ERROR_UNSUPPORTED; CAIRN_ERROR_DEVICE_REMOVED.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_presenter_release_d3d12(cairn_presenter *presenter);

/* ---- 18. Experimental: AMD's swap chain -------------------------------------------------------------------------- */

/** The provider that AMD's libraries and the driver prefer. */
#define CAIRN_FSR_ANY 0
/** The newest machine-learning provider, or else the newest analytic one. */
#define CAIRN_FSR_PREFER_ML 1
/** The newest analytic provider, or else the newest machine-learning one. */
#define CAIRN_FSR_PREFER_ANALYTIC 2
/** The newest machine-learning provider; fails if there is none. */
#define CAIRN_FSR_REQUIRE_ML 3
/** The newest analytic provider; fails if there is none. */
#define CAIRN_FSR_REQUIRE_ANALYTIC 4

/**
 * A flag of cairn_swapchain_options: frames are generated on a compute queue of the swap chain's own, in parallel with the engine's work.
 */
#define CAIRN_SWAPCHAIN_ASYNC 1
/** A flag of cairn_swapchain_options: the motion texture has the buffers' size instead of the render size. */
#define CAIRN_SWAPCHAIN_SHOWN_MOTION 2
/** A flag of cairn_swapchain_options: motion vectors include the camera's jitter. */
#define CAIRN_SWAPCHAIN_JITTERED_MOTION 4
/** A flag of cairn_swapchain_options: depth is 1 at the near plane. */
#define CAIRN_SWAPCHAIN_INVERTED_DEPTH 8
/** A flag of cairn_swapchain_options: the far plane is infinitely far away. */
#define CAIRN_SWAPCHAIN_INFINITE_DEPTH 16
/** A flag of cairn_swapchain_options: buffers have high dynamic range, as set by SetColorSpace1 and SetHDRMetaData. */
#define CAIRN_SWAPCHAIN_HDR 32
/** A flag of cairn_swapchain_options: AMD's provider checks its inputs and logs errors in them. */
#define CAIRN_SWAPCHAIN_CHECKED 64

/**
 * A flag of cairn_swapchain_options: skips the self-test, in which a provider must move a picture of known motion to the right position.
 */
#define CAIRN_SWAPCHAIN_UNTRIED 128

/**
 * A flag of cairn_swapchain_frame: the frame has no predecessor, as after a cut. No frame is generated between it and the previous one.
 */
#define CAIRN_SWAPCHAIN_RESET 1
/** A flag of cairn_swapchain_set_interface: colours are premultiplied by alpha. */
#define CAIRN_INTERFACE_PREMULTIPLIED 1

/**
 * A flag of cairn_swapchain_set_interface: the picture is copied within Present, and may be drawn to again when Present returns. AMD's
 * swap chain then forgets it; cairn_swapchain_prepare sets it again. Without that call, set it before each Present.
 */
#define CAIRN_INTERFACE_COPIED 2

/**
 * A flag of cairn_swapchain_pacing: waits by sleeping, and by spinning for the last spin_ticks; without it, by spinning alone.
 */
#define CAIRN_PACING_HYBRID_SPIN 1
/** A flag of cairn_swapchain_pacing: a thread sleeps until the fence is signalled; without it, the thread spins. */
#define CAIRN_PACING_WAIT_ON_FENCE 2

/**
 * Options of AMD's swap chain. All zero: any provider that passes the self-test, with motion and depth of the buffers' size.
 */
typedef struct cairn_swapchain_options {
    /** sizeof(cairn_swapchain_options) */
    uint32_t struct_size;
    /** CAIRN_SWAPCHAIN_ASYNC to CAIRN_SWAPCHAIN_UNTRIED */
    uint32_t flags;
    /** CAIRN_FSR_ANY to CAIRN_FSR_REQUIRE_ANALYTIC */
    uint32_t provider;
    /** DXGI_FORMAT of frames without user interface; 0 for that of the buffers. */
    uint32_t hudless_format;
    /**
     * Largest width in pixels of motion and depth; 0 in both fields for the buffers' size, also after they are resized.
     */
    uint32_t max_render_width;
    /** See max_render_width. */
    uint32_t max_render_height;
} cairn_swapchain_options;

/**
 * Motion and depth of a frame that the engine draws. Textures are two-dimensional with one level, slice and sample. Each must be in the
 * given D3D12_RESOURCE_STATES before the list runs, and is in it afterwards.
 */
typedef struct cairn_swapchain_frame {
    /** sizeof(cairn_swapchain_frame) */
    uint32_t struct_size;
    /** CAIRN_SWAPCHAIN_RESET */
    uint32_t flags;
    /** Device depth, of the render size. */
    ID3D12Resource *depth;
    /**
     * Motion from this frame to the previous one in half or single floats, of the render size, or of the buffers' with CAIRN_SWAPCHAIN_SHOWN_MOTION.
     */
    ID3D12Resource *motion;
    /**
     * The frame without user interface, of the buffers' size and options.hudless_format; may be null if that is the buffers' own format. It
     * is read within Present and must not be drawn to until Present returns, with CAIRN_SWAPCHAIN_ASYNC until the next Present returns.
     */
    ID3D12Resource *hudless;
    /**
     * Lens distortion: each pixel's position after the lens minus its position before, as a fraction of the picture, of the buffers' size. May
     * be null. It is read within Present, as hudless is.
     */
    ID3D12Resource *distortion;
    /** State of depth. */
    uint32_t depth_state;
    /** State of motion. */
    uint32_t motion_state;
    /** State of hudless; with CAIRN_SWAPCHAIN_ASYNC one that a compute queue knows. */
    uint32_t hudless_state;
    /** State of distortion, as hudless_state. */
    uint32_t distortion_state;
    /** Render size in pixels, at most that of the options. */
    uint32_t render_width;
    /** See render_width. */
    uint32_t render_height;
    /**
     * The rectangle of the buffers that shows the world, in pixels; the rest is shown unchanged. Depth and motion cover this rectangle and
     * nothing else: the render size is mapped onto it. Size 0 for all of it.
     */
    uint32_t world_left;
    /** See world_left. */
    uint32_t world_top;
    /** See world_left. */
    uint32_t world_width;
    /** See world_left. */
    uint32_t world_height;
    /** Camera jitter in render pixels. */
    float jitter_x;
    /** See jitter_x. */
    float jitter_y;
    /** Factor from motion values to pixels of the motion texture's size; 0 for 1. */
    float motion_scale_x;
    /** See motion_scale_x. */
    float motion_scale_y;
    /** Milliseconds of world time since the previous frame, above 0. */
    float frame_time_ms;
    /**
     * Vertical field of view in radians, inside (0, pi). 0 for an unknown camera: at the origin, looking along z with y up, 1 radian, from
     * 0.1 to 100 metres. The fields below are then ignored.
     */
    float vertical_fov;
    /** Distance of the near plane, above 0. */
    float near_plane;
    /** Distance of the far plane, above 0 and different from near; ignored with CAIRN_SWAPCHAIN_INFINITE_DEPTH. */
    float far_plane;
    /** Metres per world unit; 0 for 1. */
    float metres;
    /** Camera position in the world. */
    float position[3];
    /** Camera's up direction in the world; a unit vector, as the next two. */
    float up[3];
    /** Camera's right direction. */
    float right[3];
    /** Camera's forward direction. */
    float forward[3];
    /** 0 */
    uint32_t reserved;
} cairn_swapchain_frame;

/** Pacing of presents. */
typedef struct cairn_swapchain_pacing {
    /** sizeof(cairn_swapchain_pacing) */
    uint32_t struct_size;
    /** CAIRN_PACING_HYBRID_SPIN, CAIRN_PACING_WAIT_ON_FENCE */
    uint32_t flags;
    /** Safety margin in milliseconds, subtracted from the time between presents, 0 or more; AMD's default is 0.1. */
    float safety_margin_ms;
    /** Fraction of the frame times' variance subtracted as well, from 0 to 1; AMD's default is 0.1. */
    float variance_factor;
    /** Ticks of the system's timer that CAIRN_PACING_HYBRID_SPIN spins for; AMD's default is 2. */
    uint32_t spin_ticks;
} cairn_swapchain_pacing;

/** Statistics of AMD's swap chain. */
typedef struct cairn_swapchain_statistics {
    /** sizeof(cairn_swapchain_statistics) */
    uint32_t struct_size;
    /** Last error code of AMD's generator within Present, one of ffx-api's; 0 if it never failed. */
    uint32_t failed;
    /** Frames generated. */
    uint64_t generated;
    /** Bytes of device memory that the generator reports; 0 if unknown. */
    uint64_t generator_bytes;
    /** The part of them that may alias other memory. */
    uint64_t generator_aliasable_bytes;
    /** Bytes of device memory of the swap chain itself; 0 if unknown. */
    uint64_t swapchain_bytes;
    /** The part of them that may alias other memory. */
    uint64_t swapchain_aliasable_bytes;
    /**
     * Provider that generates frames, such as "3.1.6 (analytic)"; empty if cairn_swapchain_fit could not create one. UTF-8.
     */
    char generator[64];
    /** Provider of the swap chain, which presents frames. UTF-8. */
    char pacer[64];
    /**
     * Frames that were presented twice because no frame was generated before them: they were not prepared, or the generation failed.
     */
    uint64_t repeated;
} cairn_swapchain_statistics;

/** DXGI's own, declared so that its header is not needed. */
typedef struct DXGI_SWAP_CHAIN_DESC DXGI_SWAP_CHAIN_DESC;

/** DXGI's own, declared so that its header is not needed. */
typedef struct DXGI_SWAP_CHAIN_DESC1 DXGI_SWAP_CHAIN_DESC1;

/** DXGI's own, declared so that its header is not needed. */
typedef struct DXGI_SWAP_CHAIN_FULLSCREEN_DESC DXGI_SWAP_CHAIN_FULLSCREEN_DESC;

/** DXGI's own, declared so that its header is not needed. */
typedef struct IDXGIFactory IDXGIFactory;

/** DXGI's own, declared so that its header is not needed. */
typedef struct IDXGISwapChain IDXGISwapChain;

/** DXGI's own, declared so that its header is not needed. */
typedef struct IDXGISwapChain4 IDXGISwapChain4;

/**
 * AMD's swap chain, which presents generated frames between an engine's own and paces them. A presenter's frames do not need it: they go
 * into textures, which the engine presents as it likes. Experimental, like all of this chapter; not available if the library has no
 * Direct3D 12 part.
 *
 * The engine draws into its buffers and calls Present as usual; before that it records the frame's motion and depth with
 * cairn_swapchain_prepare. AMD's swap chain presents on threads of its own. AMD's libraries are searched for as cairn_device_options
 * says.
 *
 * Threads: a call on the DXGI swap chain, such as Present, counts as a call on this object.
 */
typedef struct cairn_swapchain cairn_swapchain;

/**
 * Replaces an engine's swap chain by AMD's. It must be windowed, *own must be the only reference to it, and none of its buffers may be
 * referenced.
 *
 * device: its queue for frames must be the direct queue that the engine draws on.
 * options: may be null for the defaults.
 * own: becomes null once AMD's library gets the swap chain, even if that library then fails; an earlier failure leaves it unchanged.
 *
 * Ownership: on success *swapchain is the caller's, for cairn_swapchain_destroy, and the reference in *own is gone; on failure
 * *swapchain is not written.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT, also where AMD's library would hang or crash: for a queue
 * that is not direct, and a swap chain that is full screen, has no size, has other references or has a number of buffers other than 2 to 16,
 * with AMD's SDK 1.1 2 to 6; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_UNSUPPORTED, also if no provider passes the self-test, and for frames
 * without user interface in a format of their own with AMD's SDK 1.1.2 and earlier; CAIRN_ERROR_RUNTIME_MISSING if AMD's libraries are missing;
 * CAIRN_ERROR_OUT_OF_MEMORY; CAIRN_ERROR_DEVICE; CAIRN_ERROR_DEVICE_REMOVED.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_swapchain_wrap(
    const cairn_device *device, const cairn_swapchain_options *options, struct IDXGISwapChain **own,
    cairn_swapchain **swapchain);

/**
 * Creates AMD's swap chain as IDXGIFactory::CreateSwapChain does.
 *
 * device, options: as for cairn_swapchain_wrap.
 * description: of the swap chain, which must be windowed.
 *
 * Ownership: on success *swapchain is the caller's, for cairn_swapchain_destroy; on failure it is not written. factory stays the
 * caller's.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK, and the errors of cairn_swapchain_wrap.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_swapchain_create(
    const cairn_device *device, const cairn_swapchain_options *options, struct IDXGIFactory *factory,
    const struct DXGI_SWAP_CHAIN_DESC *description, cairn_swapchain **swapchain);

/**
 * Creates AMD's swap chain for a window as IDXGIFactory2::CreateSwapChainForHwnd does.
 *
 * device, options: as for cairn_swapchain_wrap.
 * window: a HWND that outlives the swap chain.
 * fullscreen: may be null; otherwise its Windowed must be true.
 *
 * Ownership: on success *swapchain is the caller's, for cairn_swapchain_destroy; on failure it is not written. factory stays the
 * caller's.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK, and the errors of cairn_swapchain_wrap.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_swapchain_create_for_window(
    const cairn_device *device, const cairn_swapchain_options *options, struct IDXGIFactory *factory, void *window,
    const struct DXGI_SWAP_CHAIN_DESC1 *description, const struct DXGI_SWAP_CHAIN_FULLSCREEN_DESC *fullscreen,
    cairn_swapchain **swapchain);

/**
 * Gives the DXGI swap chain, into whose buffers the engine draws and which it presents.
 *
 * Ownership: on success *dxgi is a new reference, which the caller releases before cairn_swapchain_destroy; on failure it is not
 * written.
 * Threads: one call at a time; a concurrent one gets CAIRN_ERROR_BUSY.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_BUSY.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_swapchain_get_dxgi(cairn_swapchain *swapchain, struct IDXGISwapChain4 **dxgi);

/**
 * Records motion and depth of the frame that is presented next; Present then also shows a frame generated between it and the previous
 * one. A frame without this recording is presented twice, unless generation is paused, and the next one has no history. The list's
 * descriptor heaps, compute root signature and pipeline are replaced; the rest of its state does not change.
 *
 * list: open for recording, for the device's queue; execute it there before Present.
 *
 * Ownership: everything stays the caller's, on success and on failure. What frame points to must live until the list has run, and
 * textures that are read within Present until it returns, with CAIRN_SWAPCHAIN_ASYNC until the next Present returns.
 * Threads: one call at a time; a concurrent one gets CAIRN_ERROR_BUSY.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT with nothing recorded; CAIRN_ERROR_STRUCT_SIZE;
 * CAIRN_ERROR_BUSY; CAIRN_ERROR_INVALID_STATE if buffers were resized and cairn_swapchain_fit was not called; CAIRN_ERROR_OUT_OF_MEMORY;
 * CAIRN_ERROR_DEVICE and CAIRN_ERROR_DEVICE_REMOVED, after which the list may hold a part of the work.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_swapchain_prepare(
    cairn_swapchain *swapchain, ID3D12GraphicsCommandList *list, const cairn_swapchain_frame *frame);

/**
 * Sets the picture of the user interface, which is composited over real and generated frames from the next Present on. Waits for frames
 * that show the previous picture.
 *
 * picture: of the buffers' size, with alpha; null for none. It is read within Present and after it; without CAIRN_INTERFACE_COPIED do not
 * draw to it before cairn_swapchain_wait.
 * state: the picture's D3D12_RESOURCE_STATES whenever the library reads it.
 * flags: CAIRN_INTERFACE_PREMULTIPLIED, CAIRN_INTERFACE_COPIED
 *
 * Ownership: picture stays the caller's; on success the swap chain keeps a reference until another picture is set; on failure it keeps
 * the previous one.
 * Threads: one call at a time; a concurrent one gets CAIRN_ERROR_BUSY.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_BUSY; CAIRN_ERROR_DEVICE;
 * CAIRN_ERROR_DEVICE_REMOVED.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_swapchain_set_interface(
    cairn_swapchain *swapchain, ID3D12Resource *picture, uint32_t state, uint32_t flags);

/**
 * Sets the pacing of presents.
 *
 * pacing: null for AMD's defaults.
 *
 * Ownership: pacing is read during the call; nothing is handed over, on success or on failure.
 * Threads: one call at a time; a concurrent one gets CAIRN_ERROR_BUSY.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_BUSY;
 * CAIRN_ERROR_UNSUPPORTED with AMD's SDK 1.1.2 and earlier; CAIRN_ERROR_DEVICE.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_swapchain_set_pacing(cairn_swapchain *swapchain, const cairn_swapchain_pacing *pacing);

/**
 * Disables generated frames until a frame is prepared again. Waits until all frames are shown.
 *
 * Ownership: nothing is handed over, on success or on failure.
 * Threads: one call at a time; a concurrent one gets CAIRN_ERROR_BUSY.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_BUSY; CAIRN_ERROR_DEVICE; CAIRN_ERROR_DEVICE_REMOVED.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_swapchain_pause(cairn_swapchain *swapchain);

/**
 * Waits until all frames that were given to Present are shown.
 *
 * Ownership: nothing is handed over, on success or on failure.
 * Threads: one call at a time; a concurrent one gets CAIRN_ERROR_BUSY.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_BUSY; CAIRN_ERROR_DEVICE; CAIRN_ERROR_DEVICE_REMOVED.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_swapchain_wait(cairn_swapchain *swapchain);

/**
 * Adapts to the current size and format of the buffers: call it after ResizeBuffers, before the next frame is prepared. An interface of
 * another size is removed. After a failure no frames are generated until it succeeds.
 *
 * Ownership: nothing is handed over, on success or on failure.
 * Threads: one call at a time; a concurrent one gets CAIRN_ERROR_BUSY.
 * Results: CAIRN_OK, and the errors of cairn_swapchain_wrap.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_swapchain_fit(cairn_swapchain *swapchain);

/**
 * Gives counters and memory use of a swap chain.
 *
 * Ownership: statistics stay the caller's and are filled on success; on failure they are not written.
 * Threads: any thread, at any time; waits for another call on the swap chain.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_DEVICE;
 * CAIRN_ERROR_BUSY from within a callback of a call on it.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_swapchain_get_statistics(
    const cairn_swapchain *swapchain, cairn_swapchain_statistics *statistics);

/**
 * Destroys a swap chain in the order that AMD requires: disables generation, finishes presenting, destroys the generator, the swap chain
 * and its pacing. Null is allowed. The engine must first release every reference to the DXGI swap chain and its buffers.
 *
 * Ownership: on success swapchain is no longer a handle; on failure it is unchanged.
 * Threads: any thread; waits for calls in flight on the swap chain.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_BUSY while there are references to the DXGI swap chain, and from within a
 * callback of a call on it.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_swapchain_destroy(cairn_swapchain *swapchain);

#ifdef __cplusplus
} /* extern "C" */
#endif

#endif /* CAIRN_H */
