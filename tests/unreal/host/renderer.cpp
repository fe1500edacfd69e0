/*
 * The engine's renderer in tests: a graph that brings textures into the states its passes ask for, lists that are written on a thread of
 * their own, and barriers that are written down when the engine gets to it. It judges what a plugin does between.
 */
#include "host.h"
#include "objects.h"

#include <deque>

#include <dxgi1_4.h>
#include <windows.h>

const FClearValueBinding FClearValueBinding::Black;

namespace {

/** Where code runs. */
enum class place { game, render, lists };
thread_local place here = place::game;

template <class T> struct released {
    T* of = nullptr;
    ~released() { if (of != nullptr) of->Release(); }
    T* operator->() const { return of; }
};

void must(HRESULT result, const char* what)
{
    if (FAILED(result)) {
        std::fprintf(stderr, "host: %s: 0x%08lX\n", what, static_cast<unsigned long>(result));
        std::exit(1);
    }
}

class renderer final : public ID3D12DynamicRHI {
public:
    renderer()
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

    /* What the plugin calls. */
    const TCHAR* GetName() override { return L"D3D12"; }
    ID3D12CommandQueue* RHIGetCommandQueue() const override { return queue_.of; }
    ID3D12Device* RHIGetDevice(uint32 index) const override { return expect(index == 0, "there is one graphics card"), device_.of; }
    ID3D12Resource* RHIGetResource(FRHITexture* texture) const override
    {
        named_ = texture;
        return texture->Resource;
    }
#if UE_VERSION_OLDER_THAN(5, 5, 0)
    ID3D12GraphicsCommandList* RHIGetGraphicsCommandList(uint32) const override { return hand_out(); }
    void RHIFinishExternalComputeWork(uint32, ID3D12GraphicsCommandList* list) override { take_back(list); }
#else
    ID3D12GraphicsCommandList* RHIGetGraphicsCommandList(FRHICommandListBase& executing, uint32) const override
    {
        expect(&executing == executing_, "the list that is asked for is the one that is written");
        return hand_out();
    }
    void RHIFinishExternalComputeWork(FRHICommandListBase&, uint32, ID3D12GraphicsCommandList* list) override { take_back(list); }
#endif
#if UE_VERSION_OLDER_THAN(5, 6, 0)
    void RHITransitionResource(FRHICommandList&, FRHITexture* texture, D3D12_RESOURCE_STATES state, uint32) override
    {
        expect(here == place::lists, "RHITransitionResource is called where lists are written");
        texture->UsedIn = frame_;
        transition(*texture, state);
    }
#else
    void RHIFlushResourceBarriers(FRHICommandListBase&, uint32) override { flush(); }
    void RHIUpdateResourceResidency(FRHICommandListBase&, uint32, FRHITexture* texture) override { texture->UsedIn = frame_; }
#endif
    void RHISignalManualFence(FRHICommandList&, ID3D12Fence* fence, uint64 value) override
    {
        expect(here == place::lists, "fences are signalled where lists are written");
        fence->AddRef();
        signals_.emplace_back(fence, value);
    }

    /* What the engine does. */
    void transition(FRHITexture& texture, D3D12_RESOURCE_STATES state)
    {
        if (texture.State == state) return;
        D3D12_RESOURCE_BARRIER barrier = {};
        barrier.Transition.pResource = texture.Resource;
        barrier.Transition.Subresource = D3D12_RESOURCE_BARRIER_ALL_SUBRESOURCES;
        barrier.Transition.StateBefore = texture.State;
        barrier.Transition.StateAfter = state;
        barriers_.push_back(barrier);
        texture.State = state;
    }
    void flush()
    {
        expect(lent_ == 0, "the engine writes nothing while its list is lent");
        if (!barriers_.empty()) list_->ResourceBarrier(static_cast<UINT>(barriers_.size()), barriers_.data());
        barriers_.clear();
    }
    void copy(FRHITexture& from, FRHITexture& to)
    {
        flush();
        list_->CopyResource(to.Resource, from.Resource);
    }

