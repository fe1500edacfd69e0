/* The host's device and threads, for its render graph and render targets. */
#pragma once

#include "host.h"

#include <deque>

#include <windows.h>

/** The thread that code runs on. */
enum class place { game, render, lists };
place where_this_runs();

/** State of a list that the engine caches. */
enum class list_state { pipeline, root_signature, heaps };

template <class T> struct released {
    T* of = nullptr;
    ~released() { if (of != nullptr) of->Release(); }
    T* operator->() const { return of; }
};

/** Ends the program if a system call fails that never should. */
void must(HRESULT result, const char* what);

/** A thread of the engine that runs its jobs in order. */
class engine_thread {
public:
    explicit engine_thread(place where) : where_(where), thread_(CreateThread(nullptr, 0, run, this, 0, nullptr)) {}
    /** Ends the thread after all jobs are done. */
    ~engine_thread();
    engine_thread(const engine_thread&) = delete;
    /** Adds a job; returns its number, which can be waited for. */
    uint64 give(std::function<void()> what);
    void wait(uint64 number);

private:
    static DWORD WINAPI run(void* self);

    const place where_;
    SRWLOCK lock_ = SRWLOCK_INIT;
    CONDITION_VARIABLE changed_ = CONDITION_VARIABLE_INIT;
    std::deque<std::function<void()>> left_;
    uint64 given_ = 0, done_ = 0;
    const HANDLE thread_;
};

class renderer final : public ID3D12DynamicRHI {
public:
    renderer();

    /* Functions for the plugin. */
    const TCHAR* GetName() override { return L"D3D12"; }
    ID3D12CommandQueue* RHIGetCommandQueue() const override { return queue_.of; }
    ID3D12Device* RHIGetDevice(uint32 index) const override;
    ID3D12Resource* RHIGetResource(FRHITexture* texture) const override;
#if UE_VERSION_OLDER_THAN(5, 5, 0)
    ID3D12GraphicsCommandList* RHIGetGraphicsCommandList(uint32) const override { return hand_out(); }
    void RHIFinishExternalComputeWork(uint32, ID3D12GraphicsCommandList* list) override { take_back(list); }
#else
    ID3D12GraphicsCommandList* RHIGetGraphicsCommandList(FRHICommandListBase& executing, uint32) const override
    {
        is_written(executing);
        return hand_out();
    }
    void RHIFinishExternalComputeWork(FRHICommandListBase& executing, uint32, ID3D12GraphicsCommandList* list) override
    {
        is_written(executing);
        take_back(list);
    }
#endif
#if UE_VERSION_OLDER_THAN(5, 6, 0)
    void RHITransitionResource(FRHICommandList& executing, FRHITexture* texture, D3D12_RESOURCE_STATES state, uint32) override;
#else
    void RHIFlushResourceBarriers(FRHICommandListBase& executing, uint32) override;
    void RHIUpdateResourceResidency(FRHICommandListBase& executing, uint32, FRHIResource* resource) override;
#endif
    void RHISignalManualFence(FRHICommandList& executing, ID3D12Fence* fence, uint64 value) override;

    /* Functions for the engine, on the thread that records lists or while that is idle. */
    void transition(FRHITexture& texture, D3D12_RESOURCE_STATES state);
    void flush();
    void copy(FRHITexture& from, FRHITexture& to);
    /** Keeps an object that this frame's lists use until the device has finished the frame. */
    void keep(std::shared_ptr<void> what) { kept_.emplace_back(frame_, std::move(what)); }
    ID3D12Device* device() const { return device_.of; }
    /** The open list; opens a new one if there is none. */
    ID3D12GraphicsCommandList* list() const;
    /** Barriers were recorded into its list, by the engine or the plugin. */
    void barriers_came(UINT count, const D3D12_RESOURCE_BARRIER* all);
    bool heard_barriers() const { return heard_; }
    /** A pipeline, a compute root signature or descriptor heaps were set in its list, by the engine or the plugin. */
    void state_came(list_state which);
    bool is_recording(ID3D12GraphicsCommandList* list) const { return list_ == list; }

    /* Functions for the game. */
    void render(std::function<void(FRHICommandListImmediate&)> what);
    void frame();
    /** Waits until the other threads are idle. */
    void settle();
    void finish();
    /**
     * Withholds closed lists and signals from the device until `release`, as while a window is minimised or frames are rendered off
     * screen. No thread waits for the device meanwhile.
     */
    void hold() { held_ = true; }
    void release();
    /** Number of its own lists and allocators, each of which holds a reference to the device. */
    std::size_t objects() const { return lists_pool_.size() + allocators_.size(); }

private:
    static constexpr uint64 COUNT = 3;

    /** A closed list, and the fences to signal after it; either may be missing. */
    struct payload {
        ID3D12GraphicsCommandList* list = nullptr;
        std::vector<std::pair<ID3D12Fence*, uint64>> signals;
    };
    struct pooled_list {
        std::unique_ptr<released<ID3D12GraphicsCommandList>> list;
        /** Closed, and not submitted yet. */
        bool is_pending = false;
    };
    struct pooled_allocator {
        std::unique_ptr<released<ID3D12CommandAllocator>> allocator;
        /** The frame that its lists belong to. */
        uint64 frame;
    };

    void is_written(const FRHICommandListBase& executing) const;
    ID3D12GraphicsCommandList* hand_out() const;
    void take_back(ID3D12GraphicsCommandList* list);
    ID3D12CommandAllocator* allocator();
    void close();
    void signal(ID3D12Fence* fence, uint64 value);
    void end_frame();
    void submit();
    void wait(uint64 value);

    released<ID3D12Device> device_;
    released<ID3D12CommandQueue> queue_;
    released<ID3D12Fence> fence_;
    HANDLE done_;

    /* Used on the thread that records lists. */
    uint64 frame_ = COUNT;
    /** The open list; null if there is none. */
    mutable ID3D12GraphicsCommandList* list_ = nullptr;
    std::vector<pooled_list> lists_pool_;
    std::vector<pooled_allocator> allocators_;
    std::vector<payload> payloads_;
    std::vector<D3D12_RESOURCE_BARRIER> barriers_;
    std::deque<std::pair<uint64, std::shared_ptr<void>>> kept_;
    /** State of the open list that a plugin has set and that the engine's cache does not know. */
    bool foreign_state_[3] = {};
    std::atomic<bool> held_{false};
    const FRHICommandListBase* executing_ = nullptr;
    mutable int lent_ = 0;
    mutable FRHITexture* named_ = nullptr;
    bool heard_ = false;

    /* Used on the render thread and by the game. */
    FRHICommandListImmediate filled_;
    uint64 written_ = 0, filled_frame_ = 0;

    /* Members that are destroyed first: the render thread before the list thread that it gives jobs to. */
    engine_thread lists_{place::lists};
    engine_thread render_{place::render};
};

/** The running renderer. */
extern renderer* engine;
