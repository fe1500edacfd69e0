/* Calls where they are not allowed: during another call, inside callbacks, and destruction with work in flight. */
#include <pthread.h>
#include <unistd.h>

#include "stage.h"
#include "shim/onnxruntime.h"

#ifdef _WIN32
static int setenv(const char *name, const char *value, int overwrite)
{
    (void)overwrite;
    return _putenv_s(name, value);
}
#endif

static cairn_device *device;

/* Calls every row except those that destroy or restart something; objects that it creates are destroyed. Calls that need exclusive
   use of `busy` must return CAIRN_ERROR_BUSY. */
static void call_all(void *busy)
{
    struct argument a[MOST_ARGUMENTS];
    for (const struct row *row = rows; row < rows + ROWS; row++) {
        const struct shape *first = &row->shapes[0];
        if (destroys(row) || strstr(row->name, "log_callback") || strstr(row->name, "save_file")) continue;
        if (strstr(row->name, "world_load") || strstr(row->name, "device_create") || strstr(row->name, "resume")) continue;
        /* These would change the result of the next call of the same row. */
        const char *const once[] = {"reset", "cancel", "single_step"};
        int again = 1;
        for (int i = 0; i < 3; i++) again &= !strstr(row->name, once[i]);
        if (!busy && !again) continue;
        valid_arguments(row, a, 0);
        cairn_result r = row->call(a);
        release_given(row, a, r);
        int in_use = busy && first->kind == HANDLE_ARGUMENT && a[0].pointer == busy;
        int refused = r == CAIRN_ERROR_BUSY || (r == CAIRN_ERROR_UNSUPPORTED && is_for_windows(row->name));
        if (needs_no_object(row) ? r != CAIRN_ERROR_BUSY : in_use && first->alone ? r != CAIRN_ERROR_BUSY : r < 0 && !(in_use && refused) && !is_for_windows(row->name)) {
            fprintf(stderr, "%s: %s (%s)\n", row->name, cairn_result_name(r), message());
            CHECK(!"it answers as it does beside another call");
        }
        void *made = NULL;
        if (r == CAIRN_OK && created_kind(row) != OBJECTS) memcpy(&made, a[row->count - 1].pointer, sizeof made);
        if (made) OK(destroy_object(created_kind(row), made));
    }
}

/* ---- During a step that is held inside ONNX Runtime. ---- */
static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static pthread_cond_t changed = PTHREAD_COND_INITIALIZER;
static int inside, let_go;

static void hold(unsigned long number)
{
    (void)number;
    pthread_mutex_lock(&lock);
    inside = 1;
    pthread_cond_broadcast(&changed);
    while (!let_go) pthread_cond_wait(&changed, &lock);
    pthread_mutex_unlock(&lock);
}

static void *step(void *rollout)
{
    cairn_controls c = controls(1);
    OK(cairn_rollout_step(rollout, &c, NULL));
    return NULL;
}

static void begin_held(pthread_t *thread, void *rollout)
{
    inside = let_go = 0;
    cairn_test_shim.inside_run = hold;
    CHECK(pthread_create(thread, NULL, step, rollout) == 0);
    pthread_mutex_lock(&lock);
    while (!inside) pthread_cond_wait(&changed, &lock);
    pthread_mutex_unlock(&lock);
    cairn_test_shim.inside_run = NULL;
}

static void go_on(void)
{
    pthread_mutex_lock(&lock);
    let_go = 1;
    pthread_cond_broadcast(&changed);
    pthread_mutex_unlock(&lock);
}

static void calls_during_an_exclusive_call_are_refused(void)
{
    create_objects(device);
    cairn_rollout_info was = {.struct_size = sizeof was}, is = was;
    OK(cairn_rollout_get_info(objects[ROLLOUT], &was));
    pthread_t thread;
    begin_held(&thread, objects[ROLLOUT]);
    call_all(objects[ROLLOUT]);
    go_on();
    pthread_join(thread, NULL);
    OK(cairn_rollout_get_info(objects[ROLLOUT], &is));
    CHECK(is.latents == was.latents + 1);
    objects[DEVICE] = NULL;
    destroy_objects();
}

static void *end_rollout(void *rollout)
{
    OK(cairn_rollout_destroy(rollout));
    return NULL;
}

static void destruction_waits_for_the_call_in_flight_and_refuses_later_ones(void)
{
    create_objects(device);
    cairn_rollout *rollout = objects[ROLLOUT];
    pthread_t ending;
    inside = let_go = 0;
    cairn_test_shim.inside_run = hold;
    /* The destruction cancels the step, unless it is in its last pass. */
    cairn_controls c = controls(1);
    uint64_t ticket = 0;
    OK(cairn_rollout_submit(rollout, &c, &ticket));
    pthread_mutex_lock(&lock);
    while (!inside) pthread_cond_wait(&changed, &lock);
    pthread_mutex_unlock(&lock);
    cairn_test_shim.inside_run = NULL;
    CHECK(pthread_create(&ending, NULL, end_rollout, rollout) == 0);
    while (cairn_rollout_pause(rollout) != CAIRN_ERROR_INVALID_HANDLE) usleep(1000);
    ANSWERS(CAIRN_ERROR_INVALID_HANDLE, cairn_rollout_step(rollout, &c, NULL));
    ANSWERS(CAIRN_ERROR_INVALID_HANDLE, cairn_rollout_destroy(rollout));
    unsigned long runs = cairn_test_shim.runs;
    go_on();
    pthread_join(ending, NULL);
    CHECK(cairn_test_shim.runs == runs);
    objects[ROLLOUT] = NULL;
    objects[DEVICE] = NULL;
    destroy_objects();
}