    /** Keeps what this frame's list names until the device has done with it. */
    void keep(std::vector<std::shared_ptr<FRDGTexture>> textures) { kept_.emplace_back(frame_, std::move(textures)); }

    void render(std::function<void(FRHICommandListImmediate&)> what) { given_.push_back(std::move(what)); }

    void frame()
    {
        FRHICommandListImmediate list;
        on(place::render, [&] {
            while (!given_.empty()) {
                const auto what = std::move(given_.front());
                given_.pop_front();
                what(list);
            }
        });
        on(place::lists, [&] {
            executing_ = &list;
            for (const auto& command : list.Commands) command(list);
            executing_ = nullptr;
            submit();
        });
        list.Commands.clear();
    }

    void submit()
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
        if (frame_ > COUNT) wait(frame_ - COUNT);
        while (!kept_.empty() && kept_.front().first + COUNT <= frame_) kept_.pop_front();
        auto& next = allocators_[frame_ % COUNT];
        must(next->Reset(), "Reset");
        must(list_->Reset(next.of, nullptr), "Reset");
    }
    void finish() { wait(frame_ - 1); }
    ID3D12Device* device() const { return device_.of; }
    ID3D12GraphicsCommandList* list() const { return list_.of; }

private:
    static constexpr uint64 COUNT = 3;

    void wait(uint64 value)
    {
        if (fence_->GetCompletedValue() >= value) return;
        must(fence_->SetEventOnCompletion(value, done_), "SetEventOnCompletion");
        WaitForSingleObject(done_, INFINITE);
        must(device_->GetDeviceRemovedReason(), "the device");
    }
    ID3D12GraphicsCommandList* hand_out() const
    {
        expect(here == place::lists, "the list is asked for where lists are written");
        expect(barriers_.empty(), "the engine's barriers are written down before somebody else records");
        expect(lent_++ == 0, "a list is lent once");
        return list_.of;
    }
    void take_back(ID3D12GraphicsCommandList* list)
    {
        expect(list == list_.of && --lent_ == 0, "the list that was lent comes back");
        expect(named_ != nullptr && named_->UsedIn == frame_, "the engine knows of textures that others use");
        expect(named_ != nullptr && named_->State == D3D12_RESOURCE_STATE_COPY_DEST, "the target is in the state that Cairn is told");
        named_ = nullptr;
    }
    template <class What> static void on(place where, What what)
    {
        struct job {
            place where;
            What& what;
            static DWORD WINAPI run(void* self)
            {
                here = static_cast<job*>(self)->where;
                static_cast<job*>(self)->what();
                return 0;
            }
        } given = {where, what};
        HANDLE thread = CreateThread(nullptr, 0, job::run, &given, 0, nullptr);
        WaitForSingleObject(thread, INFINITE);
        CloseHandle(thread);
    }

    released<ID3D12Device> device_;
    released<ID3D12CommandQueue> queue_;
    released<ID3D12CommandAllocator> allocators_[COUNT];
    released<ID3D12GraphicsCommandList> list_;
    released<ID3D12Fence> fence_;
    HANDLE done_;
    uint64 frame_ = 3;
    std::vector<D3D12_RESOURCE_BARRIER> barriers_;
    std::vector<std::pair<ID3D12Fence*, uint64>> signals_;
    std::deque<std::pair<uint64, std::vector<std::shared_ptr<FRDGTexture>>>> kept_;
    std::deque<std::function<void(FRHICommandListImmediate&)>> given_;
    FRHICommandListImmediate* executing_ = nullptr;
    mutable int lent_ = 0;
    mutable FRHITexture* named_ = nullptr;
};

renderer* engine = nullptr;

