/* Direct3D 12 functions on other systems: each returns CAIRN_ERROR_UNSUPPORTED or an argument error, and writes no result. */
#include "check.h"

/* The value that results must still have after a call that fails. */
#define UNTOUCHED ((void *)8)

static void functions_are_unsupported_and_write_no_result(void)
{
    cairn_device *cpu = make_device(), *device = UNTOUCHED;
    ID3D12Device *d3d12 = UNTOUCHED;
    ID3D12CommandQueue *queue = UNTOUCHED;
    ID3D12Resource *texture = UNTOUCHED;
    ID3D12Fence *fence = UNTOUCHED;
    uint64_t value = 8;
    ANSWERS(CAIRN_ERROR_UNSUPPORTED, cairn_device_create_d3d12(d3d12, queue, NULL, NULL, &device));
    CHECK(strstr(message(), "Direct3D 12"));
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_device_create_d3d12(NULL, queue, NULL, NULL, &device));
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_device_create_d3d12(d3d12, NULL, NULL, NULL, &device));
    ANSWERS(CAIRN_ERROR_UNSUPPORTED, cairn_device_create_adapter(0, NULL, &device));
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_device_create_adapter(0, NULL, NULL));
    cairn_device_options wrong = {.struct_size = sizeof wrong, .flags = 4};
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_device_create_d3d12(d3d12, queue, NULL, &wrong, &device));
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_device_create_adapter(0, &wrong, &device));
    ANSWERS(CAIRN_ERROR_UNSUPPORTED, cairn_device_get_d3d12(cpu, &d3d12, &queue));
    ANSWERS(CAIRN_ERROR_INVALID_HANDLE, cairn_device_get_d3d12(NULL, &d3d12, &queue));
    cairn_d3d12_options options = {.struct_size = sizeof options, .captured_passes = 16, .longest_submission_us = 4000};
    ANSWERS(CAIRN_ERROR_UNSUPPORTED, cairn_device_set_d3d12(cpu, &options));
    ANSWERS(CAIRN_ERROR_INVALID_HANDLE, cairn_device_set_d3d12(NULL, &options));
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_device_set_d3d12(cpu, NULL));
    options.flags = 2;
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_device_set_d3d12(cpu, &options));
    options = (cairn_d3d12_options){.struct_size = sizeof options - 1};
    ANSWERS(CAIRN_ERROR_STRUCT_SIZE, cairn_device_set_d3d12(cpu, &options));

    unsigned char pixel[4] = {0};
    cairn_picture picture = {.struct_size = sizeof picture, .width = 1, .height = 1, .pixels = pixel, .size = 4};
    cairn_anchor *anchor = NULL;
    OK(cairn_anchor_create(&picture, 0, 0, &anchor));
    ANSWERS(CAIRN_ERROR_UNSUPPORTED, cairn_anchor_get_d3d12(anchor, 0, &texture, &fence, &value));
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_anchor_get_d3d12(anchor, 1, &texture, &fence, &value));
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_anchor_get_d3d12(anchor, 0, &texture, &fence, NULL));
    cairn_presenter *presenter = NULL;
    OK(cairn_presenter_create(NULL, &presenter));
    cairn_d3d12_recording recording = {.struct_size = sizeof recording, .list = UNTOUCHED, .target = texture, .fence = fence,
                                       .fence_value = 1};
    ANSWERS(CAIRN_ERROR_UNSUPPORTED, cairn_presenter_record_d3d12(presenter, cpu, 0, &recording, NULL));
    ANSWERS(CAIRN_ERROR_INVALID_HANDLE, cairn_presenter_record_d3d12(presenter, NULL, 0, &recording, NULL));
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_presenter_record_d3d12(presenter, cpu, 0, NULL, NULL));
    recording.list = NULL;
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_presenter_record_d3d12(presenter, cpu, 0, &recording, NULL));
    recording.list = UNTOUCHED;
    recording.target = NULL;
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_presenter_record_d3d12(presenter, cpu, 0, &recording, NULL));
    recording.target = texture;
    recording.fence = NULL;
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_presenter_record_d3d12(presenter, cpu, 0, &recording, NULL));
    CHECK(strstr(message(), "fence") && strstr(message(), "cairn_presenter_submit_d3d12"));
    recording.fence = fence;
    recording.struct_size--;
    ANSWERS(CAIRN_ERROR_STRUCT_SIZE, cairn_presenter_record_d3d12(presenter, cpu, 0, &recording, NULL));
    cairn_d3d12_preparation wanted = {.struct_size = sizeof wanted, .anchor_width = 64, .anchor_height = 32};
    ANSWERS(CAIRN_ERROR_UNSUPPORTED, cairn_presenter_prepare_d3d12(presenter, cpu, &wanted));
    ANSWERS(CAIRN_ERROR_INVALID_HANDLE, cairn_presenter_prepare_d3d12(NULL, cpu, &wanted));
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_presenter_prepare_d3d12(presenter, cpu, NULL));
    wanted.lists = CAIRN_MAX_LISTS + 1;
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_presenter_prepare_d3d12(presenter, cpu, &wanted));
    wanted.lists = CAIRN_MAX_LISTS;
    wanted.anchor_height = 0;
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_presenter_prepare_d3d12(presenter, cpu, &wanted));
    wanted.anchor_height = 16385;
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_presenter_prepare_d3d12(presenter, cpu, &wanted));
    wanted.anchor_height = 32;
    wanted.flags = 2;
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_presenter_prepare_d3d12(presenter, cpu, &wanted));
    ANSWERS(CAIRN_ERROR_UNSUPPORTED, cairn_presenter_submit_d3d12(presenter, cpu, 0, texture, 0, 0, NULL, &fence, &value));
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_presenter_submit_d3d12(presenter, cpu, 0, NULL, 0, 0, NULL, &fence, &value));
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_presenter_submit_d3d12(presenter, cpu, 0, texture, 0, 0, NULL, NULL, &value));
    ANSWERS(CAIRN_ERROR_UNSUPPORTED, cairn_presenter_release_d3d12(presenter));
    ANSWERS(CAIRN_ERROR_INVALID_HANDLE, cairn_rollout_append_d3d12(NULL, texture, 0, NULL));
    OK(cairn_presenter_destroy(presenter));
    OK(cairn_anchor_destroy(anchor));
    OK(cairn_device_destroy(cpu));
    CHECK(device == UNTOUCHED && d3d12 == UNTOUCHED && queue == UNTOUCHED && texture == UNTOUCHED);
    CHECK(fence == UNTOUCHED && value == 8);
}

int main(void)
{
    RUN(functions_are_unsupported_and_write_no_result);
    return failed_tests != 0;
}
