/* Versions, results, the last error, the log, requirements and devices. */
#include <pthread.h>
#include <stdint.h>

#include "check.h"

static void versions_equal_the_headers(void)
{
    CHECK(cairn_abi_version() == CAIRN_ABI_VERSION);
    CHECK(cairn_version() == CAIRN_VERSION);
}

static void results_have_names(void)
{
    CHECK(strcmp(cairn_result_name(CAIRN_OK), "CAIRN_OK") == 0);
    CHECK(strcmp(cairn_result_name(CAIRN_ERROR_INTERNAL), "CAIRN_ERROR_INTERNAL") == 0);
    CHECK(strcmp(cairn_result_name(12345), "unknown result") == 0);
}

static void *other_thread(void *unused)
{
    (void)unused;
    char text[8] = "x";
    size_t length = 7;
    OK(cairn_last_error(text, sizeof text, &length));
    CHECK(length == 0 && text[0] == 0);
    return NULL;
}

static void each_thread_has_its_own_last_error(void)
{
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_device_create_cpu(NULL, NULL));
    CHECK(strstr(message(), "cairn_device_create_cpu: device:") == message());
    pthread_t thread;
    CHECK(pthread_create(&thread, NULL, other_thread, NULL) == 0);
    pthread_join(thread, NULL);
    /* Success does not change the last error. */
    OK(cairn_device_destroy(NULL));
    CHECK(strstr(message(), "device:") != NULL);

    size_t length = 0;
    OK(cairn_last_error(NULL, 0, &length));
    CHECK(length == strlen(message()));
    char cut[10];
    memset(cut, 'x', sizeof cut);
    ANSWERS(CAIRN_TRUNCATED, cairn_last_error(cut, 8, NULL));
    CHECK(memcmp(cut, "cairn_d", 8) == 0 && cut[8] == 'x' && cut[9] == 'x');
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_last_error(NULL, 1, NULL));
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_last_error(cut, 8, (size_t *)(void *)(cut + 1)));
}

static int logged;
static const char *logged_user;

static void log_line(uint32_t level, const char *target, const char *text, void *user)
{
    CHECK(level >= CAIRN_LOG_ERROR && level <= CAIRN_LOG_TRACE);
    CHECK(target[0] != 0 && text != NULL);
    logged_user = user;
    __atomic_add_fetch(&logged, 1, __ATOMIC_SEQ_CST);
    /* The log callback may call the library; setting another callback inside it must fail and not hang. */
    size_t length = 0;
    OK(cairn_last_error(NULL, 0, &length));
    ANSWERS(CAIRN_ERROR_BUSY, cairn_set_log_callback(CAIRN_LOG_OFF, NULL, NULL));
}

static void log_messages_reach_the_callback(void)
{
    static char user[] = "user";
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_set_log_callback(6, log_line, user));
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_set_log_callback(UINT32_MAX, NULL, NULL));
    OK(cairn_set_log_callback(CAIRN_LOG_TRACE, log_line, user));
    cairn_device *device = make_device();
    cairn_world *world = make_world(device);
    OK(cairn_world_destroy(world));
    OK(cairn_device_destroy(device));
    OK(cairn_set_log_callback(CAIRN_LOG_TRACE, NULL, NULL));
    CHECK(logged > 0 && logged_user == user);
    int before = logged;
    device = make_device();
    OK(cairn_device_destroy(device));
    CHECK(logged == before);
}

static void requirements_report_what_is_installed(void)
{
    uint32_t count = 0;
    cairn_device_options options = {.struct_size = sizeof options, .flags = CAIRN_DEVICE_ENVIRONMENT};
    OK(cairn_device_requirements(CAIRN_DEVICE_CPU, &options, NULL, 0, 0, &count));
    CHECK(count == 3);
    cairn_requirement rows[4];
    memset(rows, 0xee, sizeof rows);
    OK(cairn_device_requirements(CAIRN_DEVICE_CPU, &options, rows, sizeof rows[0], 4, &count));
    int seen = 0;
    for (uint32_t i = 0; i < count; i++) {
        CHECK(rows[i].struct_size == sizeof rows[0]);
        CHECK(rows[i].needed[0] && rows[i].found[0]);
        if (rows[i].what == CAIRN_REQUIREMENT_ONNXRUNTIME) {
            CHECK(rows[i].status == CAIRN_REQUIREMENT_MET && strncmp(rows[i].found, "1.24.", 5) == 0);
            seen++;
        }
    }
    CHECK(seen == 1 && rows[3].struct_size == 0xeeeeeeee);

    options.onnxruntime = "/there/is/no/such/file.so";
    OK(cairn_device_requirements(CAIRN_DEVICE_CPU, &options, rows, sizeof rows[0], 4, &count));
    CHECK(rows[1].status == CAIRN_REQUIREMENT_NOT_MET && strstr(rows[1].found, "no/such") != NULL);
    OK(cairn_device_requirements(CAIRN_DEVICE_D3D12, NULL, rows, sizeof rows[0], 4, &count));
    CHECK(count >= 1 && rows[0].what == CAIRN_REQUIREMENT_PLATFORM);
    CHECK(count == 1 ? rows[0].status == CAIRN_REQUIREMENT_NOT_MET : rows[0].status == CAIRN_REQUIREMENT_MET);
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_device_requirements(0, NULL, NULL, 0, 0, &count));
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_device_requirements(99, NULL, NULL, 0, 0, &count));
}