D3D12_RESOURCE_STATES state_of(ERHIAccess access)
{
    switch (access) {
    case ERHIAccess::CopySrc: return D3D12_RESOURCE_STATE_COPY_SOURCE;
    case ERHIAccess::CopyDest: return D3D12_RESOURCE_STATE_COPY_DEST;
    case ERHIAccess::RTV: return D3D12_RESOURCE_STATE_RENDER_TARGET;
    default: return D3D12_RESOURCE_STATE_PIXEL_SHADER_RESOURCE;
    }
}

struct pixel_format {
    DXGI_FORMAT format;
    UINT bytes;
};

pixel_format format_of(EPixelFormat format, bool srgb)
{
    switch (format) {
    case PF_B8G8R8A8: return {srgb ? DXGI_FORMAT_B8G8R8A8_TYPELESS : DXGI_FORMAT_B8G8R8A8_UNORM, 4};
    case PF_R8G8B8A8: return {srgb ? DXGI_FORMAT_R8G8B8A8_TYPELESS : DXGI_FORMAT_R8G8B8A8_UNORM, 4};
    case PF_FloatRGBA: return {DXGI_FORMAT_R16G16B16A16_FLOAT, 8};
    default: return {DXGI_FORMAT_R8_UNORM, 1};
    }
}

/** Memory that the host reads or writes, and where a texture's rows are in it. */
struct rows {
    released<ID3D12Resource> memory;
    UINT pitch;
    std::size_t row;
    rows(const FRHITexture& of, D3D12_HEAP_TYPE kind)
    {
        row = static_cast<std::size_t>(of.Width) * format_of(of.Format, false).bytes;
        pitch = static_cast<UINT>((row + 255) / 256 * 256);
        D3D12_HEAP_PROPERTIES heap = {};
        heap.Type = kind;
        D3D12_RESOURCE_DESC buffer = {};
        buffer.Dimension = D3D12_RESOURCE_DIMENSION_BUFFER;
        buffer.Width = UINT64{pitch} * static_cast<UINT>(of.Height);
        buffer.Height = buffer.DepthOrArraySize = buffer.MipLevels = 1;
        buffer.SampleDesc.Count = 1;
        buffer.Layout = D3D12_TEXTURE_LAYOUT_ROW_MAJOR;
        const auto state = kind == D3D12_HEAP_TYPE_UPLOAD ? D3D12_RESOURCE_STATE_GENERIC_READ : D3D12_RESOURCE_STATE_COPY_DEST;
        must(engine->device()->CreateCommittedResource(&heap, D3D12_HEAP_FLAG_NONE, &buffer, state, nullptr, IID_PPV_ARGS(&memory.of)),
             "CreateCommittedResource");
    }
    D3D12_TEXTURE_COPY_LOCATION place(const FRHITexture& of) const
    {
        D3D12_TEXTURE_COPY_LOCATION made = {};
        made.pResource = memory.of;
        made.Type = D3D12_TEXTURE_COPY_TYPE_PLACED_FOOTPRINT;
        made.PlacedFootprint.Footprint = {format_of(of.Format, false).format, static_cast<UINT>(of.Width), static_cast<UINT>(of.Height), 1, pitch};
        return made;
    }
};

D3D12_TEXTURE_COPY_LOCATION place(const FRHITexture& of)
{
    D3D12_TEXTURE_COPY_LOCATION made = {};
    made.pResource = of.Resource;
    made.Type = D3D12_TEXTURE_COPY_TYPE_SUBRESOURCE_INDEX;
    return made;
}

} /* namespace */

FDynamicRHI* GDynamicRHI = nullptr;

void start_renderer() { GDynamicRHI = engine = new renderer; }
void run_frame() { engine->frame(); }
void finish_frames()
{
    engine->frame();
    engine->finish();
}
void end_renderer()
{
    finish_frames();
    GDynamicRHI = nullptr;
    delete std::exchange(engine, nullptr);
}

