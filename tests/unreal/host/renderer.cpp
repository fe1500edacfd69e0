/*
 * The engine's renderer in tests: lists that are filled on one thread and written on another, both beside the game, and barriers that are
 * written down when the engine gets to it. It judges what a plugin does between.
 */
#include "renderer.h"

uint32 FRHIGPUMask::Count = 1;
FDynamicRHI* GDynamicRHI = nullptr;
renderer* engine = nullptr;

static thread_local place here = place::game;
place where_this_runs() { return here; }

void must(HRESULT result, const char* what)
{
    if (FAILED(result)) {
        std::fprintf(stderr, "host: %s: 0x%08lX\n", what, static_cast<unsigned long>(result));
        std::exit(1);
    }
}

/* ---- Threads ----------------------------------------------------------------------------------------------------- */

engine_thread::~engine_thread()
{
    give({});
    WaitForSingleObject(thread_, INFINITE);
    CloseHandle(thread_);
}

uint64 engine_thread::give(std::function<void()> what)
{
    AcquireSRWLockExclusive(&lock_);
    left_.push_back(std::move(what));
    const uint64 number = ++given_;
    ReleaseSRWLockExclusive(&lock_);
    WakeAllConditionVariable(&changed_);
    return number;
}

void engine_thread::wait(uint64 number)
{
    AcquireSRWLockExclusive(&lock_);
    while (done_ < number) SleepConditionVariableSRW(&changed_, &lock_, INFINITE, 0);
    ReleaseSRWLockExclusive(&lock_);
}

DWORD WINAPI engine_thread::run(void* self)
{
    engine_thread& own = *static_cast<engine_thread*>(self);
    here = own.where_;
    for (;;) {
        AcquireSRWLockExclusive(&own.lock_);
        while (own.left_.empty()) SleepConditionVariableSRW(&own.changed_, &own.lock_, INFINITE, 0);
        std::function<void()> what = std::move(own.left_.front());
        own.left_.pop_front();
        ReleaseSRWLockExclusive(&own.lock_);
        if (!what) return 0;
        what();
        // What it held goes before it counts as done.
        what = nullptr;
        AcquireSRWLockExclusive(&own.lock_);
        own.done_++;
        ReleaseSRWLockExclusive(&own.lock_);
        WakeAllConditionVariable(&own.changed_);
    }
}

/* ---- Barriers that others write ---------------------------------------------------------------------------------- */

namespace {

using barrier_call = void(STDMETHODCALLTYPE*)(ID3D12GraphicsCommandList*, UINT, const D3D12_RESOURCE_BARRIER*);

/** Which of ID3D12GraphicsCommandList's functions ResourceBarrier is. */
constexpr std::size_t RESOURCE_BARRIER = 26;
barrier_call written_barrier = nullptr;

void STDMETHODCALLTYPE heard_barrier(ID3D12GraphicsCommandList* list, UINT count, const D3D12_RESOURCE_BARRIER* all)
{
    if (engine != nullptr && list == engine->list()) engine->barriers_came(count, all);
    written_barrier(list, count, all);
}

/** Has all lists of its kind say which barriers come. */
void listen_to(ID3D12GraphicsCommandList* list, barrier_call to)
{
    barrier_call* const slot = *reinterpret_cast<barrier_call**>(list) + RESOURCE_BARRIER;
    DWORD was = 0;
    if (VirtualProtect(slot, sizeof *slot, PAGE_READWRITE, &was) == FALSE) std::exit(1);
    written_barrier = std::exchange(*slot, to);
    VirtualProtect(slot, sizeof *slot, was, &was);
}

} /* namespace */

void renderer::barriers_came(UINT count, const D3D12_RESOURCE_BARRIER* all)
{
    heard_ = true;
    for (UINT i = 0; i < count && lent_ > 0; i++) {
        const bool on_target = named_ != nullptr && all[i].Type == D3D12_RESOURCE_BARRIER_TYPE_TRANSITION &&
                               all[i].Transition.pResource == named_->Resource;
        expect(!on_target, "who is told the state before and after puts no barrier on the target");
    }
}

