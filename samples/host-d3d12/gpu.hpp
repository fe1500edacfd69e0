/* What every program on Direct3D 12 has: device, queue, command lists, and something to draw into. */
#ifndef HOST_D3D12_GPU_HPP
#define HOST_D3D12_GPU_HPP

#include "colours.hpp"
#include "pictures.hpp"

#include <cstdint>
#include <string>

#include <d3d12.h>
#include <dxgi1_6.h>
#include <wrl/client.h>

template <class T> using com = Microsoft::WRL::ComPtr<T>;

/* Throws std::runtime_error with the call and its HRESULT where a call failed. */
void worked(HRESULT result, const char *call);

/* Frames that are recorded or run at the same time. */
constexpr unsigned FRAMES_IN_FLIGHT = 3;

/* A device of an adapter, its direct queue, and command lists for a few frames at a time. For one thread. */
class gpu {
public:
    /* `adapter` counts from the fastest. */
    explicit gpu(std::uint32_t adapter);
    ~gpu();
    gpu(const gpu &) = delete;
    gpu &operator=(const gpu &) = delete;

    ID3D12Device *device() const { return device_.Get(); }
    ID3D12CommandQueue *queue() const { return queue_.Get(); }
    IDXGIFactory4 *factory() const { return factory_.Get(); }
    const std::string &name() const { return name_; }

    /* Opens the next frame's command list, after what it was used for last has run. */
    ID3D12GraphicsCommandList *begin();
    /* Which of FRAMES_IN_FLIGHT the open list belongs to: what is the frame's own may be written again. */
    unsigned slot() const { return slot_; }
    /* Closes the list and gives it to the queue. */
    void submit();
    /* Has the value of the open list once that has run. */
    ID3D12Fence *fence() const { return fence_.Get(); }
    std::uint64_t value_of_open_list() const { return submitted_ + 1; }
    /* Waits until everything has run. */
    void wait_idle();

private:
    void wait_for(std::uint64_t value);

    com<IDXGIFactory4> factory_;
    com<ID3D12Device> device_;
    com<ID3D12CommandQueue> queue_;
    com<ID3D12CommandAllocator> allocators_[FRAMES_IN_FLIGHT];
    com<ID3D12GraphicsCommandList> list_;
    com<ID3D12Fence> fence_;
    HANDLE reached_ = nullptr;
    std::uint64_t submitted_ = 0, values_[FRAMES_IN_FLIGHT] = {};
    unsigned slot_ = 0;
    std::string name_;
};

/* Waits until everything has run before what it uses ends: what is made before this object, also where something is thrown. */
class settled {
public:
    explicit settled(gpu &gpu) : gpu_(gpu) {}
    ~settled();
    settled(const settled &) = delete;
    settled &operator=(const settled &) = delete;

private:
    gpu &gpu_;
};

/* Back buffers of a window, of the colours that are asked for, in state PRESENT between frames. */
class swapchain {
public:
    /* Throws std::runtime_error where the display does not show these colours. */
    swapchain(gpu &gpu, HWND window, std::uint32_t width, std::uint32_t height, const frame_format &format);

    /* The one that the next present() shows. */
    ID3D12Resource *target() const { return buffers_[chain_->GetCurrentBackBufferIndex()].Get(); }
    void present(bool vsync);

private:
    com<IDXGISwapChain3> chain_;
    com<ID3D12Resource> buffers_[FRAMES_IN_FLIGHT];
};

/* A texture to draw into where there is no window, in state COMMON between frames; it can be read. */
class offscreen {
public:
    offscreen(gpu &gpu, std::uint32_t width, std::uint32_t height, const frame_format &format);

    ID3D12Resource *target() const { return texture_.Get(); }
    /* Records the copy of what was drawn; the texture is in state COPY_SOURCE, and is COMMON afterwards. */
    void record_read(ID3D12GraphicsCommandList *list);
    /* Writes what was copied, once the list has run, as a file of this name and the ending that its format has: .ppm, with 8 or 10 bits, or
     * .pfm. */
    void write(const std::string &name) const;

private:
    const frame_format &format_;
    std::uint32_t width_, height_, pitch_;
    com<ID3D12Resource> texture_, memory_;
};

/* A buffer in memory that both sides see: UPLOAD or READBACK. */
com<ID3D12Resource> make_buffer(ID3D12Device *device, std::uint64_t size, D3D12_HEAP_TYPE heap);
/* Where rows of pixels lie in such a buffer. */
D3D12_TEXTURE_COPY_LOCATION rows_of(ID3D12Resource *buffer, DXGI_FORMAT format, std::uint32_t width, std::uint32_t height,
                                    std::uint32_t pitch);
D3D12_TEXTURE_COPY_LOCATION picture_of(ID3D12Resource *texture);
/* A row's bytes as copies want them: a multiple of 256. */
inline std::uint32_t pitch_of(std::uint32_t width, const frame_format &format) { return (width * format.bytes + 255) / 256 * 256; }
D3D12_RESOURCE_BARRIER transition(ID3D12Resource *resource, D3D12_RESOURCE_STATES before, D3D12_RESOURCE_STATES after);

#endif
