/*
 * A test double of the native plugin, for the components on Linux: its device is the processor, and its views show nothing. Linked with the
 * library, whose path it gives to the scripts.
 */
#define _GNU_SOURCE
#include "cairn.h"

#include <dlfcn.h>
#include <stdlib.h>
#include <string.h>

typedef struct cairn_unity_view {
    uint64_t events;
} cairn_unity_view;

uint32_t cairn_unity_version(void);
cairn_result cairn_unity_state(char *text, size_t capacity, size_t *length);
cairn_result cairn_unity_path(char *text, size_t capacity, size_t *length);
cairn_result cairn_unity_create_device(cairn_device **device);
cairn_result cairn_unity_prepare(const cairn_device *device, const cairn_presenter *presenter, uint32_t width, uint32_t height,
                                 uint32_t anchor_width, uint32_t anchor_height, const char *pipelines);
cairn_result cairn_unity_view_create(const cairn_device *device, cairn_presenter *presenter, cairn_unity_view **view);
cairn_result cairn_unity_view_set(cairn_unity_view *view, uint64_t now_ns, void *texture);
cairn_result cairn_unity_view_get(const cairn_unity_view *view, uint64_t *shown, cairn_frame *frame, char *text, size_t capacity,
                                  size_t *length);
cairn_result cairn_unity_view_destroy(cairn_unity_view *view);
void *cairn_unity_get_event_function(void);
int cairn_unity_get_make_event(void);
int cairn_unity_get_show_event(void);

static void copy(const char *from, char *text, size_t capacity, size_t *length)
{
    const size_t size = strlen(from);
    if (length != NULL) *length = size;
    if (text == NULL || capacity == 0) return;
    const size_t part = size < capacity ? size : capacity - 1;
    memcpy(text, from, part);
    text[part] = 0;
}

/* The version that the scripts ask for. */
uint32_t cairn_unity_version(void)
{
    return 4;
}

cairn_result cairn_unity_state(char *text, size_t capacity, size_t *length)
{
    copy("a test double", text, capacity, length);
    return CAIRN_OK;
}

cairn_result cairn_unity_path(char *text, size_t capacity, size_t *length)
{
    Dl_info info;
    /* Through an object pointer's type, because ISO C converts no function pointer. */
    uint32_t (*const function)(void) = cairn_version;
    void *address;
    memcpy(&address, &function, sizeof address);
    if (dladdr(address, &info) == 0) return CAIRN_ERROR_UNSUPPORTED;
    copy(info.dli_fname, text, capacity, length);
    return CAIRN_OK;
}

cairn_result cairn_unity_create_device(cairn_device **device)
{
    return cairn_device_create_cpu(NULL, device);
}

/* Without the anchors' size the plugin would find nothing to prepare for. */
cairn_result cairn_unity_prepare(const cairn_device *device, const cairn_presenter *presenter, uint32_t width, uint32_t height,
                                 uint32_t anchor_width, uint32_t anchor_height, const char *pipelines)
{
    (void)device, (void)presenter, (void)width, (void)height, (void)pipelines;
    return anchor_width > 0 && anchor_height > 0 ? CAIRN_OK : CAIRN_ERROR_INVALID_ARGUMENT;
}

cairn_result cairn_unity_view_create(const cairn_device *device, cairn_presenter *presenter, cairn_unity_view **view)
{
    (void)device, (void)presenter;
    *view = calloc(1, sizeof **view);
    return *view != NULL ? CAIRN_OK : CAIRN_ERROR_OUT_OF_MEMORY;
}

cairn_result cairn_unity_view_set(cairn_unity_view *view, uint64_t now_ns, void *texture)
{
    (void)view, (void)now_ns, (void)texture;
    return CAIRN_OK;
}

cairn_result cairn_unity_view_get(const cairn_unity_view *view, uint64_t *shown, cairn_frame *frame, char *text, size_t capacity,
                                  size_t *length)
{
    (void)frame;
    *shown = view->events;
    copy("", text, capacity, length);
    return CAIRN_OK;
}

cairn_result cairn_unity_view_destroy(cairn_unity_view *view)
{
    free(view);
    return CAIRN_OK;
}

void *cairn_unity_get_event_function(void)
{
    return NULL;
}

int cairn_unity_get_make_event(void)
{
    return 1;
}

int cairn_unity_get_show_event(void)
{
    return 2;
}
