/* Textures, command lists, the render graph, and Direct3D 12 behind them, for each version of the engine. */
#pragma once

#include "core.h"

enum EPixelFormat : uint8 { PF_Unknown, PF_B8G8R8A8, PF_FloatRGBA, PF_G8, PF_R8G8B8A8, PF_A2B10G10R10 };

enum class ERHIAccess : uint32 { Unknown = 0, CopySrc = 1, CopyDest = 2, SRVMask = 4, RTV = 8 };

enum class ETextureCreateFlags : uint64 { RenderTargetable = 1, ShaderResource = 2 };
constexpr ETextureCreateFlags TexCreate_RenderTargetable = ETextureCreateFlags::RenderTargetable;
constexpr ETextureCreateFlags TexCreate_ShaderResource = ETextureCreateFlags::ShaderResource;
constexpr ETextureCreateFlags operator|(ETextureCreateFlags a, ETextureCreateFlags b)
{
    return static_cast<ETextureCreateFlags>(static_cast<uint64>(a) | static_cast<uint64>(b));
}

struct FIntPoint {
    int32 X, Y;
    FIntPoint(int32 x, int32 y) : X(x), Y(y) {}
    bool operator!=(const FIntPoint& other) const { return X != other.X || Y != other.Y; }
    bool operator==(const FIntPoint& other) const { return X == other.X && Y == other.Y; }
};

struct FClearValueBinding {
    static const FClearValueBinding Black;
};

struct ID3D12Resource;

class FRHIResource {
public:
    virtual ~FRHIResource() = default;
};

/** A texture of the engine. The members are the host's bookkeeping. */
class FRHITexture : public FRHIResource {
public:
    FRHITexture(ID3D12Resource* resource, EPixelFormat format, int32 width, int32 height)
        : Resource(resource), Format(format), Width(width), Height(height)
    {
    }
    ~FRHITexture() override;
    FRHITexture(const FRHITexture&) = delete;

    ID3D12Resource* const Resource;
    const EPixelFormat Format;
    const int32 Width, Height;
    /** The Direct3D 12 state at this point of the list, including barriers that are not recorded yet. */
    uint32 State = 0;
    /** The last frame in which the engine knows of a use. */
    uint64 UsedIn = 0;
};

/** A reference to a texture. */
class FTextureRHIRef {
public:
    FTextureRHIRef() = default;
    FTextureRHIRef(std::shared_ptr<FRHITexture> of) : of_(std::move(of)) {}
    operator FRHITexture*() const { return of_.get(); }

private:
    std::shared_ptr<FRHITexture> of_;
};

struct FRHICopyTextureInfo {};

class FRHICommandListBase {};
class FRHICommandList : public FRHICommandListBase {};

class FRHICommandListImmediate : public FRHICommandList {
public:
    template <class Lambda> void EnqueueLambda(Lambda&& lambda)
    {
        // A lambda's captures may be move-only; std::function needs copyable ones.
        auto held = std::make_shared<std::decay_t<Lambda>>(std::forward<Lambda>(lambda));
        Commands.push_back([held](FRHICommandListImmediate& executing) { (*held)(executing); });
    }
    void CopyTexture(FRHITexture* from, FRHITexture* to, const FRHICopyTextureInfo&);
    /** Used by the host: work for the thread that records lists. */
    std::vector<std::function<void(FRHICommandListImmediate&)>> Commands;
};

enum class ERHIInterfaceType { Hidden, Null, D3D11, D3D12, Vulkan };

class FDynamicRHI {
public:
    virtual ~FDynamicRHI() = default;
    virtual ERHIInterfaceType GetInterfaceType() const = 0;
    virtual const TCHAR* GetName() = 0;
};
extern FDynamicRHI* GDynamicRHI;

/** The graphics cards that render. */
class FRHIGPUMask {
public:
    static FRHIGPUMask All() { return FRHIGPUMask(); }
    uint32 GetNumActive() const { return Count; }
    /** Set by the host. */
    static uint32 Count;
};
inline ERHIInterfaceType RHIGetInterfaceType() { return GDynamicRHI->GetInterfaceType(); }

/* ---- The render graph -------------------------------------------------------------------------------------------- */

