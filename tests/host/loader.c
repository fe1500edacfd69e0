/* Loads the library that the first argument names with include/cairn_ld.h, makes a step of the world that the second one names, and
   unloads the library, three times. Prints the result of the first load and its message; exits with 1 if a loaded library does not work. */
#include "cairn_ld.h"

static void on_log(uint32_t level, const char *target, const char *message, void *user)
{
    (void)level;
    (void)target;
    (void)message;
    ++*(unsigned *)user;
}

static int use(const cairn_ld *cairn, const char *path)
{
    static unsigned messages;
    static const unsigned char grey[16 * 16 * 4] = {0};
    cairn_device *device = NULL;
    cairn_world *world = NULL;
    cairn_rollout *rollout = NULL;
    cairn_device_info info;
    cairn_device_options tool;
    cairn_world_options options;
    cairn_picture picture;
    cairn_controls controls;
    memset(&info, 0, sizeof info);
    memset(&tool, 0, sizeof tool);
    memset(&options, 0, sizeof options);
    memset(&picture, 0, sizeof picture);
    memset(&controls, 0, sizeof controls);
    info.struct_size = sizeof info;
    tool.struct_size = sizeof tool;
    tool.flags = CAIRN_DEVICE_ENVIRONMENT;
    options.struct_size = sizeof options;
    options.path = path;
    picture.struct_size = sizeof picture;
    picture.width = 16;
    picture.height = 16;
    picture.pixels = grey;
    picture.size = sizeof grey;
    controls.struct_size = sizeof controls;
    cairn_result r = cairn->cairn_set_log_callback(CAIRN_LOG_TRACE, on_log, &messages);
    if (r == CAIRN_OK) r = cairn->cairn_device_create_cpu(&tool, &device);
    if (r == CAIRN_OK) r = cairn->cairn_device_get_info(device, &info);
    if (r == CAIRN_OK) r = cairn->cairn_world_load(device, &options, &world);
    if (r == CAIRN_OK) r = cairn->cairn_rollout_create(world, NULL, &rollout);
    if (r == CAIRN_OK) r = cairn->cairn_rollout_append(rollout, &picture, NULL);
    if (r == CAIRN_OK) r = cairn->cairn_rollout_step(rollout, &controls, NULL);
    if (r == CAIRN_OK) r = cairn->cairn_rollout_destroy(rollout);
    if (r == CAIRN_OK) r = cairn->cairn_world_destroy(world);
    if (r == CAIRN_OK) r = cairn->cairn_device_destroy(device);
    if (r == CAIRN_OK) r = cairn->cairn_set_log_callback(CAIRN_LOG_OFF, NULL, NULL);
    if (r != CAIRN_OK) {
        char text[512];
        cairn->cairn_last_error(text, sizeof text, NULL);
        printf("%s: %s\n", cairn->cairn_result_name(r), text);
    }
    return r == CAIRN_OK && info.kind == CAIRN_DEVICE_CPU;
}

int main(int count, char **arguments)
{
    cairn_ld cairn;
    cairn_ld empty;
    char message[1024];
    char little[8];
    memset(&empty, 0, sizeof empty);
    const char *path = count > 1 && arguments[1][0] != '\0' ? arguments[1] : NULL;
    for (int time = 0; time < 3; time++) {
        memset(&cairn, 0x55, sizeof cairn);
        memset(message, 'x', sizeof message);
        const cairn_result r = cairn_ld_load(&cairn, path, message, sizeof message);
        if (memchr(message, 0, sizeof message) == NULL) {
            puts("the message does not end");
            return 1;
        }
        if (time == 0) {
            printf("%d %s\n", (int)r, message);
        }
        if (r == CAIRN_OK) {
#define CHECK_POINTER(result, name, parameters) \
    if (cairn.name == NULL) {                   \
        puts(#name " is null");                 \
        return 1;                               \
    }
            CAIRN_LD_FUNCTIONS(CHECK_POINTER)
            /* The library has the header's version, so it has the experimental functions too. */
            CAIRN_LD_EXPERIMENTAL(CHECK_POINTER)
            if (!use(&cairn, count > 2 ? arguments[2] : NULL)) {
                return 1;
            }
            cairn_ld_unload(&cairn);
        } else if (message[0] == '\0') {
            puts("a failure without a message");
            return 1;
        }
        cairn_ld_unload(&cairn);
        if (memcmp(&cairn, &empty, sizeof cairn) != 0) {
            puts("what is not loaded is not zero");
            return 1;
        }
    }
    /* Nothing is written beyond a small buffer, and none is needed. */
    memset(little, 'x', sizeof little);
    if (cairn_ld_load(NULL, path, little, 4) != CAIRN_ERROR_INVALID_ARGUMENT || little[3] != '\0' || little[4] != 'x' ||
        cairn_ld_load(NULL, path, NULL, 0) != CAIRN_ERROR_INVALID_ARGUMENT) {
        puts("a small buffer is not kept to");
        return 1;
    }
    cairn_ld_unload(NULL);
    return 0;
}
