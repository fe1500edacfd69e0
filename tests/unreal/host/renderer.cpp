/*
 * The engine's renderer in tests: one thread fills command lists and another records them, both in parallel with the game, and barriers
 * are recorded late. It checks the plugin's use of the lists.
 */
#include "renderer.h"

uint32 FRHIGPUMask::Count = 1;
FDynamicRHI* GDynamicRHI = nullptr;
renderer* engine = nullptr;

/** Time limit for a thread's frame. */
static constexpr DWORD PATIENCE_MS = 300000;
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
    while (done_ < number) {
        if (SleepConditionVariableSRW(&changed_, &lock_, PATIENCE_MS, 0) != FALSE) continue;
        std::fprintf(stderr, "host: a thread of the engine does not come back: somebody waits in it\n");
        std::exit(1);
    }
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
        // Releases the captures before the job counts as done.
        what = nullptr;
        AcquireSRWLockExclusive(&own.lock_);
        own.done_++;
        ReleaseSRWLockExclusive(&own.lock_);
        WakeAllConditionVariable(&own.changed_);
    }
}

/* ---- Commands that the plugin records ---------------------------------------------------------------------------- */

namespace {

/** Indices in ID3D12GraphicsCommandList's table of functions. */
enum list_function : std::size_t { SET_PIPELINE = 25, RESOURCE_BARRIER = 26, SET_HEAPS = 28, SET_ROOT_SIGNATURE = 29 };

using barrier_call = void(STDMETHODCALLTYPE*)(ID3D12GraphicsCommandList*, UINT, const D3D12_RESOURCE_BARRIER*);
using pipeline_call = void(STDMETHODCALLTYPE*)(ID3D12GraphicsCommandList*, ID3D12PipelineState*);
using heaps_call = void(STDMETHODCALLTYPE*)(ID3D12GraphicsCommandList*, UINT, ID3D12DescriptorHeap* const*);
using root_call = void(STDMETHODCALLTYPE*)(ID3D12GraphicsCommandList*, ID3D12RootSignature*);

barrier_call system_barrier = nullptr;
pipeline_call system_pipeline = nullptr;
heaps_call system_heaps = nullptr;
root_call system_root = nullptr;

bool is_engines(ID3D12GraphicsCommandList* list) { return engine != nullptr && engine->is_recording(list); }

void STDMETHODCALLTYPE heard_barrier(ID3D12GraphicsCommandList* list, UINT count, const D3D12_RESOURCE_BARRIER* all)
{
    if (is_engines(list)) engine->barriers_came(count, all);
    system_barrier(list, count, all);
}

void STDMETHODCALLTYPE heard_pipeline(ID3D12GraphicsCommandList* list, ID3D12PipelineState* pipeline)
{
    if (is_engines(list)) engine->state_came(list_state::pipeline);
    system_pipeline(list, pipeline);
}

void STDMETHODCALLTYPE heard_heaps(ID3D12GraphicsCommandList* list, UINT count, ID3D12DescriptorHeap* const* heaps)
{
    if (is_engines(list)) engine->state_came(list_state::heaps);
    system_heaps(list, count, heaps);
}

void STDMETHODCALLTYPE heard_root(ID3D12GraphicsCommandList* list, ID3D12RootSignature* signature)
{
    if (is_engines(list)) engine->state_came(list_state::root_signature);
    system_root(list, signature);
}

/** Replaces a function in the table that all lists of the kind share; the former one goes into `was`. */
template <class Call> void replace(ID3D12GraphicsCommandList* list, list_function which, Call by, Call& was)
{
    Call* const slot = reinterpret_cast<Call*>(*reinterpret_cast<void***>(list) + which);
    DWORD protection = 0;
    if (VirtualProtect(slot, sizeof *slot, PAGE_READWRITE, &protection) == FALSE) std::exit(1);
    was = std::exchange(*slot, by);
    VirtualProtect(slot, sizeof *slot, protection, &protection);
}

void listen_to(ID3D12GraphicsCommandList* list)
{
    replace(list, RESOURCE_BARRIER, &heard_barrier, system_barrier);
    replace(list, SET_PIPELINE, &heard_pipeline, system_pipeline);
    replace(list, SET_HEAPS, &heard_heaps, system_heaps);
    replace(list, SET_ROOT_SIGNATURE, &heard_root, system_root);
}

void stop_listening_to(ID3D12GraphicsCommandList* list)
{
    barrier_call barrier = nullptr;
    pipeline_call pipeline = nullptr;
    heaps_call heaps = nullptr;
    root_call root = nullptr;
    replace(list, RESOURCE_BARRIER, system_barrier, barrier);
    replace(list, SET_PIPELINE, system_pipeline, pipeline);
    replace(list, SET_HEAPS, system_heaps, heaps);
    replace(list, SET_ROOT_SIGNATURE, system_root, root);
}

} /* namespace */

void renderer::state_came(list_state which)
{
    if (lent_ > 0) foreign_state_[static_cast<int>(which)] = true;
}

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
    // The engine closes the list without checking whether it is lent.
    lent_ = 0;
    close();
    signal(fence, value);
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
    return list();
}

