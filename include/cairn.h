/* Made from src/abi by `cargo xtask fix`; changes here are lost. */

/**
 * Cairn: a generative world inside a game engine. A world model draws few, strong pictures (anchors) from the player's
 * controls; motion-guided frame generation fills in the rest. This header is the whole library: load the shared library with
 * it, or link against it.
 *
 * It is a course, to be read from the top: what it promises (version, results, logging), what is created once (device, world),
 * what is done in every frame (pictures and controls, anchors, rollouts, guidance, presenters), what can be asked, and last
 * what may still change.
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
 * The rules, once:
 *
 * Handles. A pointer to an object, such as cairn_world *, is a number to be handed back, never memory to be read. One that is
 * null, stale, of another object or made up gives CAIRN_ERROR_INVALID_HANDLE. What has a create function has a destroy
 * function, which takes null and waits for calls in flight. Objects keep what they need alive, so the order does not matter.
 *
 * Threads. Through a pointer to const, any number of threads may call at the same time. Through a pointer that is not const,
 * one call at a time: a second one beside it gets CAIRN_ERROR_BUSY and does nothing. Nothing a thread does wrong here corrupts
 * memory.
 *
 * Structs. Set struct_size to the struct's sizeof, also of structs that the library fills, and zero what you do not set: zero
 * is every field's default. Hosts compiled with an older header, whose structs are shorter, are understood; so are newer ones
 * as long as they ask for nothing this library does not know. The library never writes past struct_size.
 *
 * Results. 0 is success, a positive number is not an error, a negative one is; besides those named at a function, any may
 * answer CAIRN_ERROR_INTERNAL, and any that takes a handle CAIRN_ERROR_POISONED. A call that fails has done nothing, and has
 * written none of its results. All text is UTF-8.
 *
 * Memory. What the caller passes is read or written during the call and not kept, where it is not said otherwise. Null,
 * misaligned and too short buffers are refused; a pointer to something else altogether cannot be caught.
 *
 * Callbacks are called without a lock held and may call Cairn, but must not destroy what a call further up is using, and must
 * not throw. The library starts no thread before an object that needs one, and writes no file unless asked.
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
 * What the library was built as, to be compared with the constant of the same name in the header a host was compiled with.
 *
 * History: 1 is the first; in 2 devices have cairn_device_options.
 */
#define CAIRN_ABI_VERSION 2
/** The version of the library this header belongs to: major * 1000000 + minor * 1000 + patch. */
#define CAIRN_VERSION 1000

/**
 * The binary interface of the loaded library. It must be equal to CAIRN_ABI_VERSION of the header, or nothing else may be
 * called: structs or functions have changed in a way that old hosts cannot know.
 *
 * Ownership: nothing is handed over, on success or on failure.
 * Threads: any thread, at any time.
 * Results: the number itself; cannot fail.
 * Since: 0.1.0
 */
CAIRN_API uint32_t cairn_abi_version(void);

/**
 * The version of the loaded library, as CAIRN_VERSION. Where the binary interface is equal, a library that is not older
 * than the header has all that the header names.
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
 * What a call answers: 0 is success, a positive number is not an error, a negative one is. Numbers are never used again
 * for something else; a newer library may answer with numbers this header does not know, whose sign still tells.
 */
typedef int32_t cairn_result;

/** It worked. */
#define CAIRN_OK 0
/** Not an error: what was asked for is not there yet. Ask again later. */
#define CAIRN_NOT_READY 1
/** Not an error: a text was longer than the buffer and was cut; the buffer holds its beginning. */
#define CAIRN_TRUNCATED 2
/** Not an error: the queue is full and nothing was taken. Take results from it, then try again. */
#define CAIRN_QUEUE_FULL 3
/** An argument is outside its range, not finite, null, misaligned or not UTF-8. The message names it. */
#define CAIRN_ERROR_INVALID_ARGUMENT (-1)
/** The handle is null, was destroyed, belongs to another kind of object, or never was one. */
#define CAIRN_ERROR_INVALID_HANDLE (-2)

/**
 * A struct_size is no size that the struct ever had, or a larger one with bytes set that this library does not know.
 */
#define CAIRN_ERROR_STRUCT_SIZE (-3)
/** The object is in use by another call that allows no second one beside it. Nothing was done. */
#define CAIRN_ERROR_BUSY (-4)
/** A valid request that this build, platform, device or world cannot serve. */
#define CAIRN_ERROR_UNSUPPORTED (-5)
/** More memory is needed than there is, or than was allowed. The message has the figures. */
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
/** The host asked to stop. */
#define CAIRN_ERROR_CANCELLED (-12)
/** An earlier call on this object failed by a fault of the library. The object can only be destroyed. */
#define CAIRN_ERROR_POISONED (-13)

/**
 * A fault of the library. What the call had hold of is poisoned; everything else goes on. Please report the message.
 */
#define CAIRN_ERROR_INTERNAL (-14)

/**
 * The graphics device is gone: its driver was replaced, a command hung, the adapter was taken out. The message has the reason.
 * Destroy what was made on it, and make a new device.
 */
#define CAIRN_ERROR_DEVICE_REMOVED (-15)

/**
 * The name of a result, such as "CAIRN_ERROR_IO"; "unknown result" for a number this library never answers with.
 *
 * Ownership: the text is static and must not be freed, on success or on failure.
 * Threads: any thread, at any time.
 * Results: the text; never null, cannot fail.
 * Since: 0.1.0
 */
CAIRN_API const char *cairn_result_name(cairn_result result);

/**
 * The message of the calling thread's latest call that answered with an error: what went wrong, with which argument or
 * file, and what can be done. It begins with the name of the function. Empty when no call of this thread has failed yet.
 * Calls that succeed leave it alone.
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
 * One part of the message of cairn_last_error, for hosts that show them in places of their own, or raise exceptions.
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

/** No message at all. */
#define CAIRN_LOG_OFF 0
/** Something failed. */
#define CAIRN_LOG_ERROR 1
/** Something is odd, and the work goes on. */
#define CAIRN_LOG_WARNING 2
/** What a user may want to know. */
#define CAIRN_LOG_INFO 3
/** What a developer may want to know. */
#define CAIRN_LOG_DEBUG 4
/** Everything. */
#define CAIRN_LOG_TRACE 5

/**
 * Gets one message. level is one of CAIRN_LOG_ERROR to CAIRN_LOG_TRACE; target names the part of the library, such as
 * "cairn::onnxruntime"; both texts are UTF-8 and valid during the call only. user is what was given with the callback.
 *
 * It is called on whatever thread has something to say, also on several at once, without any lock held. It may call
 * Cairn, but not end the call it is in: it must not destroy an object that a call further up is using, and must not throw.
 * What is logged while it runs, on its own thread, is dropped.
 */
typedef void (*cairn_log_callback)(uint32_t level, const char *target, const char *message, void *user);

/**
 * Sets where messages of at least that importance go: level is CAIRN_LOG_OFF to CAIRN_LOG_TRACE. A null callback ends
 * logging. There is one for the whole process; without one nothing is logged.
 *
 * When this returns, the callback set before is not running and will not be called again, so what its user pointer points
 * to may go.
 *
 * Ownership: user stays the caller's; on success it must live until another callback is set, on failure nothing changes.
 * Threads: any thread; waits for calls of the former callback. Not from within that callback.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_ARGUMENT for another level; CAIRN_ERROR_BUSY from within the former callback;
 * CAIRN_ERROR_UNSUPPORTED when the library is linked into a program whose own logger has the log.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_set_log_callback(uint32_t level, cairn_log_callback callback, void *user);

/* ---- 4. Threads -------------------------------------------------------------------------------------------------- */

/**
 * Threads of the library's own have a priority below normal, so that a game's go first: THREAD_PRIORITY_BELOW_NORMAL on Windows, a
 * nice value raised by 5 on Linux.
 */
#define CAIRN_PRIORITY_BELOW_NORMAL 0
/** They have the normal priority; on Linux that of the thread whose call starts them. */
#define CAIRN_PRIORITY_NORMAL 1
/** They have the lowest priority: THREAD_PRIORITY_LOWEST on Windows, a nice value raised by 10 on Linux. */
#define CAIRN_PRIORITY_LOWEST 2
/** The most threads of the library's own, and the most that a host's job system may have. */
#define CAIRN_MAX_THREADS 1024

/**
 * The library's own threads, which share work on pictures with the thread that calls: frame generation on the processor, motion,
 * resampling.
 */
typedef struct cairn_thread_options {
    /** sizeof(cairn_thread_options) */
    uint32_t struct_size;
    /**
     * How many, 1 to CAIRN_MAX_THREADS, beside those that call; 0 for one less than the physical cores this process may use, at
     * least one.
     */
    uint32_t threads;
    /** CAIRN_PRIORITY_BELOW_NORMAL, CAIRN_PRIORITY_NORMAL or CAIRN_PRIORITY_LOWEST */
    uint32_t priority;
    /** 0 */
    uint32_t reserved;
} cairn_thread_options;

/**
 * Does a part of the library's work; data is what cairn_run_callback got. May be called on any thread. A call with data whose work is
 * over returns at once, until the library is unloaded.
 */
typedef void (*cairn_job)(void *data);

/**
 * Calls job(data) up to jobs times, at the same time on as many threads as it likes, the calling one among them, and returns when
 * these calls have returned. Each call takes a share of the work that no other has; what is left undone when it returns, whether it
 * made too few calls or none, the library does on the calling thread, and it waits for calls that have not returned. user is what
 * the scheduler has.
 *
 * It is called on threads that call the library, also on several at once, without any lock held, and never within a job. It may call
 * Cairn, but must not destroy an object that a call further up is using, and must not throw.
 */
typedef void (*cairn_run_callback)(void *user, uint32_t jobs, cairn_job job, void *data);

/** A host's job system. */
typedef struct cairn_scheduler {
    /** sizeof(cairn_scheduler) */
    uint32_t struct_size;
    /** The most jobs that run at the same time, 1 to CAIRN_MAX_THREADS. */
    uint32_t concurrency;
    /** Runs jobs; required. */
    cairn_run_callback run;
    /** Handed to the callback. */
    void *user;
} cairn_scheduler;

/**
 * Sets how many threads of its own the library has, and their priority, for the whole process. They start with the first work to be
 * shared, and have ended when the call that destroys the last object returns. Results do not depend on how many there are.
 *
 * options: may be null for the defaults.
 *
 * Ownership: options stays the caller's, on success or on failure, which changes nothing.
 * Threads: any thread, while there is no object of this library.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_BUSY while there is an object.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_set_threads(const cairn_thread_options *options);

/**
 * Sets the job system on which the library shares its work in place of threads of its own, which then are not started, for the whole
 * process. Results do not depend on it.
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
/** Float32. */
#define CAIRN_PRECISION_F32 1
/** Float16. */
#define CAIRN_PRECISION_F16 2

/**
 * A flag of cairn_device_options: ONNX Runtime's deterministic kernels only. Its CPU kernels repeat bit for bit at a fixed
 * thread count without it, too. On a Direct3D 12 device, what CAIRN_D3D12_DETERMINISTIC is.
 */
#define CAIRN_DEVICE_DETERMINISTIC 1

/**
 * A flag of cairn_device_options: environment variables and the user's cache directory may name libraries, which are loaded into
 * the process. For tools; a game that sets it runs the code of whoever sets its variables.
 */
#define CAIRN_DEVICE_ENVIRONMENT 2

/** A device that runs worlds. */
typedef struct cairn_device cairn_device;

/**
 * How a device is made, and where the libraries it needs are. All zero: one thread for each physical core, and libraries beside
 * this one or beside the program.
 */
