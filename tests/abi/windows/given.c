/* Objects of Direct3D 12 for the hostile programs. */
#define COBJMACROS
#define INITGUID
#define WIN32_LEAN_AND_MEAN
#include <windows.h>

#include <d3d12.h>
#include <dxgi1_4.h>

#include <stdio.h>
#include <stdlib.h>

#include "../given.h"

static void check(HRESULT result, const char *what)
{
    if (SUCCEEDED(result)) return;
    fprintf(stderr, "%s: 0x%08lx\n", what, (unsigned long)result);
    exit(2);
}
#define MADE(call) check(call, #call)

static ID3D12CommandQueue *create_queue(ID3D12Device *device, D3D12_COMMAND_LIST_TYPE type)
{
    D3D12_COMMAND_QUEUE_DESC desc = {.Type = type};
    ID3D12CommandQueue *queue = NULL;
    MADE(ID3D12Device_CreateCommandQueue(device, &desc, &IID_ID3D12CommandQueue, (void **)&queue));
    return queue;
}

void given_create(struct given *given)
{
    static DXGI_SWAP_CHAIN_DESC1 of_window = {.Width = 128, .Height = 72, .Format = DXGI_FORMAT_R8G8B8A8_UNORM,
        .SampleDesc = {1, 0}, .BufferUsage = DXGI_USAGE_RENDER_TARGET_OUTPUT, .BufferCount = 3,
        .SwapEffect = DXGI_SWAP_EFFECT_FLIP_DISCARD};
    static DXGI_SWAP_CHAIN_DESC older;
    ID3D12Device *device = NULL;
    ID3D12CommandAllocator *allocator = NULL;
    MADE(D3D12CreateDevice(NULL, D3D_FEATURE_LEVEL_11_0, &IID_ID3D12Device, (void **)&device));
    D3D12_HEAP_PROPERTIES heap = {.Type = D3D12_HEAP_TYPE_DEFAULT, .CreationNodeMask = 1, .VisibleNodeMask = 1};
    D3D12_RESOURCE_DESC desc = {.Dimension = D3D12_RESOURCE_DIMENSION_TEXTURE2D, .Width = 128, .Height = 72,
        .DepthOrArraySize = 1, .MipLevels = 1, .Format = DXGI_FORMAT_R8G8B8A8_UNORM, .SampleDesc = {1, 0},
        .Flags = D3D12_RESOURCE_FLAG_ALLOW_RENDER_TARGET};
    given->device = device;
    given->queue = create_queue(device, D3D12_COMMAND_LIST_TYPE_DIRECT);
    given->compute = create_queue(device, D3D12_COMMAND_LIST_TYPE_COMPUTE);
    MADE(ID3D12Device_CreateCommittedResource(device, &heap, D3D12_HEAP_FLAG_NONE, &desc, D3D12_RESOURCE_STATE_COMMON,
        NULL, &IID_ID3D12Resource, &given->texture));
    MADE(ID3D12Device_CreateCommandAllocator(device, D3D12_COMMAND_LIST_TYPE_DIRECT, &IID_ID3D12CommandAllocator,
        (void **)&allocator));
    MADE(ID3D12Device_CreateCommandList(device, 0, D3D12_COMMAND_LIST_TYPE_DIRECT, allocator, NULL,
        &IID_ID3D12GraphicsCommandList, &given->list));
    MADE(ID3D12Device_CreateFence(device, 0, D3D12_FENCE_FLAG_NONE, &IID_ID3D12Fence, &given->fence));
    given->fence_value = 1;
    MADE(CreateDXGIFactory1(&IID_IDXGIFactory2, &given->factory));
    given->window = CreateWindowExA(0, "STATIC", "frames", WS_OVERLAPPEDWINDOW, 0, 0, 128, 72, NULL, NULL, NULL, NULL);
    older.BufferDesc.Width = of_window.Width, older.BufferDesc.Height = of_window.Height;
    older.BufferDesc.Format = of_window.Format, older.SampleDesc = of_window.SampleDesc;
    older.BufferUsage = of_window.BufferUsage, older.BufferCount = of_window.BufferCount;
    older.OutputWindow = given->window, older.Windowed = TRUE, older.SwapEffect = of_window.SwapEffect;
    given->window_description = &of_window;
    given->description = &older;
}

void given_end_recordings(struct given *given)
{
    MADE(ID3D12Fence_Signal((ID3D12Fence *)given->fence, given->fence_value));
    given->fence_value++;
}

void given_release(void *object)
{
    IUnknown_Release((IUnknown *)object);
}

void given_wait(void *fence, uint64_t value)
{
    while (ID3D12Fence_GetCompletedValue((ID3D12Fence *)fence) < value) Sleep(1);
}

static unsigned long references(void *object)
{
    IUnknown_AddRef((IUnknown *)object);
    return IUnknown_Release((IUnknown *)object);
}

void given_references(const struct given *given, unsigned long found[2])
{
    found[0] = references(given->device), found[1] = references(given->queue);
}

int given_has_references(const struct given *given, const unsigned long expected[2])
{
    unsigned long found[2] = {0, 0};
    for (int poll = 0; poll < 3000; poll++) {
        given_references(given, found);
        if (found[0] == expected[0] && found[1] == expected[1]) return 1;
        Sleep(10);
    }
    fprintf(stderr, "references to device and queue: %lu and %lu, not %lu and %lu\n", found[0], found[1], expected[0],
        expected[1]);
    return 0;
}
