#include "gpu.hpp"

#include <cstdio>
#include <cstring>
#include <stdexcept>
#include <utility>
#include <vector>

void check(HRESULT result, const char *call)
{
    if (SUCCEEDED(result)) return;
    char code[16];
    std::snprintf(code, sizeof code, "0x%08lX", static_cast<unsigned long>(result));
    const bool lost = result == DXGI_ERROR_DEVICE_REMOVED || result == DXGI_ERROR_DEVICE_RESET;
    throw std::runtime_error(std::string(call) + " failed with " + code +
                             (lost ? ": the graphics device is gone. Start again, with a newer driver if it happens again" : ""));
}

/* The adapter with that index among those that support Direct3D 12. */
static com<IDXGIAdapter1> adapter_of(IDXGIFactory4 *factory, std::uint32_t number)
{
    com<IDXGIFactory6> by_speed;
    factory->QueryInterface(IID_PPV_ARGS(&by_speed));
    std::uint32_t found = 0;
    for (UINT i = 0;; i++) {
        com<IDXGIAdapter1> adapter;
        const HRESULT r = by_speed ? by_speed->EnumAdapterByGpuPreference(i, DXGI_GPU_PREFERENCE_HIGH_PERFORMANCE, IID_PPV_ARGS(&adapter))
                                   : factory->EnumAdapters1(i, &adapter);
        if (FAILED(r)) break;
        if (FAILED(D3D12CreateDevice(adapter.Get(), D3D_FEATURE_LEVEL_11_0, __uuidof(ID3D12Device), nullptr))) continue;
        if (found++ == number) return adapter;
    }
    throw std::runtime_error("adapter " + std::to_string(number) + " is not there: Direct3D 12 works on " + std::to_string(found) +
                             ". Give --adapter a smaller number, or update the graphics driver");
}

gpu::gpu(std::uint32_t adapter)
{
    check(CreateDXGIFactory2(0, IID_PPV_ARGS(&factory_)), "CreateDXGIFactory2");
    const com<IDXGIAdapter1> chosen = adapter_of(factory_.Get(), adapter);
    DXGI_ADAPTER_DESC1 about = {};
    chosen->GetDesc1(&about);
    char utf8[512] = "";
    WideCharToMultiByte(CP_UTF8, 0, about.Description, -1, utf8, sizeof utf8 - 1, nullptr, nullptr);
    name_ = utf8;
    check(D3D12CreateDevice(chosen.Get(), D3D_FEATURE_LEVEL_11_0, IID_PPV_ARGS(&device_)), "D3D12CreateDevice");
    D3D12_COMMAND_QUEUE_DESC queue = {};
    queue.Type = D3D12_COMMAND_LIST_TYPE_DIRECT;
    check(device_->CreateCommandQueue(&queue, IID_PPV_ARGS(&queue_)), "ID3D12Device::CreateCommandQueue");
    for (com<ID3D12CommandAllocator> &allocator : allocators_) {
        check(device_->CreateCommandAllocator(queue.Type, IID_PPV_ARGS(&allocator)), "ID3D12Device::CreateCommandAllocator");
    }
    check(device_->CreateCommandList(0, queue.Type, allocators_[0].Get(), nullptr, IID_PPV_ARGS(&list_)),
           "ID3D12Device::CreateCommandList");
    check(list_->Close(), "ID3D12GraphicsCommandList::Close");
    check(device_->CreateFence(0, D3D12_FENCE_FLAG_NONE, IID_PPV_ARGS(&fence_)), "ID3D12Device::CreateFence");
    event_ = CreateEventW(nullptr, FALSE, FALSE, nullptr);
}

gpu::~gpu()
{
    {
        const idle_at_exit wait(*this);
    }
    CloseHandle(event_);
}

idle_at_exit::~idle_at_exit()
{
    try {
        gpu_.wait_idle();
    } catch (const std::exception &) {
        /* The device was removed, so nothing runs on it any more. */
    }
}

ID3D12GraphicsCommandList *gpu::begin()
{
    slot_ = (slot_ + 1) % FRAMES_IN_FLIGHT;
    wait_for(values_[slot_]);
    check(allocators_[slot_]->Reset(), "ID3D12CommandAllocator::Reset");
    check(list_->Reset(allocators_[slot_].Get(), nullptr), "ID3D12GraphicsCommandList::Reset");
    return list_.Get();
}