typedef struct cairn_device_options {
    /** sizeof(cairn_device_options) */
    uint32_t struct_size;
    /**
     * Of a CPU device, threads that share one pass, 1 to 1024, the caller's own among them; 0 for one for each physical core.
     * The numbers of a rollout depend on it in their last bits. A Direct3D 12 device has no use for it.
     */
    uint32_t threads;
    /** CAIRN_DEVICE_DETERMINISTIC and CAIRN_DEVICE_ENVIRONMENT, or 0. */
    uint32_t flags;
    /** 0 */
    uint32_t reserved;
    /**
     * The file of ONNX Runtime 1.24.x, UTF-8; on Windows DirectML.dll lies beside it. Null: the first that is beside this library
     * or beside the program. With CAIRN_DEVICE_ENVIRONMENT, before these the one that the environment variable CAIRN_ONNXRUNTIME
     * names, which then alone counts, and after them one in the user's cache directory. A process uses one file only.
     */
    const char *onnxruntime;
    /**
     * The folder of AMD's libraries for FSR, UTF-8, for presenters and swap chains on a Direct3D 12 device. Null: beside this
     * library, else beside the program. With CAIRN_DEVICE_ENVIRONMENT, before these the folder that the environment variable
     * CAIRN_FFX_DIR names, which then alone counts.
     */
    const char *ffx;
} cairn_device_options;

/** Properties of a device. */
typedef struct cairn_device_info {
    /** sizeof(cairn_device_info) */
    uint32_t struct_size;
    /** CAIRN_DEVICE_CPU or CAIRN_DEVICE_D3D12 */
    uint32_t kind;
    /** Default precision: CAIRN_PRECISION_F32 or CAIRN_PRECISION_F16 */
    uint32_t precision;
    /** Threads that share one pass. */
    uint32_t threads;
    /** For people, such as "ONNX Runtime 1.24.4 CPU, 8 threads"; UTF-8. */
    char description[128];
    /**
     * MiB of its adapter's memory that the system grants to the process now, which may change at any time; 0 where none says so.
     */
    uint32_t memory_budget_mib;
    /** MiB of it that the process uses, whoever in it does. */
    uint32_t memory_used_mib;
} cairn_device_info;

/**
 * Makes a device of the host's processor and loads ONNX Runtime. Works on every system.
 *
 * options: may be null for the defaults.
 *
 * Ownership: on success *device is the caller's, for cairn_device_destroy; on failure it is not written. What options point
 * to is read during the call only. ONNX Runtime can be started once: it stays loaded until the process ends, and so does this
 * library, which it calls.
 * Threads: any thread, at any time. Takes a fraction of a second the first time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_RUNTIME_MISSING when ONNX Runtime is
 * not there or has another version; CAIRN_ERROR_UNSUPPORTED when the process uses another file of it already;
 * CAIRN_ERROR_DEVICE when it does not start.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_device_create_cpu(const cairn_device_options *options, cairn_device **device);

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
 * Ownership: on success device is no handle any more; on failure it is as it was.
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
/** AMD's libraries for FSR, a row for each file that was found. */
#define CAIRN_REQUIREMENT_FSR_LIBRARIES 4
/** A provider of FSR frame generation for the first adapter. */
#define CAIRN_REQUIREMENT_FSR_PROVIDER 5
/** The system's build, for FSR. */
#define CAIRN_REQUIREMENT_FSR_SYSTEM 6
/** Direct3D 12's own library, for FSR: of the system, or of the Agility SDK that a program brings. */
#define CAIRN_REQUIREMENT_FSR_DIRECT3D 7
/** The shader model of the first adapter, for FSR. */
#define CAIRN_REQUIREMENT_FSR_SHADER_MODEL 8
/** The library's own shaders on the first adapter, for frames between anchors. */
#define CAIRN_REQUIREMENT_SHADERS 9
/** It is there. */
#define CAIRN_REQUIREMENT_MET 1
/** It is missing, and the device cannot be made. */
#define CAIRN_REQUIREMENT_NOT_MET 2
/** It depends on the world, or the system does not tell. */
#define CAIRN_REQUIREMENT_UNKNOWN 3
/** It is missing, and a device can be made without it; what is needed says for what. */
#define CAIRN_REQUIREMENT_OPTIONAL 4

/** Something that a device can be made of. */
typedef struct cairn_adapter {
    /** The stride of the array. */
    uint32_t struct_size;
    /** CAIRN_DEVICE_CPU or CAIRN_DEVICE_D3D12 */
    uint32_t kind;
    /** Its place among those of its kind. */
    uint32_t index;
    /** 0 */
    uint32_t reserved;
    /** The LUID of a Direct3D 12 adapter, low part first; else 0. */
    uint64_t luid;
    /** Bytes of its own memory; for the processor, of the system's. 0: unknown. */
    uint64_t memory;
    /** For people; UTF-8. */
    char name[128];
} cairn_adapter;

