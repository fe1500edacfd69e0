/* The Direct3D 12 part that every program has: device, queue, command lists and render targets. */
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

/* Throws std::runtime_error with the call's name and its HRESULT if the call failed. */
void check(HRESULT result, const char *call);

/* Frames that may be recorded or running at the same time. */
constexpr unsigned FRAMES_IN_FLIGHT = 3;

/* A device on an adapter, its direct queue, and command lists for FRAMES_IN_FLIGHT frames. For use by one thread. */
class gpu {
public:
    /* `adapter` is an index; 0 is the fastest adapter. */
    explicit gpu(std::uint32_t adapter);
    ~gpu();
    gpu(const gpu &) = delete;
    gpu &operator=(const gpu &) = delete;

    ID3D12Device *device() const { return device_.Get(); }
    ID3D12CommandQueue *queue() const { return queue_.Get(); }
    IDXGIFactory4 *factory() const { return factory_.Get(); }
    const std::string &name() const { return name_; }

    /* Opens a command list for the next frame, after the frame that used the same slot before has run. */
    ID3D12GraphicsCommandList *begin();
    /* The open list's slot, below FRAMES_IN_FLIGHT: the memory of this slot may be written again. */
    unsigned slot() const { return slot_; }
    /* Closes the list and executes it on the queue. */
    void submit();
    /* Reaches value_of_open_list() when the open list has run. */
    ID3D12Fence *fence() const { return fence_.Get(); }
    std::uint64_t value_of_open_list() const { return submitted_ + 1; }
    /* Waits until the queue has run everything. */
    void wait_idle();

private:
    void wait_for(std::uint64_t value);

    com<IDXGIFactory4> factory_;
    com<ID3D12Device> device_;
    com<ID3D12CommandQueue> queue_;
    com<ID3D12CommandAllocator> allocators_[FRAMES_IN_FLIGHT];
    com<ID3D12GraphicsCommandList> list_;
    com<ID3D12Fence> fence_;
    HANDLE event_ = nullptr;
    std::uint64_t submitted_ = 0, values_[FRAMES_IN_FLIGHT] = {};
    unsigned slot_ = 0;
    std::string name_;
};

/* Waits for the queue at the end of its scope, also when an exception is thrown: objects declared before it are still in use till then. */
class idle_at_exit {
public:
    explicit idle_at_exit(gpu &gpu) : gpu_(gpu) {}
    ~idle_at_exit();
    idle_at_exit(const idle_at_exit &) = delete;
    idle_at_exit &operator=(const idle_at_exit &) = delete;

private:
    gpu &gpu_;
};

/* A window's swap chain in the given format. Its back buffers are in state PRESENT between frames. */
class swapchain {
public:
    /* Throws std::runtime_error if the display does not support the colour space. */
    swapchain(gpu &gpu, HWND window, std::uint32_t width, std::uint32_t height, const frame_format &format);

    /* The back buffer that the next present() shows. */
    ID3D12Resource *target() const { return buffers_[chain_->GetCurrentBackBufferIndex()].Get(); }
    void present(bool vsync);

private:
    com<IDXGISwapChain3> chain_;
    com<ID3D12Resource> buffers_[FRAMES_IN_FLIGHT];
};

/* A render target without a window that can be read back. It is in state COMMON between frames. */
class offscreen {
public:
    offscreen(gpu &gpu, std::uint32_t width, std::uint32_t height, const frame_format &format);

    ID3D12Resource *target() const { return texture_.Get(); }
    /* Records the copy to memory. The texture must be in state COPY_SOURCE, and is in COMMON afterwards. */
    void record_read(ID3D12GraphicsCommandList *list);
    /* Once that list has run, writes the copy to a file of this name; the format decides the ending: .ppm, with 8 or 10 bits, or .pfm. */
    void write(const std::string &name) const;

private:
    const frame_format &format_;
    std::uint32_t width_, height_, pitch_;
    com<ID3D12Resource> texture_, memory_;
};

/* A buffer in an UPLOAD or READBACK heap. */
com<ID3D12Resource> make_buffer(ID3D12Device *device, std::uint64_t size, D3D12_HEAP_TYPE heap);
/* A picture in such a buffer, as source or destination of a copy. */
D3D12_TEXTURE_COPY_LOCATION buffer_location(ID3D12Resource *buffer, DXGI_FORMAT format, std::uint32_t width, std::uint32_t height,
                                            std::uint32_t pitch);
/* A texture, as source or destination of a copy. */
D3D12_TEXTURE_COPY_LOCATION texture_location(ID3D12Resource *texture);
/* Bytes from one row to the next in a buffer: a multiple of 256, as Direct3D 12 requires. */
inline std::uint32_t pitch_of(std::uint32_t width, const frame_format &format) { return (width * format.bytes + 255) / 256 * 256; }
D3D12_RESOURCE_BARRIER transition(ID3D12Resource *resource, D3D12_RESOURCE_STATES before, D3D12_RESOURCE_STATES after);

#endif