void gpu::submit()
{
    check(list_->Close(), "ID3D12GraphicsCommandList::Close");
    ID3D12CommandList *lists[] = {list_.Get()};
    queue_->ExecuteCommandLists(1, lists);
    values_[slot_] = ++submitted_;
    check(queue_->Signal(fence_.Get(), submitted_), "ID3D12CommandQueue::Signal");
}

void gpu::wait_idle()
{
    check(queue_->Signal(fence_.Get(), ++submitted_), "ID3D12CommandQueue::Signal");
    wait_for(submitted_);
}

void gpu::wait_for(std::uint64_t value)
{
    if (fence_->GetCompletedValue() >= value) return;
    check(fence_->SetEventOnCompletion(value, event_), "ID3D12Fence::SetEventOnCompletion");
    WaitForSingleObject(event_, INFINITE);
    check(device_->GetDeviceRemovedReason(), "ID3D12Device");
}

swapchain::swapchain(gpu &gpu, HWND window, std::uint32_t width, std::uint32_t height, const frame_format &format)
{
    DXGI_SWAP_CHAIN_DESC1 wanted = {};
    wanted.Width = width;
    wanted.Height = height;
    wanted.Format = format.format;
    wanted.SampleDesc.Count = 1;
    wanted.BufferUsage = DXGI_USAGE_RENDER_TARGET_OUTPUT;
    wanted.BufferCount = FRAMES_IN_FLIGHT;
    /* Frames are scaled to the window's size. */
    wanted.Scaling = DXGI_SCALING_STRETCH;
    wanted.SwapEffect = DXGI_SWAP_EFFECT_FLIP_DISCARD;
    com<IDXGISwapChain1> chain;
    check(gpu.factory()->CreateSwapChainForHwnd(gpu.queue(), window, &wanted, nullptr, nullptr, &chain),
           "IDXGIFactory4::CreateSwapChainForHwnd");
    check(chain.As(&chain_), "IDXGISwapChain3");
    /* Alt+Enter would make DXGI enter full screen, after which the buffers must be resized before the next Present. */
    check(gpu.factory()->MakeWindowAssociation(window, DXGI_MWA_NO_ALT_ENTER), "IDXGIFactory::MakeWindowAssociation");
    if (format.format != DXGI_FORMAT_R8G8B8A8_UNORM) {
        UINT support = 0;
        const HRESULT asked = chain_->CheckColorSpaceSupport(format.display, &support);
        if (FAILED(asked) || (support & DXGI_SWAP_CHAIN_COLOR_SPACE_SUPPORT_FLAG_PRESENT) == 0) {
            throw std::runtime_error(std::string("this display does not show ") + format.name +
                                     ". Turn HDR on in the system's display settings, or leave --colours out");
        }
        check(chain_->SetColorSpace1(format.display), "IDXGISwapChain3::SetColorSpace1");
    }
    for (unsigned i = 0; i < FRAMES_IN_FLIGHT; i++) {
        check(chain_->GetBuffer(i, IID_PPV_ARGS(&buffers_[i])), "IDXGISwapChain::GetBuffer");
    }
}

void swapchain::present(bool vsync) { check(chain_->Present(vsync ? 1 : 0, 0), "IDXGISwapChain::Present"); }

offscreen::offscreen(gpu &gpu, std::uint32_t width, std::uint32_t height, const frame_format &format)
    : format_(format), width_(width), height_(height), pitch_(pitch_of(width, format))
{
    D3D12_HEAP_PROPERTIES heap = {};
    heap.Type = D3D12_HEAP_TYPE_DEFAULT;
    D3D12_RESOURCE_DESC texture = {};
    texture.Dimension = D3D12_RESOURCE_DIMENSION_TEXTURE2D;
    texture.Width = width;
    texture.Height = height;
    texture.DepthOrArraySize = 1;
    texture.MipLevels = 1;
    texture.Format = format.format;
    texture.SampleDesc.Count = 1;
    /* As for a swap chain's buffers. */
    texture.Flags = D3D12_RESOURCE_FLAG_ALLOW_RENDER_TARGET;
    check(gpu.device()->CreateCommittedResource(&heap, D3D12_HEAP_FLAG_NONE, &texture, D3D12_RESOURCE_STATE_COMMON, nullptr,
                                                 IID_PPV_ARGS(&texture_)),
           "ID3D12Device::CreateCommittedResource");
    memory_ = make_buffer(gpu.device(), std::uint64_t{pitch_} * height, D3D12_HEAP_TYPE_READBACK);
}

