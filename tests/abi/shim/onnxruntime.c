/* An ONNX Runtime shim whose calls tests can observe: it loads the real library, which CAIRN_ONNXRUNTIME names, and returns its table
   of functions with some of them wrapped. */
#include <stdint.h>
#ifdef _WIN32
#include <windows.h>
#define dlopen(path, flags) ((void *)LoadLibraryA(path))
/* ISO C has no direct conversion of a pointer to a function. */
#define dlsym(library, name) ((void *)(uintptr_t)GetProcAddress((HMODULE)(library), name))
#else
#include <dlfcn.h>
#endif
#include <stdlib.h>
#include <string.h>

#include "onnxruntime.h"

/* Indices in the table of functions of interface version 24. Later versions only append to it. */
enum { CREATE_STATUS = 0, CREATE_SESSION_FROM_ARRAY = 8, RUN_WITH_BINDING = 133, ENTRIES = 415 };

typedef struct {
    const void *(*get_api)(uint32_t version);
    const char *(*get_version)(void);
} Base;

struct cairn_test_shim cairn_test_shim;

static const Base *real;
static void *table[ENTRIES];

static void *create_status(int code, const char *text)
{
    void *(*create)(int, const char *);
    memcpy(&create, &table[CREATE_STATUS], sizeof create);
    return create(code, text);
}

/* ---- Calls that are wrapped only to fail, by their indices: all that the library makes for a world and a rollout, except two kinds.
   A failing release would be a leak caused by the test; and calls that read a type or shape, or describe memory, fail only if
   a few bytes cannot be allocated. ---- */
#define WRAPPED(W)                                                                                                       \
    W(9) W(10) W(12) W(13) W(23) W(24) W(25) W(30) W(31) W(33) W(34) W(36) W(37) W(39) W(46) W(47) W(48) W(49)           \
    W(75) W(78) W(124) W(130) W(131) W(134) W(136) W(137) W(138) W(274) W(279) W(304) W(376) W(386) W(407)

/* Each takes at most eight words, and a function ignores additional arguments. */
typedef uintptr_t Word;
typedef void *(*Call)(Word, Word, Word, Word, Word, Word, Word, Word);

static int fault(void)
{
    return cairn_test_shim.fails && cairn_test_shim.fails();
}

#define WRAPPER(n)                                                                        \
    static Call real_##n;                                                                 \
    static void *call_##n(Word a, Word b, Word c, Word d, Word e, Word f, Word g, Word h) \
    {                                                                                     \
        if (fault()) return create_status(1, "a fault made by a test");                   \
        return real_##n(a, b, c, d, e, f, g, h);                                          \
    }
WRAPPED(WRAPPER)

static void *(*real_create)(const void *, const void *, size_t, const void *, void **);
static void *(*real_run)(void *, const void *, const void *);

static void *create_session(const void *environment, const void *model, size_t size, const void *options, void **session)
{
    __atomic_add_fetch(&cairn_test_shim.sessions, 1, __ATOMIC_SEQ_CST);
    if (fault()) return create_status(1, "a fault made by a test");
    return real_create(environment, model, size, options, session);
}

static void *run(void *session, const void *options, const void *binding)
{
    unsigned long number = __atomic_add_fetch(&cairn_test_shim.runs, 1, __ATOMIC_SEQ_CST);
    if (cairn_test_shim.inside_run) cairn_test_shim.inside_run(number);
    if (cairn_test_shim.fail_run == number || fault()) return create_status(1, "a fault made by a test");
    return real_run(session, options, binding);
}

static const void *get_api(uint32_t version)
{
    const void *api = real->get_api(version);
    if (!api || version != 24) return api;
    if (!table[0]) {
        memcpy(table, api, sizeof table);
        memcpy(&real_create, &table[CREATE_SESSION_FROM_ARRAY], sizeof real_create);
        memcpy(&real_run, &table[RUN_WITH_BINDING], sizeof real_run);
        void *(*wrapped_create)(const void *, const void *, size_t, const void *, void **) = create_session;
        void *(*wrapped_run)(void *, const void *, const void *) = run;
        memcpy(&table[CREATE_SESSION_FROM_ARRAY], &wrapped_create, sizeof wrapped_create);
        memcpy(&table[RUN_WITH_BINDING], &wrapped_run, sizeof wrapped_run);
#define WRAP(n)                                            \
    {                                                      \
        Call wrapper = call_##n;                           \
        memcpy(&real_##n, &table[n], sizeof real_##n);     \
        memcpy(&table[n], &wrapper, sizeof wrapper);       \
    }
        WRAPPED(WRAP)
    }
    return table;
}

static const char *get_version(void)
{
    return real->get_version();
}

const void *OrtGetApiBase(void)
{
    static const Base base = {get_api, get_version};
    if (!real) {
        const char *path = getenv("CAIRN_ONNXRUNTIME");
        void *library = path ? dlopen(path, RTLD_NOW | RTLD_LOCAL) : NULL;
        void *symbol = library ? dlsym(library, "OrtGetApiBase") : NULL;
        const Base *(*get)(void);
        memcpy(&get, &symbol, sizeof get);
        if (!symbol || !(real = get())) return NULL;
    }
    return &base;
}