/* ---- The device and its lists ------------------------------------------------------------------------------------ */

renderer::renderer()
{
    must(D3D12CreateDevice(nullptr, D3D_FEATURE_LEVEL_11_0, IID_PPV_ARGS(&device_.of)), "D3D12CreateDevice");
    D3D12_COMMAND_QUEUE_DESC queue = {};
    queue.Type = D3D12_COMMAND_LIST_TYPE_DIRECT;
    must(device_->CreateCommandQueue(&queue, IID_PPV_ARGS(&queue_.of)), "CreateCommandQueue");
    for (auto& allocator : allocators_) {
        must(device_->CreateCommandAllocator(queue.Type, IID_PPV_ARGS(&allocator.of)), "CreateCommandAllocator");
    }
    must(device_->CreateCommandList(0, queue.Type, allocators_[0].of, nullptr, IID_PPV_ARGS(&list_.of)), "CreateCommandList");
    must(device_->CreateFence(0, D3D12_FENCE_FLAG_NONE, IID_PPV_ARGS(&fence_.of)), "CreateFence");
    done_ = CreateEventW(nullptr, FALSE, FALSE, nullptr);
}

ID3D12Device* renderer::RHIGetDevice(uint32 index) const
{
    expect(index == 0, "there is one graphics card");
    return device_.of;
}

ID3D12Resource* renderer::RHIGetResource(FRHITexture* texture) const
{
    if (here == place::lists) named_ = texture;
    return texture->Resource;
}

#if UE_VERSION_OLDER_THAN(5, 6, 0)
void renderer::RHITransitionResource(FRHICommandList& executing, FRHITexture* texture, D3D12_RESOURCE_STATES state, uint32)
{
    is_written(executing);
    texture->UsedIn = frame_;
    transition(*texture, state);
}
#else
void renderer::RHIFlushResourceBarriers(FRHICommandListBase& executing, uint32)
{
    is_written(executing);
    flush();
}
void renderer::RHIUpdateResourceResidency(FRHICommandListBase& executing, uint32, FRHIResource* resource)
{
    is_written(executing);
    static_cast<FRHITexture*>(resource)->UsedIn = frame_;
}
#endif

void renderer::RHISignalManualFence(FRHICommandList& executing, ID3D12Fence* fence, uint64 value)
{
    is_written(executing);
    expect(FRHIGPUMask::Count == 1, "fences are signalled where there is one graphics card");
    fence->AddRef();
    signals_.emplace_back(fence, value);
}

void renderer::is_written(const FRHICommandListBase& executing) const
{
    expect(here == place::lists && &executing == executing_, "the list that is named is the one that is written, on its thread");
}

ID3D12GraphicsCommandList* renderer::hand_out() const
{
    expect(here == place::lists, "the list is asked for where lists are written");
    expect(barriers_.empty(), "the engine's barriers are written down before somebody else records");
    expect(lent_++ == 0, "a list is lent once");
    return list_.of;
}

void renderer::take_back(ID3D12GraphicsCommandList* list)
{
    expect(list == list_.of && --lent_ == 0, "the list that was lent comes back");
    expect(named_ != nullptr && named_->UsedIn == frame_, "the engine knows of textures that others use");
    expect(named_ != nullptr && named_->State == D3D12_RESOURCE_STATE_COPY_DEST, "the target is in the state that Cairn is told");
    named_ = nullptr;
}

void renderer::transition(FRHITexture& texture, D3D12_RESOURCE_STATES state)
{
    if (texture.State == static_cast<uint32>(state)) return;
    D3D12_RESOURCE_BARRIER barrier = {};
    barrier.Transition.pResource = texture.Resource;
    barrier.Transition.Subresource = D3D12_RESOURCE_BARRIER_ALL_SUBRESOURCES;
    barrier.Transition.StateBefore = static_cast<D3D12_RESOURCE_STATES>(texture.State);
    barrier.Transition.StateAfter = state;
    barriers_.push_back(barrier);
    texture.State = static_cast<uint32>(state);
}