void offscreen::record_read(ID3D12GraphicsCommandList *list)
{
    const D3D12_TEXTURE_COPY_LOCATION to = buffer_location(memory_.Get(), format_.format, width_, height_, pitch_), from = texture_location(texture_.Get());
    list->CopyTextureRegion(&to, 0, 0, 0, &from, nullptr);
    const D3D12_RESOURCE_BARRIER back = transition(texture_.Get(), D3D12_RESOURCE_STATE_COPY_SOURCE, D3D12_RESOURCE_STATE_COMMON);
    list->ResourceBarrier(1, &back);
}

void offscreen::write(const std::string &name) const
{
    /* Without the padding of the rows. */
    const std::size_t row = std::size_t{width_} * format_.bytes;
    std::vector<unsigned char> pixels(row * height_);
    void *bytes = nullptr;
    check(memory_->Map(0, nullptr, &bytes), "ID3D12Resource::Map");
    for (std::size_t y = 0; y < height_; y++) std::memcpy(&pixels[y * row], static_cast<unsigned char *>(bytes) + y * pitch_, row);
    const D3D12_RANGE nothing = {0, 0};
    memory_->Unmap(0, &nothing);
    switch (format_.format) {
    case DXGI_FORMAT_R10G10B10A2_UNORM: write_ppm_of_ten(name + ".ppm", width_, height_, pixels); break;
    case DXGI_FORMAT_R16G16B16A16_FLOAT: write_pfm(name + ".pfm", width_, height_, pixels); break;
    default: {
        image made(width_, height_);
        made.rgba = std::move(pixels);
        write_ppm(name + ".ppm", made);
    }
    }
}

com<ID3D12Resource> make_buffer(ID3D12Device *device, std::uint64_t size, D3D12_HEAP_TYPE kind)
{
    D3D12_HEAP_PROPERTIES heap = {};
    heap.Type = kind;
    D3D12_RESOURCE_DESC buffer = {};
    buffer.Dimension = D3D12_RESOURCE_DIMENSION_BUFFER;
    buffer.Width = size;
    buffer.Height = 1;
    buffer.DepthOrArraySize = 1;
    buffer.MipLevels = 1;
    buffer.SampleDesc.Count = 1;
    buffer.Layout = D3D12_TEXTURE_LAYOUT_ROW_MAJOR;
    const D3D12_RESOURCE_STATES state =
        kind == D3D12_HEAP_TYPE_UPLOAD ? D3D12_RESOURCE_STATE_GENERIC_READ : D3D12_RESOURCE_STATE_COPY_DEST;
    com<ID3D12Resource> made;
    check(device->CreateCommittedResource(&heap, D3D12_HEAP_FLAG_NONE, &buffer, state, nullptr, IID_PPV_ARGS(&made)),
           "ID3D12Device::CreateCommittedResource");
    return made;
}

D3D12_TEXTURE_COPY_LOCATION buffer_location(ID3D12Resource *buffer, DXGI_FORMAT format, std::uint32_t width, std::uint32_t height,
                                            std::uint32_t pitch)
{
    D3D12_TEXTURE_COPY_LOCATION location = {};
    location.pResource = buffer;
    location.Type = D3D12_TEXTURE_COPY_TYPE_PLACED_FOOTPRINT;
    location.PlacedFootprint.Footprint = {format, width, height, 1, pitch};
    return location;
}

D3D12_TEXTURE_COPY_LOCATION texture_location(ID3D12Resource *texture)
{
    D3D12_TEXTURE_COPY_LOCATION location = {};
    location.pResource = texture;
    location.Type = D3D12_TEXTURE_COPY_TYPE_SUBRESOURCE_INDEX;
    return location;
}

D3D12_RESOURCE_BARRIER transition(ID3D12Resource *resource, D3D12_RESOURCE_STATES before, D3D12_RESOURCE_STATES after)
{
    D3D12_RESOURCE_BARRIER barrier = {};
    barrier.Type = D3D12_RESOURCE_BARRIER_TYPE_TRANSITION;
    barrier.Transition.pResource = resource;
    barrier.Transition.Subresource = D3D12_RESOURCE_BARRIER_ALL_SUBRESOURCES;
    barrier.Transition.StateBefore = before;
    barrier.Transition.StateAfter = after;
    return barrier;
}