static void adapters_include_the_processor(void)
{
    cairn_adapter rows[2];
    uint32_t count = 0;
    OK(cairn_adapters(rows, sizeof rows[0], 2, &count));
    CHECK(count == 1 && rows[0].kind == CAIRN_DEVICE_CPU && rows[0].name[0] && rows[0].memory > 1 << 20);
    /* The array of a newer host has larger elements. */
    struct {
        cairn_adapter row;
        uint64_t newer;
    } longer = {.newer = UINT64_MAX};
    OK(cairn_adapters(&longer.row, sizeof longer, 1, &count));
    CHECK(longer.newer == 0 && longer.row.struct_size == sizeof longer);
    for (size_t stride = 0; stride < sizeof rows[0]; stride++) {
        ANSWERS(CAIRN_ERROR_STRUCT_SIZE, cairn_adapters(rows, stride, 1, &count));
    }
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_adapters(NULL, sizeof rows[0], 1, &count));
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_adapters(rows, sizeof rows[0], 1, NULL));
}

static void a_device_describes_itself(void)
{
    cairn_device *device = make_device();
    cairn_device_info info = {.struct_size = sizeof info};
    OK(cairn_device_get_info(device, &info));
    CHECK(info.kind == CAIRN_DEVICE_CPU && info.precision == CAIRN_PRECISION_F32 && info.threads == 2);
    CHECK(strstr(info.description, "2 threads, deterministic") != NULL);
    OK(cairn_device_destroy(device));
}

/* The environment variable names an existing library, and a host need not use it. */
static void environment_variables_count_only_if_the_host_allows_it(void)
{
    cairn_device *device = NULL;
    cairn_device_options options = {.struct_size = sizeof options};
    CHECK(getenv("CAIRN_ONNXRUNTIME"));
    ANSWERS(CAIRN_ERROR_RUNTIME_MISSING, cairn_device_create_cpu(NULL, &device));
    CHECK(strstr(message(), "CAIRN_ONNXRUNTIME is set, but this host lets it name no library"));
    ANSWERS(CAIRN_ERROR_RUNTIME_MISSING, cairn_device_create_cpu(&options, &device));
    options.flags = CAIRN_DEVICE_ENVIRONMENT;
    OK(cairn_device_create_cpu(&options, &device));
    OK(cairn_device_destroy(device));
    options.flags = 0;
    options.onnxruntime = getenv("CAIRN_ONNXRUNTIME");
    OK(cairn_device_create_cpu(&options, &device));
    OK(cairn_device_destroy(device));
}

static void invalid_device_options_are_refused(void)
{
    cairn_device *device = (cairn_device *)(uintptr_t)0x1234;
    cairn_device_options good = {.struct_size = sizeof good}, options = good;
    options.threads = 1025;
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_device_create_cpu(&options, &device));
    options = good;
    options.flags = 4;
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_device_create_cpu(&options, &device));
    options = good;
    options.reserved = 1;
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_device_create_cpu(&options, &device));
    options = good;
    options.onnxruntime = "\xff\xfe";
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_device_create_cpu(&options, &device));
    options.onnxruntime = NULL;
    options.ffx = "\xff\xfe";
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_device_create_cpu(&options, &device));
    options.ffx = NULL;
    options.onnxruntime = "/there/is/no/such/file.so";
    ANSWERS(CAIRN_ERROR_RUNTIME_MISSING, cairn_device_create_cpu(&options, &device));
    /* A failed call writes no result. */
    CHECK(device == (cairn_device *)(uintptr_t)0x1234);
}

static void many_devices_leak_nothing(void)
{
    const cairn_device_options options = {.struct_size = sizeof options, .flags = CAIRN_DEVICE_ENVIRONMENT};
    for (int i = 0; i < 10000; i++) {
        cairn_device *device = NULL;
        OK(cairn_device_create_cpu(&options, &device));
        OK(cairn_device_destroy(device));
    }
}

int main(void)
{
    RUN(versions_equal_the_headers);
    RUN(results_have_names);
    RUN(each_thread_has_its_own_last_error);
    RUN(log_messages_reach_the_callback);
    RUN(requirements_report_what_is_installed);
    RUN(adapters_include_the_processor);
    RUN(a_device_describes_itself);
    RUN(environment_variables_count_only_if_the_host_allows_it);
    RUN(invalid_device_options_are_refused);
    RUN(many_devices_leak_nothing);
    return failed_tests != 0;
}