/** One thing that a device needs. */
typedef struct cairn_requirement {
    /** The stride of the array. */
    uint32_t struct_size;
    /** One of CAIRN_REQUIREMENT_PLATFORM and its like; a newer library may have more. */
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
 * Lists what devices can be made of: the processor always, and the Direct3D 12 adapters where this build can use them.
 *
 * adapters: an array of capacity elements, stride bytes apart, usually sizeof(cairn_adapter); null with capacity 0 to learn
 * the count.
 * count: gets how many there are in all, which may be more than capacity.
 *
 * Ownership: the array stays the caller's and is filled on success; on failure it is not written.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE for a stride that is no size of cairn_adapter.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_adapters(cairn_adapter *adapters, size_t stride, uint32_t capacity, uint32_t *count);

/**
 * Gives what a device of that kind needs and what was found, so that a player can be shown why a feature is unavailable.
 *
 * kind: CAIRN_DEVICE_CPU or CAIRN_DEVICE_D3D12.
 * options: what the device would be made with; may be null.
 * requirements: an array of capacity elements, stride bytes apart, usually sizeof(cairn_requirement); null with capacity 0 to
 * learn the count.
 * count: gets how many there are in all, which may be more than capacity.
 *
 * Ownership: the array stays the caller's and is filled on success; on failure it is not written.
 * Threads: any thread, at any time. Looks for ONNX Runtime where options say and loads it as cairn_device_create_cpu does; for
 * CAIRN_DEVICE_D3D12 also for AMD's libraries, which stay loaded: only files that AMD has signed.
 * Results: CAIRN_OK, also when something is missing; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_device_requirements(
    uint32_t kind, const cairn_device_options *options, cairn_requirement *requirements, size_t stride,
    uint32_t capacity, uint32_t *count);

/* ---- 6. Create: worlds ------------------------------------------------------------------------------------------- */

/** A stage of loading: files are read and checked; done and total count bytes. */
#define CAIRN_LOAD_READING 1
/** A stage of loading: ONNX Runtime prepares the graphs; done and total count graphs. */
#define CAIRN_LOAD_PREPARING 2

/**
 * A flag of cairn_world_options: where the global window is too wide for memory_limit, or for what an adapter has left, the widest one
 * that is not takes its place, and cairn_rollout_info says which; without it such a world is refused.
 */
#define CAIRN_WORLD_FIT_WINDOW 1

/** A loaded world. It may have any number of rollouts, which share its weights. */
typedef struct cairn_world cairn_world;

/** Progress of loading. */
typedef struct cairn_load_progress {
    /** sizeof(cairn_load_progress), as this library has it. */
    uint32_t struct_size;
    /** CAIRN_LOAD_READING, then CAIRN_LOAD_PREPARING */
    uint32_t stage;
    /** Units of the stage that are done. */
    uint64_t done;
    /** Units of the stage in total. */
    uint64_t total;
} cairn_load_progress;

/**
 * Gets the progress of a load, on the thread that called cairn_world_load, after every mebibyte and every graph, without any
 * lock held. progress is valid during the call only; user is what the options have. A result that is not 0 ends the load
 * with CAIRN_ERROR_CANCELLED before anything more is read or run. It may call Cairn, except to destroy the device, and must
 * not throw.
 */
typedef uint32_t (*cairn_load_callback)(const struct cairn_load_progress *progress, void *user);

/** Options of loading a world. */
typedef struct cairn_world_options {
    /** sizeof(cairn_world_options) */
    uint32_t struct_size;
    /** CAIRN_PRECISION_F32 or CAIRN_PRECISION_F16; 0 for the device's default. */
    uint32_t precision;
    /**
     * The bundle: a directory or an archive, UTF-8. Null for the world embedded in this library, where there is one.
     */
    const char *path;
    /**
     * How rollouts run, UTF-8: a preset ("coherence", "baseline-128", "baseline-112", "baseline-doubled", "decoded-60", "heavy",
     * "stock"), with changes after commas where needed: "stock,g64,native". Null for "stock" at the bundle's own window. Its
     * global window is the world's for good; the rest may differ from rollout to rollout.
     */
    const char *operating_point;
    /** Bytes that the world with one rollout may take; 0 for what the system has available. */
    uint64_t memory_limit;
    /** Gets the progress and can end the load; null for none. */
    cairn_load_callback progress;
    /** Handed to the callback. */
    void *user;
    /** CAIRN_WORLD_FIT_WINDOW */
    uint32_t flags;
    /** 0 */
    uint32_t reserved;
} cairn_world_options;

/** Properties of a world. */
typedef struct cairn_world_info {
    /** sizeof(cairn_world_info) */
    uint32_t struct_size;
    /** Precision of the graphs: CAIRN_PRECISION_F32 or CAIRN_PRECISION_F16 */
    uint32_t precision;
    /** Size of the pictures that anchors have, in square pixels. */
    uint32_t render_width;
    /** See render_width. */
    uint32_t render_height;
    /** Size of the pictures as the autoencoder decodes them, whose pixels may not be square. */
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
    /** Pictures that a latent decodes to. */
    uint32_t pictures_per_latent;
    /** Latents that a local layer remembers. */
    uint32_t local_window;
    /** g: latents that a global layer looks back over, as loaded. */
    uint32_t global_window;
    /** The largest g that the bundle allows. */
    uint32_t max_global_window;
    /** g is a multiple of this. */
    uint32_t global_dilation;
    /** Latents per second of world time that the model was made for. */
    uint32_t latents_per_second;
    /** Number of keys it knows: virtual-key codes from 0 to this minus 1. */
    uint32_t keys;
    /** The world's name, for people; UTF-8. */
    char name[128];
    /** The licence as an SPDX expression; the text is had from cairn_world_get_licence. */
    char licence[64];
    /** The bundle's identity: SHA-256 of its manifest, in hexadecimal. */
    char digest[72];
} cairn_world_info;

/** Bytes that a world and one rollout need. */
typedef struct cairn_world_memory {
    /** sizeof(cairn_world_memory) */
    uint32_t struct_size;
    /** 0 */
    uint32_t reserved;
    /** The bundle's files, while they are loaded. */
    uint64_t bundle;
    /** Weights as ONNX Runtime holds them. */
    uint64_t weights;
    /** Keys and values of one rollout's ring: what each further rollout takes, with the slabs. */
    uint64_t ring;
    /** Keys and values of the current latent. */
    uint64_t slabs;
    /** Intermediate values of a pass. */
    uint64_t intermediates;
    /** Intermediate values, pictures and memories of encoder and decoder. */
    uint64_t autoencoder;
    /** Overhead of ONNX Runtime's allocator. */
    uint64_t arena;
    /** The sum. */
    uint64_t total;
} cairn_world_memory;

/**
 * Loads a world: reads and checks the bundle, compares the memory it needs with what there is, and prepares its graphs.
 * Takes seconds to minutes with real weights, so call it off the render thread; the callback tells how far it is and can end
 * it.
 *
 * device: kept alive by the world.
 *
 * Ownership: on success *world is the caller's, for cairn_world_destroy; on failure it is not written and nothing is kept. What
 * options point to is read during the call only.
 * Threads: any thread, at any time, several loads beside each other too.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT, also for an operating point that the world does
 * not fit; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_IO; CAIRN_ERROR_INVALID_BUNDLE; CAIRN_ERROR_UNSUPPORTED for another version of
 * the format, a precision the bundle does not have, or no embedded world; CAIRN_ERROR_OUT_OF_MEMORY with figures;
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
 * Gives the memory need of a world with one rollout, as computed before loading.
 *
 * Ownership: memory stays the caller's and is filled on success; on failure it is not written.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_world_get_memory(const cairn_world *world, cairn_world_memory *memory);

/**
 * Copies the text of the world's licence; empty where the bundle has none.
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
 * Ownership: on success world is no handle any more; on failure it is as it was.
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
/** Four half floats to a pixel, red first, 0 to 1; for targets only. */
#define CAIRN_FORMAT_RGBA16F 2
/** Four bytes to a pixel: ten bits of red, the lowest, of green and of blue, two of alpha; for targets only. */
#define CAIRN_FORMAT_RGB10A2 3

/** A picture in the host's memory that the library reads, only during the call it is given to. */
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
 * Memory of the host that the library writes a picture into, only during the call it is given to. Bytes between rows are
 * left alone.
 */
typedef struct cairn_target {
    /** sizeof(cairn_target) */
    uint32_t struct_size;
    /** CAIRN_FORMAT_RGBA8, CAIRN_FORMAT_BGRA8, CAIRN_FORMAT_RGBA16F or CAIRN_FORMAT_RGB10A2 */
    uint32_t format;
    /** In pixels; must be the picture's. */
    uint32_t width;
    /** In pixels; must be the picture's. */
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
    /** Mouse motion in raw counts, summed over the step, right positive; -32768 to 32768. */
    float mouse_dx;
    /** The same, down positive. */
    float mouse_dy;
    /** The wheel, up positive; any finite number, of which the sign counts. */
    float scroll;
    /**
     * Keys and mouse buttons that are held at any moment of the step, by Windows virtual-key code: bit code % 64 of word
     * code / 64. W is 0x57: bit 23 of the second word.
     */
    uint64_t keys[4];
} cairn_controls;

/* ---- 8. Per frame: anchors --------------------------------------------------------------------------------------- */

/**
 * A flag of cairn_anchor_info: the anchor does not continue the previous one, so nothing may be generated between them. It is the first
 * of a rollout, after a reset or a restored state, or a picture that was appended.
 */
#define CAIRN_ANCHOR_CUT 1

/** An anchor: a copy that stays as it is, whatever becomes of its rollout. */
typedef struct cairn_anchor cairn_anchor;

/** Properties of an anchor. */
typedef struct cairn_anchor_info {
    /** sizeof(cairn_anchor_info) */
    uint32_t struct_size;
    /** CAIRN_ANCHOR_CUT, or 0 */
    uint32_t flags;
    /** Number of its latent in the rollout, from 0. It stands at latent / latents_per_second seconds of world time. */
    uint64_t latent;
    /** Latents per second of world time; 0 for a host's own picture. */
    uint32_t latents_per_second;
    /** Number of its pictures, in order of time; the last is the anchor itself. */
    uint32_t pictures;
    /** Size of its pictures, in square pixels. */
    uint32_t width;
    /** See width. */
    uint32_t height;
    /** Shape of its latent, [channels, height, width]; all 0 where it has none. */
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
 * number: counts up by one from anchor to anchor.
 * flags: CAIRN_ANCHOR_CUT where it does not continue the previous anchor, or 0.
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
 * Copies an anchor's latent: float32, [channels, height, width], the last index running fastest.
 *
 * count: numbers there is room for; must be channels * height * width.
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
 * Ownership: on success anchor is no handle any more; on failure it is as it was.
 * Threads: any thread; waits for calls in flight on the anchor.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_BUSY from within a callback of a call on it.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_anchor_destroy(cairn_anchor *anchor);

/* ---- 9. Per frame: rollouts -------------------------------------------------------------------------------------- */

/** The longest queue there may be. */
#define CAIRN_MAX_QUEUE 64
/** A flag of cairn_step_info: keys and values of the latent went into the ring. */
#define CAIRN_STEP_COMMITTED 1

/** One running instance of a world: its memory of the past, its clocks and its noise. */
typedef struct cairn_rollout cairn_rollout;

/** How a rollout runs. All zero: as its world, with seed 0. */
typedef struct cairn_rollout_options {
    /** sizeof(cairn_rollout_options) */
    uint32_t struct_size;
    /** Steps that may be waiting, running, or done with a result not yet fetched, 1 to CAIRN_MAX_QUEUE; 0 for 4. */
    uint32_t queue_capacity;
    /** Seed of all noise: the same seed, world, device and controls give the same pictures, bit for bit. */
    uint64_t seed;
    /** As in cairn_world_options, with the global window of the world; null for the world's. */
    const char *operating_point;
} cairn_rollout_options;

/** Properties and progress of a rollout. */
typedef struct cairn_rollout_info {
    /** sizeof(cairn_rollout_info) */
    uint32_t struct_size;
    /** Pictures that each anchor has. */
    uint32_t pictures_per_latent;
    /** Latents made so far. */
    uint64_t latents;
    /** Seed of its noise. */
    uint64_t seed;
    /** Latents per second of world time; each step's controls are summed over one latent. */
    uint32_t latents_per_second;
    /** Presentation rate of the operating point, in pictures per second. */
    uint32_t presented_rate;
    /** The operating point, in full; UTF-8. */
    char operating_point[192];
} cairn_rollout_info;

/** Report of one step. Times are nanoseconds of wall time. */
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
 * Starts a rollout, empty: the first thing to do is to append a seed picture.
 *
 * world: kept alive by the rollout. options: may be null for the defaults.
 *
 * Ownership: on success *rollout is the caller's, for cairn_rollout_destroy; on failure it is not written. What options point to
 * is read during the call only.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE;
 * CAIRN_ERROR_OUT_OF_MEMORY with figures; CAIRN_ERROR_DEVICE.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_rollout_create(
    const cairn_world *world, const cairn_rollout_options *options, cairn_rollout **rollout);

/**
 * Destroys the handle of a rollout; null is allowed. Queued steps are dropped, and the step in progress ends before its next pass.
 *
 * Ownership: on success rollout is no handle any more; on failure it is as it was. Anchors that were taken from it stay.
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
 * Appends a picture of any size: the seed, or later an edit of the scene. It becomes a latent of its own, with a pass that
 * puts it into the world's memory. On the calling thread.
 *
 * info: may be null.
 *
 * Ownership: the picture is copied; info stays the caller's and is filled on success; on failure it is not written and the
 * rollout is as it was.
 * Threads: one call at a time; a second one beside it, and one while steps are queued, gets CAIRN_ERROR_BUSY.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_BUSY;
 * CAIRN_ERROR_OUT_OF_MEMORY; CAIRN_ERROR_DEVICE; CAIRN_ERROR_CANCELLED; CAIRN_ERROR_UNSUPPORTED when a clock has run out.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_rollout_append(
    cairn_rollout *rollout, const cairn_picture *picture, cairn_step_info *info);

/**
 * Appends pictures of any sizes that follow each other as one latent, as cairn_rollout_append does one, which is a still: a scene that moves
 * goes on moving. On the calling thread.
 *
 * pictures: an array, the oldest first, with the same struct_size in each. count: 4, the pictures of a latent; or 1, for a still.
 * info: may be null.
 *
 * Ownership: the pictures are copied; info stays the caller's and is filled on success; on failure it is not written and the
 * rollout is as it was.
 * Threads: one call at a time; a second one beside it, and one while steps are queued, gets CAIRN_ERROR_BUSY.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_BUSY;
 * CAIRN_ERROR_OUT_OF_MEMORY; CAIRN_ERROR_DEVICE; CAIRN_ERROR_CANCELLED; CAIRN_ERROR_UNSUPPORTED when a clock has run out.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_rollout_append_pictures(
    cairn_rollout *rollout, const cairn_picture *pictures, uint32_t count, cairn_step_info *info);

/**
 * Sets whether the encoder keeps its state from one appended picture to the next, as in the released engine, or starts anew with each (the
 * default). The stream starts with this call, and again with cairn_rollout_reset. It is part of a saved state, which can be restored only
 * into a rollout with the same setting.
 *
 * keep: 1 to keep the stream, 0 to start anew.
 *
 * Ownership: nothing is handed over, on success or on failure.
 * Threads: one call at a time; a second one beside it, and one while steps are queued, gets CAIRN_ERROR_BUSY.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_BUSY; CAIRN_ERROR_UNSUPPORTED where the
 * bundle's encoder is not handed its memories; CAIRN_ERROR_DEVICE.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_rollout_keep_encoder_stream(cairn_rollout *rollout, uint32_t keep);

/**
 * Makes the next latent with these controls, which stand for 1 / latents_per_second seconds of world time. On the calling
 * thread.
 *
 * info: may be null.
 *
 * Ownership: controls are read during the call; info stays the caller's and is filled on success; on failure it is not
 * written and the rollout is as it was.
 * Threads: one call at a time; a second one beside it, and one while steps are queued, gets CAIRN_ERROR_BUSY.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_BUSY;
 * CAIRN_ERROR_OUT_OF_MEMORY; CAIRN_ERROR_DEVICE; CAIRN_ERROR_CANCELLED; CAIRN_ERROR_UNSUPPORTED for a key that the world does
 * not know, and when a clock has run out.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_rollout_step(
    cairn_rollout *rollout, const cairn_controls *controls, cairn_step_info *info);

/**
 * Resets to the start with the same seed: no latents, empty memory.
 *
 * Ownership: nothing is handed over, on success or on failure.
 * Threads: one call at a time; a second one beside it, and one while steps are queued, gets CAIRN_ERROR_BUSY.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_BUSY; CAIRN_ERROR_DEVICE.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_rollout_reset(cairn_rollout *rollout);

/**
 * Frees the device memory of a rollout that makes no latents for a while: waits for its work, then evicts its rings, latents and pictures
 * with their contents. The next call that needs them makes them resident again; the device's queue waits for that, and no thread does where
 * Windows has ID3D12Device3. If there is not enough memory, that call answers CAIRN_ERROR_OUT_OF_MEMORY with nothing changed, and may be
 * repeated. The world's weights are evicted once all of its rollouts rest; anchors are not. On a CPU device nothing happens.
 * cairn_rollout_pause also rests a rollout with a queue.
 *
 * Ownership: nothing is handed over, on success or on failure.
 * Threads: one call at a time; a second one beside it, and one while steps are queued, gets CAIRN_ERROR_BUSY.
 * Results: CAIRN_OK, also where it rests already; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_BUSY; CAIRN_ERROR_DEVICE;
 * CAIRN_ERROR_DEVICE_REMOVED.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_rollout_rest(cairn_rollout *rollout);

/**
 * Limits the wall time per latent, decoding included. Latents use the first of the schedules until that takes too long, then one with
 * fewer passes, and again one with more when there is time. The choice depends on the times of previous latents, so the same controls may
 * give other pictures the next time. Changes are logged; cairn_step_info has the number of passes of a latent, and
 * cairn_rollout_info the schedule of the next one. A restored state ends it.
 *
 * latent_ns: nanoseconds for a latent.
 * schedules: one to eight as in operating points, a space between them, each with fewer passes than the one before:
 * "stock explicit:1:0.5:0 explicit:1:0"; none, "", for no budget any more, which leaves the schedule as it is.
 *
 * Ownership: nothing is handed over, on success or on failure.
 * Threads: one call at a time; a second one beside it, and one while steps are queued, gets CAIRN_ERROR_BUSY.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_BUSY.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_rollout_set_budget(cairn_rollout *rollout, uint64_t latent_ns, const char *schedules);

/**
 * Takes a copy of the last anchor: its pictures and its latent.
 *
 * Ownership: on success *anchor is the caller's, for cairn_anchor_destroy; on failure it is not written.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT, also before the first latent; CAIRN_ERROR_BUSY
 * while a step is running; CAIRN_ERROR_OUT_OF_MEMORY; CAIRN_ERROR_DEVICE.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_rollout_get_anchor(const cairn_rollout *rollout, cairn_anchor **anchor);

/* ---- 10. Per frame: the queue of a rollout ----------------------------------------------------------------------- */

/** A timeout that never comes. */
#define CAIRN_FOREVER UINT64_MAX

/**
 * Queues a step for the rollout's own thread, which runs steps in the order they were queued. A step that fails cancels those queued
 * behind it and leaves the rollout as before it.
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
 * Queues the append of a picture, as cairn_rollout_append does it.
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
 * Queues the append of pictures, as cairn_rollout_append_pictures does it.
 *
 * pictures, count: as there. ticket: gets the number that identifies the result.
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
 * Asks for the result of a queued step, without waiting. Every ticket has one result, which is given once and makes room in
 * the queue; a failed step's message becomes the last error of the thread that asks.
 *
 * info, anchor: get the step's report and its anchor; each may be null, and an anchor that is not fetched is lost.
 *
 * Ownership: on success *anchor is the caller's, for cairn_anchor_destroy, and info is filled; on failure neither is written.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_NOT_READY while it waits or runs; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT, also for a
 * ticket that was given its result; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_CANCELLED; and what cairn_rollout_step and
 * cairn_rollout_append answer.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_rollout_poll(
    const cairn_rollout *rollout, uint64_t ticket, cairn_step_info *info, cairn_anchor **anchor);

/**
 * As cairn_rollout_poll, and waits for the step to end.
 *
 * timeout_ns: how long at most; CAIRN_FOREVER for as long as it takes. A paused queue ends nothing.
 *
 * Ownership: on success *anchor is the caller's, for cairn_anchor_destroy, and info is filled; on failure neither is written.
 * Threads: any thread, at any time. Destroying the rollout ends the wait with CAIRN_ERROR_CANCELLED.
 * Results: CAIRN_OK; CAIRN_NOT_READY when the time is over; CAIRN_ERROR_BUSY from within a callback of a call or a step of the rollout,
 * which would wait for itself; and all others of cairn_rollout_poll.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_rollout_wait(
    const cairn_rollout *rollout, uint64_t ticket, uint64_t timeout_ns, cairn_step_info *info, cairn_anchor **anchor);

/**
 * Ends everything that is going on in a rollout: queued steps are not made, and a step in progress, queued or on another
 * thread, ends before its next pass. Each answers CAIRN_ERROR_CANCELLED, and the rollout is as before it. What is submitted
 * later is not concerned. Does not wait.
 *
 * Ownership: nothing is handed over, on success or on failure.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_rollout_cancel(const cairn_rollout *rollout);

/**
 * Pauses the queue: the step in progress completes, and no other begins. Steps may still be queued. A rollout whose queue was used is then
 * rested, as by cairn_rollout_rest, until its memory is needed; it is in use while that is done, as while a step is running.
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
 * Results: CAIRN_OK; CAIRN_NOT_READY when no step is queued that was not let go already; CAIRN_ERROR_INVALID_HANDLE;
 * CAIRN_ERROR_INVALID_ARGUMENT when the queue is not paused.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_rollout_single_step(const cairn_rollout *rollout);

/* ---- 11. Per frame: the state of a rollout ----------------------------------------------------------------------- */

/**
 * Copies the whole state of a rollout: its memory, clocks, seed, operating point and last pictures. A rollout that takes it up
 * goes on bit for bit, in this process or another, on the same kind of device.
 *
 * bytes: capacity bytes, or null with capacity 0 to learn the size.
 * size: gets the size of the state; it stays the same as long as the rollout is not restored.
 *
 * Ownership: the state is copied; on failure nothing is written.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT, also when the capacity is too small;
 * CAIRN_ERROR_BUSY while a step is running; CAIRN_ERROR_OUT_OF_MEMORY; CAIRN_ERROR_DEVICE.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_rollout_save(const cairn_rollout *rollout, void *bytes, size_t capacity, size_t *size);

/**
 * Writes the whole state of a rollout into a file, whole or not at all: it is written beside it and then takes its name.
 *
 * path: UTF-8; a file that is there is replaced.
 *
 * Ownership: path is read during the call; on success the file is the caller's, on failure what was there is as it was.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_BUSY while a step is running;
 * CAIRN_ERROR_IO; CAIRN_ERROR_OUT_OF_MEMORY; CAIRN_ERROR_DEVICE.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_rollout_save_file(const cairn_rollout *rollout, const char *path);

/**
 * Takes up a state that was saved of a rollout of the same bundle, precision and global window. Seed and operating point become
 * the state's.
 *
 * Ownership: bytes are read during the call; on failure the rollout is as it was, on success as the saved one.
 * Threads: one call at a time; a second one beside it, and one while steps are queued, gets CAIRN_ERROR_BUSY.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_BUSY; CAIRN_ERROR_INVALID_STATE;
 * CAIRN_ERROR_UNSUPPORTED for a state of another version; CAIRN_ERROR_DEVICE.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_rollout_restore(cairn_rollout *rollout, const void *bytes, size_t size);

/**
 * Takes up a state from a file; as cairn_rollout_restore.
 *
 * path: UTF-8.
 *
 * Ownership: path is read during the call; on failure the rollout is as it was, on success as the saved one.
 * Threads: one call at a time; a second one beside it, and one while steps are queued, gets CAIRN_ERROR_BUSY.
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
 * Motion and depth of a pair of anchors, both of the anchors' size. It does not change.
 *
 * Motion is in pixels, a half float each for x and y, stored where the current anchor's pixels are and pointing from the
 * current anchor to the previous one, y down. Depth is device depth of the current anchor, 0 near and 1 far.
 */
typedef struct cairn_guidance cairn_guidance;

/** Motion and depth from the host, in its memory. */
typedef struct cairn_guidance_data {
    /** sizeof(cairn_guidance_data) */
    uint32_t struct_size;
    /** CAIRN_DEPTH_INVERTED, or CAIRN_DEPTH_LINEAR, or 0 for device depth with 0 near */
    uint32_t flags;
    /** Size in pixels, 1 to 16384; must be the anchors'. */
    uint32_t width;
    /** See width. */
    uint32_t height;
    /**
     * Half floats x, y for each pixel, row by row without padding, as cairn_guidance has them. Non-finite values count as 0.
     */
    const uint16_t *motion;
    /** Number of half floats: width * height * 2. */
    uint64_t motion_count;
    /** One value for each pixel, row by row without padding; null where there is no depth. */
    const float *depth;
    /** Number of values: width * height, or 0. */
    uint64_t depth_count;
    /** Distance of the near plane, above 0; 0 in all three for 0.1, 100 and 60 degrees. */
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
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT, also for anchors of different sizes and for
 * latents that are not there; CAIRN_ERROR_OUT_OF_MEMORY.
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
 * count: half floats there is room for; must be width * height * 2.
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
 * count: numbers there is room for; must be width * height.
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
 * Ownership: on success guidance is no handle any more; on failure it is as it was.
 * Threads: any thread; waits for calls in flight on the guidance.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_BUSY from within a callback of a call on it.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_guidance_destroy(cairn_guidance *guidance);

/* ---- 13. Per frame: presenters ----------------------------------------------------------------------------------- */

/** The generator is used where it can be. */
#define CAIRN_PREFER_AUTO 0
/** The generator is used, or the presenter is not made. */
#define CAIRN_PREFER_REQUIRE 1
/** The generator is not used. */
#define CAIRN_PREFER_NEVER 2
/** A flag of cairn_presenter_options: where an anchor is late the last one is held; its motion is not extrapolated. */
#define CAIRN_PRESENTER_HOLD_LATE 1

/**
 * A flag of cairn_presenter_options: after a late anchor frames are shown sooner, by a quarter of a frame for each anchor,
 * until anchors are due delay_ns after they come again. For hosts that make anchors at a steady pace, and not as fast as
 * they can.
 */
#define CAIRN_PRESENTER_CATCH_UP 2

/**
 * A flag of cairn_presenter_options: frames are generated also where the anchor brings as many decoded pictures as there
 * are frames to an anchor.
 */
#define CAIRN_PRESENTER_NO_DECODED 4

/**
 * A flag of cairn_presenter_options: frames of another aspect ratio than the anchors' keep the anchors' ratio, centred, with black bars.
 * Without it they are stretched.
 */
#define CAIRN_PRESENTER_LETTERBOX 8
/** Display-referred sRGB, as pictures are. */
#define CAIRN_COLOUR_SRGB 0
/** Linear, sRGB primaries, 1 is white; for CAIRN_FORMAT_RGBA16F, and textures of R11G11B10_FLOAT, only. */
#define CAIRN_COLOUR_LINEAR 1
/** scRGB: linear, sRGB primaries, 1 is 80 nits; for CAIRN_FORMAT_RGBA16F only. */
#define CAIRN_COLOUR_SCRGB 2
/** HDR10: PQ transfer function, BT.2020 primaries; for CAIRN_FORMAT_RGB10A2 only. */
#define CAIRN_COLOUR_HDR10 3
/** A frame is an anchor. */
#define CAIRN_FRAME_ANCHOR 1
/** A frame is a decoded picture that came with the later anchor. */
#define CAIRN_FRAME_DECODED 2
/** A frame is interpolated between two anchors. */
#define CAIRN_FRAME_GENERATED 3
/** A frame is extrapolated beyond the last anchor, because the next one is late. */
#define CAIRN_FRAME_EXTRAPOLATED 4
/** A frame is a held picture, because nothing can be generated: between two anchors the nearer, else the last. */
#define CAIRN_FRAME_HELD 5
/** A flag of cairn_frame: it was not generated because of a cut. */
#define CAIRN_FRAME_CUT 1
/** A flag of cairn_frame: it is identical to the one drawn before. */
#define CAIRN_FRAME_REPEATED 2
/** A flag of cairn_frame: an anchor is shown in its place, as cairn_presenter_prepare_d3d12 was not called for it. */
#define CAIRN_FRAME_UNPREPARED 4

/**
 * Shows a stream of anchors at a steady rate: it is given anchors as they come, knows which frame is due when, generates it
 * and writes it into the host's memory. It reads no clock: every time is the host's, in nanoseconds from wherever it likes.
 *
 * Anchor i is due at origin + i * interval, where origin is when the first came, plus the delay. Between two anchors that
 * are there, frames are generated; while the next one is late the motion of the last goes on for at most an interval, and
 * then the picture stands. An anchor that comes after it was due is due when it comes, and those after it are later by as
 * much: a world that is too slow is shown slowly, and whole.
 */
typedef struct cairn_presenter cairn_presenter;

/** How anchors are shown. All zero: two frames to an anchor, one interval after they come. */
typedef struct cairn_presenter_options {
    /** sizeof(cairn_presenter_options) */
    uint32_t struct_size;
    /** Frames to an anchor: 1, 2, 3, 4 or 6; 0 for 2. */
    uint32_t multiplier;
    /** Size of the frames in pixels, 1 to 16384 each way; 0 both ways for the anchors'. */
    uint32_t width;
    /** See width. */
    uint32_t height;
    /**
     * Nanoseconds from one anchor to the next, at most 60 seconds; 0 for what the first anchor's latents_per_second says.
     */
    uint64_t interval_ns;
    /**
     * Nanoseconds from an anchor's arrival until it is due, at most 60 seconds; 0 for an interval. Frames between two anchors need the
     * later one, so a delay below (multiplier - 1) / multiplier of an interval makes frames late.
     */
    uint64_t delay_ns;
    /** CAIRN_PRESENTER_HOLD_LATE, CAIRN_PRESENTER_CATCH_UP, CAIRN_PRESENTER_NO_DECODED, CAIRN_PRESENTER_LETTERBOX */
    uint32_t flags;
    /** Anchors that may wait for their time, 1 to CAIRN_MAX_QUEUE; 0 for 4. */
    uint32_t capacity;
    /** Where motion comes from when an anchor comes without guidance: CAIRN_MOTION_AUTO and so on. */
    uint32_t motion;
    /** CAIRN_COLOUR_SRGB to CAIRN_COLOUR_HDR10 */
    uint32_t colour_space;
    /**
     * AMD FidelityFX frame generation, for frames half way between two anchors that are recorded for Direct3D 12:
     * CAIRN_PREFER_AUTO and so on. Needs the library's own shaders, which make all others.
     */
    uint32_t fsr;
    /** The library's own shaders, for Direct3D 12. */
    uint32_t shader;
    /** The library's own generator on the processor. */
    uint32_t cpu;
    /** 0 */
    uint32_t reserved;
    /**
     * Brightness of the pictures' white in CAIRN_COLOUR_SCRGB and CAIRN_COLOUR_HDR10, 1 to 10000 nits; 0 for 203. 0 for the others.
     */
    uint32_t white_nits;
    /** 0 */
    uint32_t reserved_too;
    /**
     * AMD FidelityFX upscaling, for frames for Direct3D 12 that are larger than anchors: CAIRN_PREFER_AUTO and so on. It makes anchors
     * larger before frames are generated between them. Without it each frame is resized in space. Needs the library's own shaders.
     */
    uint32_t upscaler;
    /** 0 */
    uint32_t reserved_also;
} cairn_presenter_options;

/** A frame of a presenter. */
typedef struct cairn_frame {
    /** sizeof(cairn_frame) */
    uint32_t struct_size;
    /** CAIRN_FRAME_ANCHOR to CAIRN_FRAME_HELD */
    uint32_t source;
    /**
     * Position in the stream: anchor i, counted from 0 in order of arrival, is at i * multiplier. It may step back when a late anchor
     * arrives.
     */
    uint64_t position;
    /** When it is due. For the first anchor this may be yet to come: it is shown from its arrival on. */
    uint64_t since_ns;
    /** When the next one is due, if no anchor is late. */
    uint64_t until_ns;
    /** Number of the anchor that it shows or starts from. */
    uint64_t previous;
    /** Number of the anchor that it leads to; the same as from where there is none. */
    uint64_t current;
    /** Intervals from the previous anchor, 0 to 1. */
    float t;
    /** CAIRN_FRAME_CUT, CAIRN_FRAME_REPEATED, CAIRN_FRAME_UNPREPARED */
    uint32_t flags;
} cairn_frame;

/**
 * Makes a presenter.
 *
 * options: may be null for the defaults.
 *
 * Ownership: on success *presenter is the caller's, for cairn_presenter_destroy; on failure it is not written.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_UNSUPPORTED for a required generator
 * that is not there; CAIRN_ERROR_OUT_OF_MEMORY.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_presenter_create(const cairn_presenter_options *options, cairn_presenter **presenter);

/**
 * Gives a presenter the next anchor. What comes without a number one above the last, or with CAIRN_ANCHOR_CUT, is a cut:
 * nothing is generated between it and the one before. An anchor that a Direct3D 12 device still works on has come once its fence
 * says so, which is looked at whenever a frame is asked for and no queue waits for; until then it is late.
 *
 * guidance: of the anchor before and this one; null to have the presenter find it.
 * now_ns: when it came, on the host's clock.
 *
 * Ownership: anchor and guidance stay the caller's; on success the presenter keeps what it needs of them, on failure nothing.
 * Threads: any thread, at any time, also while a frame is drawn. A time before one that was heard of counts as that one.
 * Results: CAIRN_OK; CAIRN_QUEUE_FULL; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT for another size than the first
 * anchor's, and for a first one without a rate where the options have no interval.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_presenter_push(
    const cairn_presenter *presenter, const cairn_anchor *anchor, const cairn_guidance *guidance, uint64_t now_ns);

/**
 * Says which frame is due. Takes less than a microsecond.
 *
 * now_ns: when it will be shown, on the host's clock.
 *
 * Ownership: frame stays the caller's and is filled on success; on failure, and when there is none, it is not written.
 * Threads: any thread, at any time, also while a frame is drawn.
 * Results: CAIRN_OK; CAIRN_NOT_READY before the first anchor came; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT;
 * CAIRN_ERROR_STRUCT_SIZE.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_presenter_query(const cairn_presenter *presenter, uint64_t now_ns, cairn_frame *frame);

/**
 * Makes the frame that is due and writes it. One that is due already when it is drawn again is not made again. A generator
 * may find a cut that cairn_presenter_query could not know of; frame says what was drawn.
 *
 * now_ns: when it will be shown, on the host's clock.
 * target: of the frames' size.
 * frame: may be null.
 *
 * Ownership: the pixels are copied and frame is filled, on success; on failure, and when there is none, neither is written.
 * Threads: one call at a time; a second one beside it gets CAIRN_ERROR_BUSY.
 * Results: CAIRN_OK; CAIRN_NOT_READY before the first anchor came; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT, also
 * when CAIRN_MOTION_PAPER or CAIRN_MOTION_LATENTS meets an anchor without a latent; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_BUSY;
 * CAIRN_ERROR_OUT_OF_MEMORY.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_presenter_draw(
    cairn_presenter *presenter, uint64_t now_ns, const cairn_target *target, cairn_frame *frame);

/**
 * Changes the size of the frames, as a window's changes. The stream goes on, and what is drawn next has the new size.
 *
 * width, height: as in cairn_presenter_options; 0 both ways for the anchors'.
 *
 * Ownership: nothing is handed over, on success or on failure.
 * Threads: any thread, at any time, also while a frame is drawn.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_presenter_resize(const cairn_presenter *presenter, uint32_t width, uint32_t height);

/**
 * Sets the static overlay, like a HUD, that covers the anchors from the next frame on and does not move with them. Without a mask it is
 * detected from colours that do not change. All generators use it. cairn_presenter_reset removes it.
 *
 * mask: a byte to a pixel of an anchor, row by row from the top left, 0 where nothing lies over it; null, with 0 for all the rest, for
 * nothing known.
 * size: bytes of mask: width * height.
 * width, height: the anchors' size.
 *
 * Ownership: the mask is copied, on success; on failure nothing is.
 * Threads: any thread, at any time, also while a frame is drawn.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT, also for another size than that of the anchors that
 * have come; CAIRN_ERROR_OUT_OF_MEMORY.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_presenter_set_overlay(
    const cairn_presenter *presenter, const uint8_t *mask, size_t size, uint32_t width, uint32_t height);

/**
 * Limits the device time of frames for Direct3D 12. If it is too short for all frames, only every second, third or sixth frame of an
 * interval is generated, depending on the multiplier, and the others repeat the previous one; more are generated when there is time again.
 * The choice depends on the device times of completed frames. Changes are logged, and the statistics have them.
 *
 * frame_ns: nanoseconds of device time per frame shown, averaged over an interval, including work done once per anchor; 0 for no
 * budget.
 *
 * Ownership: nothing is handed over, on success or on failure.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_presenter_set_budget(const cairn_presenter *presenter, uint64_t frame_ns);

/**
 * Forgets all anchors and when they came: the next one is a first again, of any size.
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
 * Ownership: on success presenter is no handle any more; on failure it is as it was.
 * Threads: any thread; waits for calls in flight on the presenter.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_BUSY from within a callback of a call on it.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_presenter_destroy(cairn_presenter *presenter);

/* ---- 14. Per frame: budgets -------------------------------------------------------------------------------------- */

/** The most worlds of a budget. */
#define CAIRN_MAX_BUDGET_WORLDS 8

/** Budget of a rollout and its frames: time, memory or both. */
typedef struct cairn_budget {
    /** sizeof(cairn_budget) */
    uint32_t struct_size;
    /**
     * Frames that are shown for each anchor, at most 64, the presenter's own where there is one; 0 for that, and for 1 without.
     */
    uint32_t multiplier;
    /**
     * Nanoseconds of the device's time for each frame that is shown, the passes of anchors and all; 0 for as long as it takes.
     */
    uint64_t frame_ns;
    /**
     * MiB that the world in use and its rollout may need, as cairn_world_get_memory says; 0 for as many as there are.
     */
    uint64_t memory_mib;
    /**
     * Schedules as in operating points, a space between them, each with fewer passes than the one before, at most 8: "stock
     * explicit:1:0.5:0"; null for the rollout's own alone.
     */
    const char *schedules;
    /**
     * Further worlds of the same bundle that the rollout may go on in, loaded with other global windows; may be null: the window then stays,
     * as no world is loaded for it.
     */
    const cairn_world *const *worlds;
    /** How many, at most CAIRN_MAX_BUDGET_WORLDS. */
    uint32_t world_count;
    /** 0 */
    uint32_t reserved;
    /** The presenter whose frames are held to it too; may be null. */
    const cairn_presenter *presenter;
} cairn_budget;

/**
 * Holds a rollout, and the frames of a presenter, to a budget. From measured times, by the device's own clock where it has one, else by wall
 * time, it chooses the number of passes per latent, the global window and the number of frames generated between anchors. Passes are reduced
 * first, then frames, the window last; each is raised again when there is time. The window is also narrowed when the device's memory runs
 * short. The same controls may then give other pictures the next time. A change of window happens before a step, goes through the host's
 * memory and takes a while. No world is loaded for it, as that takes seconds to minutes and the weights' memory once more: load worlds for the
 * windows you allow beforehand, on a thread of your own. Changes are logged, and cairn_rollout_statistics has them.
 *
 * It takes the place of cairn_rollout_set_budget, which ends it, as a restored state does and the rollout's end, and of
 * cairn_presenter_set_budget, which takes the presenter out of it.
 *
 * budget: null ends it, and leaves things as they are.
 *
 * Ownership: the budget is read during the call; on success its worlds are kept alive until it ends, its presenter is not; on failure
 * nothing has changed.
 * Threads: one call at a time; a second one beside it, and one while steps are queued, gets CAIRN_ERROR_BUSY.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_BUSY;
 * CAIRN_ERROR_OUT_OF_MEMORY, with figures and the window to go below, where even the narrowest of the worlds needs too much.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_rollout_govern(cairn_rollout *rollout, const cairn_budget *budget);

/* ---- 15. Per frame: input written down, and played again --------------------------------------------------------- */

/** What a player does, by world time, in the format of docs/control-script.md. It does not change. */
typedef struct cairn_script cairn_script;

/**
 * Reads a control script.
 *
 * text: length bytes of UTF-8, without a NUL.
 *
 * Ownership: on success *script is the caller's, for cairn_script_destroy; on failure it is not written. The text is read during
 * the call.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_ARGUMENT, with line and column of what is wrong; CAIRN_ERROR_UNSUPPORTED for a newer
 * version of the format.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_script_create(const char *text, size_t length, cairn_script **script);

/**
 * Gives the controls of a latent step: what the script does from (latent - 1) / latents_per_second seconds on until latent /
 * latents_per_second. The steps of a rollout lose nothing and count nothing twice, and after the script's end nothing moves.
 *
 * latent: the number that the step will have, from 1; 0 is the seed's, which has no controls.
 * latents_per_second: of the rollout, 1 to 240.
 *
 * Ownership: controls stay the caller's and are filled on success, for the step as they are; on failure they are not written.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT, also when the mouse moves farther in the step than
 * controls can say; CAIRN_ERROR_STRUCT_SIZE.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_script_get_controls(
    const cairn_script *script, uint64_t latent, uint32_t latents_per_second, cairn_controls *controls);

/**
 * Says how long a script lasts: to its end where it has one, else until the last thing happens.
 *
 * microseconds: gets the world time.
 *
 * Ownership: *microseconds is written on success; on failure it is not.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_script_get_duration(const cairn_script *script, uint64_t *microseconds);

/**
 * Copies a script as text, in the canonical form of the format, to be written to a file.
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
 * Ownership: on success script is no handle any more; on failure it is as it was.
 * Threads: any thread; waits for calls in flight on the script.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_BUSY from within a callback of a call on it.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_script_destroy(cairn_script *script);

/**
 * Collects what a player does and makes a script of it: event by event as it happens, or the controls of whole latent steps.
 */
typedef struct cairn_recorder cairn_recorder;

/**
 * Makes an empty recording.
 *
 * Ownership: on success *recorder is the caller's, for cairn_recorder_destroy; on failure it is not written.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_OUT_OF_MEMORY.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_recorder_create(cairn_recorder **recorder);

/**
 * A key or mouse button went down or up. Repeats of what is known are ignored, as keyboards repeat.
 *
 * microseconds: world time; events come in order.
 * key: a Windows virtual-key code, 0 to 255.
 * down: 1 or 0.
 *
 * Ownership: nothing is handed over, on success or on failure.
 * Threads: one call at a time; a second one beside it gets CAIRN_ERROR_BUSY.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT, also when the recording is full;
 * CAIRN_ERROR_BUSY.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_recorder_key(cairn_recorder *recorder, uint64_t microseconds, uint32_t key, uint32_t down);

/**
 * The mouse moved by dx (right positive) and dy (down positive) counts.
 *
 * microseconds: world time; events come in order.
 *
 * Ownership: nothing is handed over, on success or on failure.
 * Threads: one call at a time; a second one beside it gets CAIRN_ERROR_BUSY.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT for what is not finite, and when the recording is
 * full; CAIRN_ERROR_BUSY.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_recorder_mouse(cairn_recorder *recorder, uint64_t microseconds, float dx, float dy);

/**
 * The wheel turned by this many notches, up positive.
 *
 * microseconds: world time; events come in order.
 *
 * Ownership: nothing is handed over, on success or on failure.
 * Threads: one call at a time; a second one beside it gets CAIRN_ERROR_BUSY.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT when the recording is full; CAIRN_ERROR_BUSY.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_recorder_scroll(cairn_recorder *recorder, uint64_t microseconds, int32_t notches);

/**
 * A latent step got these controls. When every step is recorded, in order and without a gap, cairn_script_get_controls gives
 * them back bit for bit.
 *
 * latent: the number that the step has, from 1.
 * latents_per_second: of the rollout, 1 to 240.
 *
 * Ownership: controls are read during the call; nothing is handed over, on success or on failure.
 * Threads: one call at a time; a second one beside it gets CAIRN_ERROR_BUSY.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT, also when the recording is full;
 * CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_BUSY.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_recorder_step(
    cairn_recorder *recorder, uint64_t latent, uint32_t latents_per_second, const cairn_controls *controls);

/**
 * Makes a script of what was recorded, which ends at microseconds of world time; keys that are still held are released there.
 * The recording goes on.
 *
 * Ownership: on success *script is the caller's, for cairn_script_destroy; on failure it is not written.
 * Threads: one call at a time; a second one beside it gets CAIRN_ERROR_BUSY.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT, also when something happened after that time;
 * CAIRN_ERROR_BUSY; CAIRN_ERROR_OUT_OF_MEMORY.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_recorder_make_script(
    cairn_recorder *recorder, uint64_t microseconds, cairn_script **script);

/**
 * Destroys the handle of a recorder; null is allowed. Scripts that were made of it stay.
 *
 * Ownership: on success recorder is no handle any more; on failure it is as it was.
 * Threads: any thread; waits for calls in flight on the recorder.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_BUSY from within a callback of a call on it.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_recorder_destroy(cairn_recorder *recorder);

/* ---- 16. Queries: statistics ------------------------------------------------------------------------------------- */

/** Statistics of a rollout since it was made, as of the end of its last step. Times are nanoseconds of wall time. */
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
    /** Encodings of pictures into latents. */
    uint64_t encode_ns;
    /** Denoise passes. */
    uint64_t denoise_ns;
    /** Cache passes. */
    uint64_t cache_ns;
    /** Checking results and copying them into the ring. */
    uint64_t commit_ns;
    /** Decoding latents. */
    uint64_t decode_ns;
    /** Reading pictures back and resizing them. */
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
     * Passes of the transformer whose time on a Direct3D 12 device is known by its own clock; 0 on other devices, as all fields below. Other
     * work of the queue meanwhile counts in their times.
     */
    uint64_t device_passes;
    /** Total nanoseconds of them on the device. */
    uint64_t device_passes_ns;
    /** Nanoseconds of the longest. */
    uint64_t device_pass_longest_ns;
    /** Passes of the decoder whose time on the device is known. */
    uint64_t device_decodes;
    /** Total nanoseconds of them on the device. */
    uint64_t device_decodes_ns;
    /** Nanoseconds of the longest. */
    uint64_t device_decode_longest_ns;
    /** Copies into the ring whose time on the device is known. */
    uint64_t device_commits;
    /** Total nanoseconds of them on the device. */
    uint64_t device_commits_ns;
    /** Nanoseconds of wall time inside ONNX Runtime, which records the device's command lists and submits them. */
    uint64_t runtime_ns;
    /** Nanoseconds of wall time spent waiting for the device. */
    uint64_t waited_ns;
    /** Number of waits because of cairn_d3d12_options.longest_submission_us. */
    uint64_t yields;
    /** Passes with buffers of their own that run from captured commands: see cairn_d3d12_options.captured_passes. */
    uint32_t captured_passes;
    /** Passes that do not, or whose captured results have not yet been shown to be bit-identical. */
    uint32_t other_passes;
    /**
     * Nanoseconds per frame shown, as last measured by cairn_rollout_govern; the fields below belong to it, or to the last one that ended.
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
    /** Denoise passes of the latents from now on; 0 where there never was a budget, as the next two fields. */
    uint32_t governed_passes;
    /** The global window from now on. */
    uint32_t governed_window;
    /** Frames generated per anchor. */
    uint32_t governed_made;
    /** 0 */
    uint32_t reserved;
} cairn_rollout_statistics;

/** Statistics of a presenter since it was made. */
typedef struct cairn_presenter_statistics {
    /** sizeof(cairn_presenter_statistics) */
    uint32_t struct_size;
    /** 0 */
    uint32_t reserved;
    /** Anchors that arrived. */
    uint64_t anchors;
    /** Anchors that arrived after they were due. */
    uint64_t late_anchors;
    /** Nanoseconds that the stream stood still for late anchors. */
    uint64_t slipped_ns;
    /** Frames drawn that were anchors. Drawing the same frame again counts again, here and below. */
    uint64_t shown_anchors;
    /** Frames drawn that were decoded pictures of an anchor. */
    uint64_t shown_decoded;
    /** Frames drawn that were interpolated between anchors. */
    uint64_t shown_generated;
    /** Frames drawn that were extrapolated beyond the last anchor. */
    uint64_t shown_extrapolated;
    /** Frames drawn that held a picture because nothing could be generated. */
    uint64_t shown_held;
    /** Frames drawn, of any kind, that repeated the previous one. */
    uint64_t repeated;
    /** Frames drawn that were not generated because of a cut. */
    uint64_t cuts;
    /** Nanoseconds spent finding motion and depth. */
    uint64_t guidance_ns;
    /** Nanoseconds spent generating. */
    uint64_t generate_ns;
    /** Nanoseconds spent resizing. */
    uint64_t resize_ns;
    /** The last frame's generator, such as "cpu" or, with its provider's version, "fsr 3.1.5"; empty for none. */
    char generator[32];
    /** Why a generator that might be better is not used, for people; UTF-8. */
    char preference[160];
    /** Anchors waiting for their time, as of the latest time given. */
    uint32_t waiting;
    /** Frames for Direct3D 12 that were submitted and have not completed. */
    uint32_t under_way;
    /**
     * Frames for Direct3D 12 whose time on the device is known. Other work of the queue meanwhile counts in their times.
     */
    uint64_t device_frames;
    /** Total nanoseconds of them on the device. */
    uint64_t device_frames_ns;
    /** Nanoseconds of the longest. */
    uint64_t device_frame_longest_ns;
    /** Nanoseconds of the last. */
    uint64_t device_frame_last_ns;
    /**
     * The presenter's own lists whose time on the device is known: those that upload pictures, find motion and depth, and prepare what all
     * frames of a pair share.
     */
    uint64_t device_lists;
    /** Total nanoseconds of them on the device. */
    uint64_t device_lists_ns;
    /** Nanoseconds of the longest. */
    uint64_t device_list_longest_ns;
    /**
     * Frames generated per anchor under a budget of cairn_presenter_set_budget; the others repeat the previous one. 0 where there never was
     * a budget.
     */
    uint32_t made_to_anchor;
    /** How often that number has changed. */
    uint32_t budget_changes;
    /**
     * What resizes frames: "spatial", AMD's upscaler with its version as in "fsr 4.0.3", or empty where they have the anchors' size.
     */
    char upscaler[32];
    /** Why AMD's upscaler is not used, for people; UTF-8. */
    char upscaling[160];
    /** Frames for Direct3D 12 replaced by an anchor: CAIRN_FRAME_UNPREPARED. */
    uint64_t unprepared;
    /** Direct3D objects and AMD contexts created while frames were recorded or submitted: 0 where all were prepared. */
    uint64_t objects_made;
    /** Recorded frames whose fences have not been signalled. */
    uint32_t lists_pending;
    /** Pushed anchors whose fences have not been signalled. */
    uint32_t anchors_under_way;
} cairn_presenter_statistics;

/**
 * Gives statistics of a rollout. Does not wait for a step that is running.
 *
 * Ownership: statistics stay the caller's and are filled on success; on failure they are not written.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_rollout_get_statistics(const cairn_rollout *rollout, cairn_rollout_statistics *statistics);

/**
 * Gives statistics of a presenter.
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

/** A flag of cairn_d3d12_options: ONNX Runtime's deterministic kernels only, and no captured passes. */
#define CAIRN_D3D12_DETERMINISTIC 1
/** Recorded frames that may not have run, at most: see cairn_d3d12_preparation.lists. */
#define CAIRN_MAX_LISTS 16
/** A flag of cairn_d3d12_preparation: frames are submitted only, and no memory is kept for recorded ones. */
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

/** How worlds run on a Direct3D 12 device. All zero: as a new device has it. */
typedef struct cairn_d3d12_options {
    /** sizeof(cairn_d3d12_options) */
    uint32_t struct_size;
    /** CAIRN_D3D12_DETERMINISTIC, or 0. */
    uint32_t flags;
    /**
     * Passes of each of a world's graphs that ONNX Runtime may capture, at most: it keeps their commands, and such a pass takes the
     * processor next to nothing. A rollout has two at most to a graph, and those of rollouts that are gone are kept as long as the world.
     * Captured passes are used where they give the same bits as others, which the first runs of each show. 0 for none.
     */
    uint32_t captured_passes;
    /**
     * Longest work of a rollout that may be queued on the anchors' queue at a time, in microseconds of the device's own clock, so that the
     * engine's frames run in between. A pass that would exceed it waits for the work already queued. Passes are never split:
     * cairn_rollout_statistics has the longest pass and the number of waits. 0 for no limit.
     */
    uint32_t longest_submission_us;
} cairn_d3d12_options;

/**
 * Gives pipelines that cairn_pipelines_store_callback got in an earlier run, on the thread that prepares. Called first with null and 0, to
 * return how many bytes there are, 0 for none; then with memory of that size, to fill it and return the same number.
 */
typedef uint64_t (*cairn_pipelines_load_callback)(void *bytes, uint64_t capacity, void *user);

/**
 * Gets the pipelines of a device, on the thread that prepares: bytes are valid during the call only. Bytes of another adapter, driver or
 * version of the library, and damaged ones, are ignored when they are loaded.
 */
typedef void (*cairn_pipelines_store_callback)(const void *bytes, uint64_t size, void *user);

/**
 * What frames for Direct3D 12 are prepared for. All zero: frames of the presenter's size in any format, of the anchors that have come.
 */
typedef struct cairn_d3d12_preparation {
    /** sizeof(cairn_d3d12_preparation) */
    uint32_t struct_size;
    /** DXGI_FORMAT of the targets; 0 for any that frames can be written in, with memory for the widest. */
    uint32_t format;
    /** Size of the targets in pixels; 0 both ways for that of the presenter's frames. */
    uint32_t width;
    /** See width. */
    uint32_t height;
    /** Size of the anchors in pixels, 1 to 16384 each way; 0 both ways for that of the anchors that have come. */
    uint32_t anchor_width;
    /** See anchor_width. */
    uint32_t anchor_height;
    /** Pictures that an anchor brings, as cairn_anchor_info.pictures; 0 for 1. */
    uint32_t anchor_pictures;
    /** As cairn_anchor_info has it; needed where options.motion is CAIRN_MOTION_PAPER, else 0. */
    uint32_t latent_channels;
    /** See latent_channels. */
    uint32_t latent_height;
    /** See latent_channels. */
    uint32_t latent_width;
    /**
     * Frames recorded into the engine's lists that may not have run, 1 to CAIRN_MAX_LISTS; 0 for 4. Each costs the memory of a frame.
     */
    uint32_t lists;
    /** CAIRN_PREPARE_SUBMIT_ONLY, or 0. */
    uint32_t flags;
    /** May be null. */
    cairn_pipelines_load_callback load;
    /** May be null. */
    cairn_pipelines_store_callback store;
    /** Handed to both. */
    void *user;
} cairn_d3d12_preparation;

/** A list of the engine's that a frame is recorded into. */
typedef struct cairn_d3d12_recording {
    /** sizeof(cairn_d3d12_recording) */
    uint32_t struct_size;
    /** D3D12_RESOURCE_STATES of the target when the list comes to it. */
    uint32_t state_before;
    /** D3D12_RESOURCE_STATES that it is left in. */
    uint32_t state_after;
    /** 0 */
    uint32_t reserved;
    /** Open for recording, of the type of the device's queue. */
    struct ID3D12GraphicsCommandList *list;
    /**
     * Of the frames' size, two-dimensional with one level, slice and sample; RGBA8, BGRA8, RGB10A2, RGBA16F or R11G11B10_FLOAT, views for
     * sRGB and typeless ones included; RGBA16F or R11G11B10_FLOAT where the presenter's colour space is CAIRN_COLOUR_LINEAR.
     */
    struct ID3D12Resource *target;
    /** The host's own, of the same device. */
    struct ID3D12Fence *fence;
    /** The fence gets it on the queue that executes the list, after the list. */
    uint64_t fence_value;
} cairn_d3d12_recording;

/**
 * Makes a device of an engine's own. Experimental: this chapter may change without a new CAIRN_ABI_VERSION, and where the library
 * has no Direct3D 12 part every function of it answers CAIRN_ERROR_UNSUPPORTED.
 *
 * d3d12, queue: the engine's; frames are generated and copied on the queue, which must be of type direct or compute.
 * anchors: a compute queue of the same device for the world's passes, so that they never stall the frame; null for one of the
 * library's own.
 * options: may be null for the defaults.
 *
 * Ownership: on success *device is the caller's, for cairn_device_destroy, and holds a reference to each object until it is gone;
 * on failure it is not written and no reference is held. What options point to is read during the call only.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_ARGUMENT, also for an object of another kind or device; CAIRN_ERROR_STRUCT_SIZE;
 * CAIRN_ERROR_UNSUPPORTED; CAIRN_ERROR_RUNTIME_MISSING; CAIRN_ERROR_DEVICE; CAIRN_ERROR_DEVICE_REMOVED.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_device_create_d3d12(
    struct ID3D12Device *d3d12, struct ID3D12CommandQueue *queue, struct ID3D12CommandQueue *anchors,
    const cairn_device_options *options, cairn_device **device);

/**
 * Makes a device of the library's own on an adapter, for hosts that have no engine.
 *
 * luid: of the adapter, as cairn_adapters gives it.
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
 * Sets how a device runs worlds loaded, and rollouts made, from now on.
 *
 * Ownership: options are read during the call; nothing is handed over, on success or on failure.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_UNSUPPORTED, also
 * for a CPU device.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_device_set_d3d12(const cairn_device *device, const cairn_d3d12_options *options);

/**
 * Gives the Direct3D 12 device and the queue that a device runs on.
 *
 * Ownership: on success *d3d12 and *queue have a reference more each, for the caller to release; on failure neither is written.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_UNSUPPORTED, also for a CPU device.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_device_get_d3d12(
    const cairn_device *device, struct ID3D12Device **d3d12, struct ID3D12CommandQueue **queue);

/**
 * Appends a texture, as cairn_rollout_append does a picture: the seed, or an edit of the scene.
 *
 * picture: two-dimensional, RGBA8 or BGRA8, one slice; in state, a D3D12_RESOURCE_STATES, when it is read on the device's queue,
 * behind what the queue has been given, and left in it; it must live until this returns. info: may be null.
 *
 * Ownership: the texture stays the caller's; info is filled on success; on failure it is not written and the rollout is as it was.
 * Threads: one call at a time; a second one beside it, and one while steps are queued, gets CAIRN_ERROR_BUSY.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_BUSY;
 * CAIRN_ERROR_UNSUPPORTED; CAIRN_ERROR_OUT_OF_MEMORY; CAIRN_ERROR_DEVICE; CAIRN_ERROR_CANCELLED.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_rollout_append_d3d12(
    cairn_rollout *rollout, struct ID3D12Resource *picture, uint32_t state, cairn_step_info *info);

/**
 * Gives a picture of an anchor as a texture, with the fence value that guards it.
 *
 * index: 0 to pictures - 1, in order of time.
 * texture: gets RGBA8 of the anchor's size, in state COMMON; to be left in it.
 * fence, value: get what to wait for before it is read; once the fence has the value, it stays as it is.
 *
 * Ownership: on success *texture and *fence have a reference more each, for the caller to release; on failure nothing is written.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_UNSUPPORTED, also for an anchor that was
 * not made on a Direct3D 12 device.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_anchor_get_d3d12(
    const cairn_anchor *anchor, uint32_t index, struct ID3D12Resource **texture, struct ID3D12Fence **fence,
    uint64_t *value);

/**
 * Makes all that frames for Direct3D 12 need, on a thread of the host's that loads: pipelines, textures, memory, AMD's libraries with their
 * contexts and the test that these must pass. Afterwards cairn_presenter_record_d3d12 and cairn_presenter_submit_d3d12 make nothing
 * for frames of these sizes and this format. Blocks for as long as that takes, seconds at the first time.
 *
 * Until it was called, and for frames of another size, format or device, these show the nearest anchor in place of each frame, resized by
 * the processor, with CAIRN_FRAME_UNPREPARED: so call it again when targets change their size. What was prepared before is used until
 * the call is done, and longer where it fails.
 *
 * Pipelines are kept as long as the device, and shared by its presenters. With callbacks they are kept from one run of the program to the next, as
 * far as the driver gives them away; the library writes no file. load is called once for a device, and store where
 * pipelines were compiled that were neither loaded nor stored before, with all of the device's.
 *
 * device: the one on whose queue frames will be made.
 *
 * Ownership: preparation is read during the call; user stays the caller's; nothing is handed over, on success or on failure.
 * Threads: any thread, also while another one pushes, queries, records or submits; a second one that prepares the same presenter gets
 * CAIRN_ERROR_BUSY. Callbacks may call any function but those that destroy the presenter or the device.
 * Results: CAIRN_OK; CAIRN_NOT_READY where no anchor has come and the preparation does not say how large anchors are;
 * CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_BUSY; CAIRN_ERROR_UNSUPPORTED, also for a CPU
 * device and where a required generator or upscaler cannot be used; CAIRN_ERROR_RUNTIME_MISSING where AMD's libraries are required and not
 * there; CAIRN_ERROR_OUT_OF_MEMORY; CAIRN_ERROR_DEVICE; CAIRN_ERROR_DEVICE_REMOVED.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_presenter_prepare_d3d12(
    const cairn_presenter *presenter, const cairn_device *device, const cairn_d3d12_preparation *preparation);

/**
 * Has the frame that is due made on the device's queue, as cairn_presenter_draw writes it into memory, and records its copy into the engine's
 * command list. Compute shaders make it unless options.shader is CAIRN_PREFER_NEVER; where they cannot, the processor does:
 * cairn_presenter_get_statistics says which, and why. The list gets a barrier, a copy and a barrier, and nothing else of it changes.
 *
 * The list may be executed early or late, in another order than it was recorded in, or never. What it copies from is used again once the
 * fence has its value, and not before; nothing waits for it. The same value may stand for several lists if it comes after all of
 * them. Of a list that is dropped the host signals the value itself, or calls cairn_presenter_release_d3d12.
 *
 * A cut that only the generator finds shows the nearer anchor as well, but frame says so only where the processor made it; the
 * statistics count it once the frame has been made.
 *
 * device: the one on whose queue the list will run; on another queue it must wait for what the device's queue has been given before.
 * now_ns: when it will be shown, on the host's clock.
 * recording: the target is in state_before on entry and in state_after on exit, both D3D12_RESOURCE_STATES that the list can name: a compute list
 * cannot name RENDER_TARGET. The presenter must live until the list has run.
 * frame: may be null.
 *
 * Ownership: all objects stay the caller's, and the presenter holds a reference to the fence until it has its value; on success frame is
 * filled; on failure it is not written and no frame is recorded.
 * Threads: one call at a time; a second one beside it gets CAIRN_ERROR_BUSY. Not waited for is a thread that prepares.
 * Results: CAIRN_OK; CAIRN_NOT_READY before the first anchor came; CAIRN_QUEUE_FULL where as many lists as were prepared may not have run:
 * nothing is recorded, and the target holds what it did; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT, also without a fence, for one of
 * another device or that has the value already, and when CAIRN_MOTION_PAPER or CAIRN_MOTION_LATENTS meets an anchor without a latent;
 * CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_BUSY; CAIRN_ERROR_UNSUPPORTED, also for a CPU device; CAIRN_ERROR_OUT_OF_MEMORY; CAIRN_ERROR_DEVICE;
 * CAIRN_ERROR_DEVICE_REMOVED.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_presenter_record_d3d12(
    cairn_presenter *presenter, const cairn_device *device, uint64_t now_ns, const cairn_d3d12_recording *recording,
    cairn_frame *frame);

/**
 * Has the frame that is due written to a texture on the device's queue, in a list of the presenter's own and behind all that the queue has been
 * given. Waits where three frames before it have not run.
 *
 * device, now_ns, frame: as for cairn_presenter_record_d3d12; target, before, after: as in cairn_d3d12_recording. The presenter may hold a
 * reference to target until the third frame after it is made or cairn_presenter_release_d3d12 is called.
 * fence, value: get what to wait for before the frame is read elsewhere than on the queue, and before target is freed.
 *
 * Ownership: target stays the caller's; on success *fence has a reference more, for the caller to release, and frame is filled;
 * on failure nothing is written and the queue has been given no frame.
 * Threads: one call at a time; a second one beside it gets CAIRN_ERROR_BUSY. The queue may be used by others at the same time.
 * Results: CAIRN_OK; CAIRN_NOT_READY, and the errors of cairn_presenter_record_d3d12.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_presenter_submit_d3d12(
    cairn_presenter *presenter, const cairn_device *device, uint64_t now_ns, struct ID3D12Resource *target,
    uint32_t before, uint32_t after, cairn_frame *frame, struct ID3D12Fence **fence, uint64_t *value);

/**
 * Waits until all frames have run and releases their targets, as a swap chain wants it before its buffers are resized. Every list that frames
 * were recorded into must have been given to the queue, or never will be: their memory is free then, whatever their fences say.
 *
 * Ownership: nothing is handed over, on success or on failure.
 * Threads: one call at a time; a second one beside it gets CAIRN_ERROR_BUSY.
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
/** The newest machine-learning provider; fails where there is none. */
#define CAIRN_FSR_REQUIRE_ML 3
/** The newest analytic provider; fails where there is none. */
#define CAIRN_FSR_REQUIRE_ANALYTIC 4

/**
 * A flag of cairn_swapchain_options: frames are generated on a compute queue of the swap chain's own, beside what the engine draws.
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
/** A flag of cairn_swapchain_options: AMD's provider checks its inputs and logs what it finds. */
#define CAIRN_SWAPCHAIN_CHECKED 64

/**
 * A flag of cairn_swapchain_options: skips the test in which a provider must move a picture of known motion to the right position.
 */
#define CAIRN_SWAPCHAIN_UNTRIED 128

/**
 * A flag of cairn_swapchain_frame: the frame has no predecessor, as after a cut. No frame is generated between it and the previous one.
 */
#define CAIRN_SWAPCHAIN_RESET 1
/** A flag of cairn_swapchain_set_interface: colours are premultiplied by alpha. */
#define CAIRN_INTERFACE_PREMULTIPLIED 1

/**
 * A flag of cairn_swapchain_set_interface: the picture is copied within Present, so that it may be drawn to again at once.
 */
#define CAIRN_INTERFACE_COPIED 2

/**
 * A flag of cairn_swapchain_pacing: waits by sleeping, and by spinning for the last spin_ticks; else by spinning alone.
 */
#define CAIRN_PACING_HYBRID_SPIN 1
/** A flag of cairn_swapchain_pacing: the system wakes a thread at a fence; else it spins. */
#define CAIRN_PACING_WAIT_ON_FENCE 2

/**
 * Options of AMD's swap chain. All zero: any provider that passes the test, with motion and depth of the buffers' size.
 */
typedef struct cairn_swapchain_options {
    /** sizeof(cairn_swapchain_options) */
    uint32_t struct_size;
    /** CAIRN_SWAPCHAIN_ASYNC to CAIRN_SWAPCHAIN_UNTRIED */
    uint32_t flags;
    /** CAIRN_FSR_ANY to CAIRN_FSR_REQUIRE_ANALYTIC */
    uint32_t provider;
    /** DXGI_FORMAT of frames without interface; 0 for that of the buffers. */
    uint32_t hudless_format;
    /**
     * The largest size in pixels of motion and depth; 0 both ways for that of the buffers, even after they are resized.
     */
    uint32_t max_render_width;
    /** See max_render_width. */
    uint32_t max_render_height;
} cairn_swapchain_options;

/**
 * Motion and depth of a frame that an engine draws. Textures are two-dimensional with one level, slice and sample. Each is in the given
 * D3D12_RESOURCE_STATES before and after the list runs; optional ones may be null.
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
     * The frame without interface, of the buffers' size and options.hudless_format; may be null. It is read within Present and must not be
     * drawn to until Present returns, with CAIRN_SWAPCHAIN_ASYNC until the next Present returns.
     */
    ID3D12Resource *hudless;
    /**
     * Lens distortion: each pixel's position after the lens minus its position before, as a fraction of the picture, of the buffers' size. May
     * be null, but not in a frame after one that had it.
     */
    ID3D12Resource *distortion;
    /** State of depth. */
    uint32_t depth_state;
    /** State of motion. */
    uint32_t motion_state;
    /** State of hudless. */
    uint32_t hudless_state;
    /** State of distortion. */
    uint32_t distortion_state;
    /** Render size in pixels, at most that of the options. */
    uint32_t render_width;
    /** See render_width. */
    uint32_t render_height;
    /**
     * The rectangle of the buffers that shows the world, in pixels; the rest is shown unchanged. Size 0 for all of it.
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

/** How presents are spread over time. */
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
    /**
     * Last error code of AMD's generator within Present, a code of ffx-api's; 0 where it never failed. After an error frames are presented
     * without a generated one between them.
     */
    uint32_t failed;
    /** Frames generated. */
    uint64_t generated;
    /** Bytes of device memory that the generator reports; 0 where unknown. */
    uint64_t generator_bytes;
    /** The part of them that may alias other memory. */
    uint64_t generator_aliasable_bytes;
    /** Bytes of device memory of the swap chain itself; 0 where unknown. */
    uint64_t swapchain_bytes;
    /** The part of them that may alias other memory. */
    uint64_t swapchain_aliasable_bytes;
    /**
     * Provider that generates frames, such as "3.1.6 (analytic)"; empty after cairn_swapchain_fit has failed. UTF-8.
     */
    char generator[64];
    /** Provider that presents them. UTF-8. */
    char pacer[64];
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
 * A swap chain of AMD's, which presents generated frames between an engine's own and spreads them over time. Not needed for frames of a
 * presenter: those go into textures, whoever presents them. Experimental, as all of this chapter; where the library has no Direct3D 12
 * part there is none.
 *
 * An engine draws into its buffers and calls Present as ever; before that it has motion and depth of the frame recorded by
 * cairn_swapchain_prepare. AMD's swap chain has threads of its own, which present. AMD's libraries are looked for as
 * cairn_device_requirements says.
 *
 * Threads: what is done to the DXGI swap chain, Present among it, counts as a call on this one.
 */
typedef struct cairn_swapchain cairn_swapchain;

/**
 * Has AMD take over an engine's swap chain. It must be in a window and *own the only reference to it; none of its buffers may be held.
 *
 * device: whose queue for frames is the direct queue that the engine draws on.
 * options: may be null for the defaults.
 * own: becomes null when AMD's library gets the swap chain, also where that fails then; before that a failure leaves it as it was.
 *
 * Ownership: on success *swapchain is the caller's, for cairn_swapchain_destroy, and the reference in *own is gone; on failure
 * *swapchain is not written.
 * Threads: any thread, at any time.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT, also for what AMD's library would hang or crash on: a queue
 * that is not direct, a swap chain that is full screen, of no size, or that somebody else holds; CAIRN_ERROR_STRUCT_SIZE;
 * CAIRN_ERROR_UNSUPPORTED, also where no provider stands the test; CAIRN_ERROR_RUNTIME_MISSING where AMD's libraries are not there;
 * CAIRN_ERROR_OUT_OF_MEMORY; CAIRN_ERROR_DEVICE; CAIRN_ERROR_DEVICE_REMOVED.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_swapchain_wrap(
    const cairn_device *device, const cairn_swapchain_options *options, struct IDXGISwapChain **own,
    cairn_swapchain **swapchain);

/**
 * Has AMD make a swap chain as IDXGIFactory::CreateSwapChain does.
 *
 * device, options: as for cairn_swapchain_wrap.
 * description: of the swap chain, in a window.
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
 * Has AMD make a swap chain for a window as IDXGIFactory2::CreateSwapChainForHwnd does.
 *
 * device, options: as for cairn_swapchain_wrap.
 * window: a HWND, which lives longer than the swap chain.
 * fullscreen: may be null; else it must say that the swap chain is windowed.
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
 * Gives the swap chain itself, to be drawn into and presented by.
 *
 * Ownership: on success *dxgi has a reference more, for the caller to release before cairn_swapchain_destroy; on failure it is not
 * written.
 * Threads: one call at a time; a second one beside it gets CAIRN_ERROR_BUSY.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_BUSY.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_swapchain_get_dxgi(cairn_swapchain *swapchain, struct IDXGISwapChain4 **dxgi);

/**
 * Records motion and depth of the frame that is presented next; Present then also shows a frame generated between it and the previous
 * one. A frame without a recording is presented alone. The list's descriptor heaps, compute root signature and pipeline are replaced;
 * nothing else of its state changes.
 *
 * list: open for recording, of the device's queue; to be given to it before Present.
 *
 * Ownership: all stays the caller's, on success and on failure; what frame points to must live until the list has run, and what is
 * read within Present until the next one came back.
 * Threads: one call at a time; a second one beside it gets CAIRN_ERROR_BUSY.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT with nothing recorded; CAIRN_ERROR_STRUCT_SIZE;
 * CAIRN_ERROR_BUSY; CAIRN_ERROR_INVALID_STATE where buffers were resized and cairn_swapchain_fit was not called; CAIRN_ERROR_OUT_OF_MEMORY;
 * CAIRN_ERROR_DEVICE and CAIRN_ERROR_DEVICE_REMOVED, after which the list may hold a part of the work.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_swapchain_prepare(
    cairn_swapchain *swapchain, ID3D12GraphicsCommandList *list, const cairn_swapchain_frame *frame);

/**
 * Sets the picture composited over real and generated frames from the next Present on; waits for frames that show the previous one.
 *
 * picture: of the buffers' size, with alpha; null for nothing. It is read within Present and after it; unless it is copied it must not be
 * drawn to before cairn_swapchain_wait.
 * state: the D3D12_RESOURCE_STATES that it rests in.
 * flags: CAIRN_INTERFACE_PREMULTIPLIED, CAIRN_INTERFACE_COPIED
 *
 * Ownership: picture stays the caller's; on success the swap chain holds a reference until another is told; on failure it holds what
 * it did.
 * Threads: one call at a time; a second one beside it gets CAIRN_ERROR_BUSY.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_BUSY; CAIRN_ERROR_DEVICE;
 * CAIRN_ERROR_DEVICE_REMOVED.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_swapchain_set_interface(
    cairn_swapchain *swapchain, ID3D12Resource *picture, uint32_t state, uint32_t flags);

/**
 * Sets how presents are spread over time.
 *
 * pacing: null for AMD's own.
 *
 * Ownership: pacing is read during the call; nothing is handed over, on success or on failure.
 * Threads: one call at a time; a second one beside it gets CAIRN_ERROR_BUSY.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_INVALID_ARGUMENT; CAIRN_ERROR_STRUCT_SIZE; CAIRN_ERROR_BUSY;
 * CAIRN_ERROR_UNSUPPORTED of SDK 1.1.1 and earlier; CAIRN_ERROR_DEVICE.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_swapchain_set_pacing(cairn_swapchain *swapchain, const cairn_swapchain_pacing *pacing);

/**
 * Disables generated frames: frames are presented as they come until one is prepared again. Waits until all are shown.
 *
 * Ownership: nothing is handed over, on success or on failure.
 * Threads: one call at a time; a second one beside it gets CAIRN_ERROR_BUSY.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_BUSY; CAIRN_ERROR_DEVICE; CAIRN_ERROR_DEVICE_REMOVED.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_swapchain_pause(cairn_swapchain *swapchain);

/**
 * Waits until all frames that were given to Present are shown.
 *
 * Ownership: nothing is handed over, on success or on failure.
 * Threads: one call at a time; a second one beside it gets CAIRN_ERROR_BUSY.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_BUSY; CAIRN_ERROR_DEVICE; CAIRN_ERROR_DEVICE_REMOVED.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_swapchain_wait(cairn_swapchain *swapchain);

/**
 * Adapts to the current size and format of the buffers: call it after ResizeBuffers, before the next frame is prepared. After a
 * failure frames are presented as they come, until it succeeds.
 *
 * Ownership: nothing is handed over, on success or on failure.
 * Threads: one call at a time; a second one beside it gets CAIRN_ERROR_BUSY.
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
 * Destroys a swap chain in the order that AMD requires: disable generation, finish presenting, destroy the generator, the swap chain and
 * its pacing; null is allowed. The engine must first release every reference to the DXGI swap chain and its buffers.
 *
 * Ownership: on success swapchain is no handle any more; on failure it is as it was.
 * Threads: any thread; waits for calls in flight on the swap chain.
 * Results: CAIRN_OK; CAIRN_ERROR_INVALID_HANDLE; CAIRN_ERROR_BUSY where somebody holds the DXGI swap chain, and from within a callback of
 * a call on it.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_swapchain_destroy(cairn_swapchain *swapchain);

#ifdef __cplusplus
} /* extern "C" */
#endif

#endif /* CAIRN_H */