void renderer::take_back(ID3D12GraphicsCommandList* list)
{
    // The engine asserts this: a signal in between would have closed that list and made another one current.
    expect(list == this->list() && --lent_ == 0, "the list that comes back is the one that is current");
    // The engine marks root signature and heaps as unknown and sets them again, but not the pipeline that it last set.
    foreign_state_[static_cast<int>(list_state::root_signature)] = false;
    foreign_state_[static_cast<int>(list_state::heaps)] = false;
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
    if (!barriers_.empty()) list()->ResourceBarrier(static_cast<UINT>(barriers_.size()), barriers_.data());
    barriers_.clear();
}

void renderer::copy(FRHITexture& from, FRHITexture& to)
{
    flush();
    list()->CopyResource(to.Resource, from.Resource);
}

/** The frame's allocator, which all lists of the frame use one after the other. */
ID3D12CommandAllocator* renderer::allocator()
{
    const uint64 done = fence_->GetCompletedValue();
    pooled_allocator* found = nullptr;
    for (pooled_allocator& one : allocators_) {
        if (one.frame == frame_) return one.allocator->of;
        if (one.frame <= done) found = &one;
    }
    if (found == nullptr) {
        allocators_.push_back({std::make_unique<released<ID3D12CommandAllocator>>(), 0});
        found = &allocators_.back();
        must(device_->CreateCommandAllocator(D3D12_COMMAND_LIST_TYPE_DIRECT, IID_PPV_ARGS(&found->allocator->of)), "CreateCommandAllocator");
    } else {
        must(found->allocator->of->Reset(), "Reset");
    }
    found->frame = frame_;
    return found->allocator->of;
}

ID3D12GraphicsCommandList* renderer::list() const
{
    if (list_ != nullptr) return list_;
    renderer& self = *const_cast<renderer*>(this);
    ID3D12CommandAllocator* const memory = self.allocator();
    for (const pooled_list& one : lists_pool_) {
        if (one.is_pending) continue;
        list_ = one.list->of;
        must(list_->Reset(memory, nullptr), "Reset");
        return list_;
    }
    self.lists_pool_.push_back({std::make_unique<released<ID3D12GraphicsCommandList>>(), false});
    ID3D12GraphicsCommandList*& made = self.lists_pool_.back().list->of;
    must(device_->CreateCommandList(0, D3D12_COMMAND_LIST_TYPE_DIRECT, memory, nullptr, IID_PPV_ARGS(&made)), "CreateCommandList");
    return list_ = made;
}

/** Records pending barriers and closes the list. The next one starts without state. */
void renderer::close()
{
    if (list_ == nullptr && barriers_.empty()) return;
    flush();
    must(list_->Close(), "Close");
    for (pooled_list& one : lists_pool_) one.is_pending |= one.list->of == list_;
    payloads_.push_back({std::exchange(list_, nullptr), {}});
    for (bool& foreign : foreign_state_) foreign = false;
}

void renderer::signal(ID3D12Fence* fence, uint64 value)
{
    if (payloads_.empty()) payloads_.emplace_back();
    fence->AddRef();
    payloads_.back().signals.emplace_back(fence, value);
}

void renderer::end_frame()
{
    expect(lent_ == 0, "a list that was lent was given back");
    // The engine's next dispatch in this list sets only state that it believes to have changed.
    for (const bool foreign : foreign_state_) expect(!foreign, "the engine knows what state its list has");
    close();
    signal(fence_.of, frame_);
    frame_++;
    if (held_) return;
    submit();
    // As in an engine, the processor is at most COUNT frames ahead of the device.
    wait(frame_ - COUNT);
    while (!kept_.empty() && kept_.front().first + COUNT <= frame_) kept_.pop_front();
}

/** As the engine's submission thread: executes each list, then its signals, in the order of recording. */
void renderer::submit()
{
    for (payload& one : payloads_) {
        if (one.list != nullptr) {
            ID3D12CommandList* lists[] = {one.list};
            queue_->ExecuteCommandLists(1, lists);
            for (pooled_list& pooled : lists_pool_) pooled.is_pending &= pooled.list->of != one.list;
        }
        for (auto& signal : one.signals) {
            must(queue_->Signal(signal.first, signal.second), "Signal");
            signal.first->Release();
        }
    }
    payloads_.clear();
}

void renderer::release()
{
    settle();
    held_ = false;
    submit();
    wait(frame_ - 1);
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
            end_frame();
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
    // Withheld lists do not reach the device.
    if (!held_) wait(frame_ - 1);
}

void start_renderer()
{
    GDynamicRHI = engine = new renderer;
    listen_to(engine->list());
}
void run_frame() { engine->frame(); }
void hold_submission() { engine->hold(); }
void release_submission() { engine->release(); }
void finish_frames() { engine->finish(); }
unsigned long foreign_references()
{
    engine->settle();
    ID3D12Device* const device = engine->device();
    device->AddRef();
    return device->Release() - static_cast<unsigned long>(engine->objects());
}
void end_renderer()
{
    finish_frames();
    expect(engine->heard_barriers(), "barriers are heard");
    stop_listening_to(engine->list());
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