void renderer::flush()
{
    expect(lent_ == 0, "the engine writes nothing while its list is lent");
    if (!barriers_.empty()) list_->ResourceBarrier(static_cast<UINT>(barriers_.size()), barriers_.data());
    barriers_.clear();
}

void renderer::copy(FRHITexture& from, FRHITexture& to)
{
    flush();
    list_->CopyResource(to.Resource, from.Resource);
}

void renderer::submit()
{
    expect(lent_ == 0, "a list that was lent was given back");
    flush();
    must(list_->Close(), "Close");
    ID3D12CommandList* lists[] = {list_.of};
    queue_->ExecuteCommandLists(1, lists);
    for (auto& signal : signals_) {
        must(queue_->Signal(signal.first, signal.second), "Signal");
        signal.first->Release();
    }
    signals_.clear();
    must(queue_->Signal(fence_.of, frame_), "Signal");
    frame_++;
    // As an engine, which is so many frames ahead of its device.
    wait(frame_ - COUNT);
    while (!kept_.empty() && kept_.front().first + COUNT <= frame_) kept_.pop_front();
    auto& next = allocators_[frame_ % COUNT];
    must(next->Reset(), "Reset");
    must(list_->Reset(next.of, nullptr), "Reset");
}

void renderer::wait(uint64 value)
{
    if (value < COUNT || fence_->GetCompletedValue() >= value) return;
    must(fence_->SetEventOnCompletion(value, done_), "SetEventOnCompletion");
    WaitForSingleObject(done_, INFINITE);
    must(device_->GetDeviceRemovedReason(), "the device");
}

/* ---- Frames ------------------------------------------------------------------------------------------------------ */

void renderer::render(std::function<void(FRHICommandListImmediate&)> what)
{
    render_.give([this, what = std::move(what)] { what(filled_); });
}

void renderer::frame()
{
    const uint64 ended = render_.give([this] {
        auto commands = std::exchange(filled_.Commands, {});
        const uint64 given = lists_.give([this, commands = std::move(commands)] {
            FRHICommandListImmediate executing;
            executing_ = &executing;
            for (const auto& command : commands) command(executing);
            executing_ = nullptr;
            submit();
        });
        lists_.wait(std::exchange(written_, given));
    });
    render_.wait(std::exchange(filled_frame_, ended));
}

void renderer::settle()
{
    frame();
    render_.wait(filled_frame_);
    lists_.wait(written_);
}

void renderer::finish()
{
    settle();
    wait(frame_ - 1);
}

void start_renderer()
{
    GDynamicRHI = engine = new renderer;
    listen_to(engine->list(), heard_barrier);
}
void run_frame() { engine->frame(); }
void finish_frames() { engine->finish(); }
void end_renderer()
{
    finish_frames();
    expect(engine->heard_barriers(), "barriers are heard");
    listen_to(engine->list(), written_barrier);
    GDynamicRHI = nullptr;
    delete engine;
    engine = nullptr;
}

void FlushRenderingCommands()
{
    expect(where_this_runs() == place::game, "the game waits for rendering, and nobody else");
    if (engine != nullptr) engine->settle();
}

void FRenderCommands::Add(std::function<void(FRHICommandListImmediate&)> what)
{
    expect(where_this_runs() == place::game, "render commands are given by the game thread");
    engine->render(std::move(what));
}

void FRHICommandListImmediate::CopyTexture(FRHITexture* from, FRHITexture* to, const FRHICopyTextureInfo&)
{
    expect(where_this_runs() == place::render, "the graph's lists are filled on the render thread");
    Commands.push_back([from, to](FRHICommandListImmediate&) { engine->copy(*from, *to); });
}