std::shared_ptr<FRHITexture> make_texture(EPixelFormat format, bool srgb, int32 width, int32 height)
{
    D3D12_HEAP_PROPERTIES heap = {};
    heap.Type = D3D12_HEAP_TYPE_DEFAULT;
    D3D12_RESOURCE_DESC texture = {};
    texture.Dimension = D3D12_RESOURCE_DIMENSION_TEXTURE2D;
    texture.Width = static_cast<UINT64>(width);
    texture.Height = static_cast<UINT>(height);
    texture.DepthOrArraySize = texture.MipLevels = 1;
    texture.Format = format_of(format, srgb).format;
    texture.SampleDesc.Count = 1;
    texture.Flags = D3D12_RESOURCE_FLAG_ALLOW_RENDER_TARGET;
    ID3D12Resource* made = nullptr;
    must(engine->device()->CreateCommittedResource(&heap, D3D12_HEAP_FLAG_NONE, &texture, D3D12_RESOURCE_STATE_COMMON, nullptr, IID_PPV_ARGS(&made)),
         "CreateCommittedResource");
    return std::make_shared<FRHITexture>(made, format, width, height);
}

std::vector<uint8> read_texture(FRHITexture& texture)
{
    finish_frames();
    const rows memory(texture, D3D12_HEAP_TYPE_READBACK);
    engine->transition(texture, D3D12_RESOURCE_STATE_COPY_SOURCE);
    engine->flush();
    const D3D12_TEXTURE_COPY_LOCATION to = memory.place(texture), from = place(texture);
    engine->list()->CopyTextureRegion(&to, 0, 0, 0, &from, nullptr);
    finish_frames();
    std::vector<uint8> bytes;
    uint8* mapped = nullptr;
    must(memory.memory->Map(0, nullptr, reinterpret_cast<void**>(&mapped)), "Map");
    for (int32 y = 0; y < texture.Height; y++) {
        const uint8* row = mapped + static_cast<std::size_t>(y) * memory.pitch;
        bytes.insert(bytes.end(), row, row + memory.row);
    }
    memory.memory->Unmap(0, nullptr);
    return bytes;
}

void write_texture(FRHITexture& texture, const std::vector<uint8>& bytes)
{
    finish_frames();
    const rows memory(texture, D3D12_HEAP_TYPE_UPLOAD);
    uint8* mapped = nullptr;
    must(memory.memory->Map(0, nullptr, reinterpret_cast<void**>(&mapped)), "Map");
    for (int32 y = 0; y < texture.Height; y++) {
        const auto row = bytes.begin() + static_cast<std::ptrdiff_t>(static_cast<std::size_t>(y) * memory.row);
        std::copy(row, row + static_cast<std::ptrdiff_t>(memory.row), mapped + static_cast<std::size_t>(y) * memory.pitch);
    }
    memory.memory->Unmap(0, nullptr);
    engine->transition(texture, D3D12_RESOURCE_STATE_COPY_DEST);
    engine->flush();
    const D3D12_TEXTURE_COPY_LOCATION to = place(texture), from = memory.place(texture);
    engine->list()->CopyTextureRegion(&to, 0, 0, 0, &from, nullptr);
    finish_frames();
}

/* ---- What the plugin is given of it ------------------------------------------------------------------------------ */

void FRenderCommands::Add(std::function<void(FRHICommandListImmediate&)> what)
{
    expect(here == place::game, "render commands are given by the game thread");
    engine->render(std::move(what));
}

void FRHICommandListImmediate::CopyTexture(FRHITexture* from, FRHITexture* to, const FRHICopyTextureInfo&)
{
    expect(here == place::render, "the graph's lists are filled on the render thread");
    Commands.push_back([from, to](FRHICommandListImmediate&) { engine->copy(*from, *to); });
}

FRDGTextureRef FRDGBuilder::Register(std::shared_ptr<FRDGTexture> texture)
{
    textures_.push_back(std::move(texture));
    return textures_.back().get();
}