class FRDGTexture {
public:
    explicit FRDGTexture(FTextureRHIRef texture, bool external) : IsExternal(external), IsWritten(external), texture_(std::move(texture)) {}
    FRHITexture* GetRHI() const { return texture_; }
    /** Used by the host. */
    const bool IsExternal;
    bool IsWritten;

private:
    FTextureRHIRef texture_;
};
using FRDGTextureRef = FRDGTexture*;

struct FRDGTextureDesc {
    FIntPoint Extent;
    EPixelFormat Format;
    ETextureCreateFlags Flags;
    static FRDGTextureDesc Create2D(FIntPoint size, EPixelFormat format, FClearValueBinding, ETextureCreateFlags flags)
    {
        return {size, format, flags};
    }
};

struct FRDGEventName {
    const char* name;
};
#define RDG_EVENT_NAME(name) FRDGEventName{name}

enum class ERDGPassFlags : uint8 { None = 0, Raster = 1, Compute = 2, AsyncCompute = 4, Copy = 8, NeverCull = 16, SkipRenderPass = 32 };
constexpr ERDGPassFlags operator|(ERDGPassFlags a, ERDGPassFlags b)
{
    return static_cast<ERDGPassFlags>(static_cast<uint8>(a) | static_cast<uint8>(b));
}

/** Parameters of a pass, with the list of textures that they use. */
struct FPassParameters {
    struct FAccess {
        FRDGTextureRef texture = nullptr;
        ERHIAccess access;
        FAccess(FPassParameters* of, ERHIAccess wanted) : access(wanted) { of->All.push_back(this); }
        FAccess& operator=(FRDGTextureRef value) { return texture = value, *this; }
        FRDGTextureRef operator->() const { return texture; }
    };
    FPassParameters() = default;
    FPassParameters(const FPassParameters&) = delete;
    std::vector<const FAccess*> All;
};
#define BEGIN_SHADER_PARAMETER_STRUCT(name, api) struct name : FPassParameters {
#define RDG_TEXTURE_ACCESS(name, access) FAccess name{this, access};
#define END_SHADER_PARAMETER_STRUCT() };

class FRDGBuilder {
public:
    explicit FRDGBuilder(FRHICommandListImmediate& list, FRDGEventName = {}) : RHICmdList(list) {}
    FRDGBuilder(const FRDGBuilder&) = delete;
    FRHICommandListImmediate& RHICmdList;
    template <class T> T* AllocParameters()
    {
        auto made = std::make_shared<T>();
        kept_.push_back(made);
        return made.get();
    }
    FRDGTextureRef CreateTexture(const FRDGTextureDesc& desc, const TCHAR* name);
    template <class T, class Lambda> void AddPass(FRDGEventName&&, const T* parameters, ERDGPassFlags flags, Lambda&& lambda)
    {
        // A lambda that takes any list may run on any thread; one that takes the immediate list runs on the calling thread.
        static_assert(std::is_invocable_v<Lambda, FRHICommandListImmediate&>, "a pass takes the command list");
        auto held = std::make_shared<std::decay_t<Lambda>>(std::forward<Lambda>(lambda));
        Add(parameters, flags, [held](FRHICommandListImmediate& list) { (*held)(list); });
    }
    void Execute();

    /** Used by the functions below. */
    FRDGTextureRef Register(std::shared_ptr<FRDGTexture> texture);
    void Add(const FPassParameters* parameters, ERDGPassFlags flags, std::function<void(FRHICommandListImmediate&)> what);

private:
    struct FPass {
        const FPassParameters* parameters;
        std::function<void(FRHICommandListImmediate&)> what;
    };
    std::vector<std::shared_ptr<void>> kept_;
    std::vector<std::shared_ptr<FRDGTexture>> textures_;
    std::vector<FPass> passes_;
};

FRDGTextureRef RegisterExternalTexture(FRDGBuilder& builder, FRHITexture* texture, const TCHAR* name);
void AddClearRenderTargetPass(FRDGBuilder& builder, FRDGTextureRef texture);

/** Enqueues commands for the render thread. */
struct FRenderCommands {
    template <class Lambda> void operator()(Lambda&& lambda) const
    {
        auto held = std::make_shared<std::decay_t<Lambda>>(std::forward<Lambda>(lambda));
        Add([held](FRHICommandListImmediate& list) { (*held)(list); });
    }
    static void Add(std::function<void(FRHICommandListImmediate&)> what);
};
#define ENQUEUE_RENDER_COMMAND(name) FRenderCommands()
/** Waits until all commands are done and the device has its lists. */
void FlushRenderingCommands();