/* ---- Callbacks that call the library. ---- */
static unsigned long reports;
static cairn_device *loading_on;

static uint32_t call_from_progress(const cairn_load_progress *progress, void *user)
{
    CHECK(progress->struct_size == sizeof *progress && user == &reports);
    if (++reports % 4 != 1) return 0;
    call_all(NULL);
    ANSWERS(CAIRN_ERROR_BUSY, cairn_device_destroy(loading_on));
    /* A load inside a load works as usual. */
    if (reports == 1) OK(cairn_world_destroy(make_world(loading_on)));
    return 0;
}

static void a_progress_callback_may_call_everything_except_its_devices_destruction(void)
{
    create_objects(device);
    cairn_device_options cpu = {.struct_size = sizeof cpu, .threads = 1, .flags = CAIRN_DEVICE_ENVIRONMENT,
        .onnxruntime = getenv("CAIRN_TEST_SHIM")};
    OK(cairn_device_create_cpu(&cpu, &loading_on));
    cairn_world_options options = {.struct_size = sizeof options, .path = world_path(), .progress = call_from_progress,
        .user = &reports, .operating_point = "stock,g16,native,pictures:1"};
    cairn_world *world = NULL;
    OK(cairn_world_load(loading_on, &options, &world));
    CHECK(reports > 4);
    OK(cairn_world_destroy(world));
    OK(cairn_device_destroy(loading_on));
    objects[DEVICE] = NULL;
    destroy_objects();
}

static unsigned long messages;

static void call_from_log(uint32_t level, const char *target, const char *text, void *user)
{
    CHECK(level >= CAIRN_LOG_ERROR && level <= CAIRN_LOG_TRACE && target && text && user == &messages);
    __atomic_add_fetch(&messages, 1, __ATOMIC_SEQ_CST);
    ANSWERS(CAIRN_ERROR_BUSY, cairn_set_log_callback(CAIRN_LOG_OFF, NULL, NULL));
    /* The device is only being created, on another thread perhaps: what that one waits for, this call must not. */
    cairn_device_options options = {.struct_size = sizeof options, .threads = 1, .onnxruntime = getenv("CAIRN_TEST_SHIM")};
    uint32_t count = 0;
    OK(cairn_device_requirements(CAIRN_DEVICE_CPU, &options, NULL, 0, 0, &count));
    cairn_presenter *presenter = NULL;
    cairn_anchor *anchor = create_anchor(0);
    OK(cairn_presenter_create(NULL, &presenter));
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_presenter_push(presenter, anchor, NULL, 0));
    OK(cairn_anchor_destroy(anchor));
    OK(cairn_presenter_destroy(presenter));
}

static void a_log_callback_may_call_everything_except_its_own_destruction(void)
{
    cairn_device_options options = {.struct_size = sizeof options, .threads = 1, .flags = CAIRN_DEVICE_DETERMINISTIC,
        .onnxruntime = getenv("CAIRN_TEST_SHIM")};
    /* ONNX Runtime logs while it starts. */
    OK(cairn_set_log_callback(CAIRN_LOG_TRACE, call_from_log, &messages));
    cairn_device *made = NULL;
    OK(cairn_device_create_cpu(&options, &made));
    OK(cairn_set_log_callback(CAIRN_LOG_OFF, NULL, NULL));
    CHECK(messages > 0);
#ifdef _WIN32
    cpu = made;
    device = create_device();
#else
    device = made;
#endif
}

/* ---- Every order of destruction, with work in flight. ---- */
static void objects_may_be_destroyed_in_any_order(void)
{
    for (int order = 0; order < 120; order++) {
        create_objects(device);
        OK(cairn_rollout_resume(objects[QUEUE])); /* work in flight */
        const enum object ends[] = {ROLLOUT, QUEUE, ANCHOR, GUIDANCE, PRESENTER};
        int left[5] = {0, 1, 2, 3, 4}, n = order;
        for (int i = 5; i > 0; i--) {
            int pick = n % i;
            enum object which = ends[left[pick]];
            n /= i;
            memmove(&left[pick], &left[pick + 1], sizeof(int) * (size_t)(4 - pick));
            OK(destroy_object(which, objects[which]));
            objects[which] = NULL;
        }
        void *world = objects[WORLD];
        if (order != 119) objects[WORLD] = NULL;
        objects[DEVICE] = NULL;
        destroy_objects();
        objects[WORLD] = order == 119 ? NULL : world;
    }
}

int main(void)
{
#ifdef _WIN32
    unsigned long before[2];
    given_create(&given);
    given_references(&given, before);
#endif
    /* Rows that name an ONNX Runtime library must name the one in use. */
    const char *shim = getenv("CAIRN_TEST_SHIM");
    if (!shim || setenv("CAIRN_TEST_CALLS_ONNXRUNTIME", shim, 1)) return 2;
    RUN(a_log_callback_may_call_everything_except_its_own_destruction);
    RUN(calls_during_an_exclusive_call_are_refused);
    RUN(destruction_waits_for_the_call_in_flight_and_refuses_later_ones);
    RUN(a_progress_callback_may_call_everything_except_its_devices_destruction);
    RUN(objects_may_be_destroyed_in_any_order);
    destroy_devices(device);
#ifdef _WIN32
    if (!given_has_references(&given, before)) return 1;
#endif
    return failed_tests != 0;
}