FRDGTextureRef FRDGBuilder::CreateTexture(const FRDGTextureDesc& desc, const TCHAR*)
{
    return Register(std::make_shared<FRDGTexture>(make_texture(desc.Format, false, desc.Extent.X, desc.Extent.Y), false));
}

void FRDGBuilder::Add(const FPassParameters* parameters, ERDGPassFlags flags, std::function<void(FRHICommandListImmediate&)> what)
{
    const auto bits = static_cast<uint8>(flags);
    expect((bits & static_cast<uint8>(ERDGPassFlags::NeverCull)) != 0, "a pass that writes for others is not left out");
    for (const auto* access : parameters->All) {
        expect(access->texture != nullptr, "a pass names all of its textures");
        expect(access->access != ERHIAccess::CopySrc || access->texture->IsWritten, "what is read was written before");
        access->texture->IsWritten |= access->access == ERHIAccess::CopyDest;
    }
    passes_.push_back({parameters, std::move(what)});
}

void FRDGBuilder::Execute()
{
    expect(here == place::render, "graphs run on the render thread");
    for (const FPass& pass : passes_) {
        std::vector<std::pair<FRHITexture*, D3D12_RESOURCE_STATES>> wanted;
        if (pass.parameters != nullptr) {
            for (const auto* access : pass.parameters->All) wanted.emplace_back(access->texture->GetRHI(), state_of(access->access));
        }
        RHICmdList.Commands.push_back([wanted](FRHICommandListImmediate&) {
            for (const auto& one : wanted) engine->transition(*one.first, one.second);
        });
        pass.what(RHICmdList);
    }
    for (const auto& texture : textures_) {
        if (!texture->IsExternal) continue;
        RHICmdList.Commands.push_back([of = texture->GetRHI()](FRHICommandListImmediate&) {
            engine->transition(*of, D3D12_RESOURCE_STATE_PIXEL_SHADER_RESOURCE);
        });
    }
    // What the graph made lives as long as commands name it, and what they give to the device runs.
    RHICmdList.Commands.push_back([kept = kept_, textures = textures_](FRHICommandListImmediate&) { engine->keep(textures); });
}

FRDGTextureRef RegisterExternalTexture(FRDGBuilder& builder, FRHITexture* texture, const TCHAR*)
{
    return builder.Register(std::make_shared<FRDGTexture>(std::shared_ptr<FRHITexture>(texture, [](FRHITexture*) {}), true));
}

void AddClearRenderTargetPass(FRDGBuilder&, FRDGTextureRef texture)
{
    // Its colour is nobody's concern: that it is written is.
    texture->IsWritten = true;
}

EPixelFormat UTextureRenderTarget2D::GetFormat() const
{
    switch (RenderTargetFormat) {
    case RTF_RGBA16f: return PF_FloatRGBA;
    case RTF_R8: return PF_G8;
    default: return PF_B8G8R8A8;
    }
}

void UTextureRenderTarget2D::InitAutoFormat(uint32 width, uint32 height)
{
    SizeX = static_cast<int32>(width);
    SizeY = static_cast<int32>(height);
    Resource = std::make_unique<FTextureRenderTargetResource>();
    Resource->Texture = make_texture(GetFormat(), RenderTargetFormat == RTF_RGBA8_SRGB, SizeX, SizeY);
}

void UTextureRenderTarget2D::UpdateResourceImmediate(bool) {}

bool FTextureRenderTargetResource::ReadPixels(TArray<FColor>& to)
{
    FRHITexture& texture = *Texture;
    if (texture.Format != PF_B8G8R8A8) return false;
    const std::vector<uint8> bytes = read_texture(texture);
    for (std::size_t i = 0; i + 3 < bytes.size(); i += 4) to.Add({bytes[i], bytes[i + 1], bytes[i + 2], bytes[i + 3]});
    return true;
}
