/*
 * The engine's render graph and its textures in tests: the graph transitions textures into the states of its passes, and keeps alive what
 * its lists use.
 */
#include "renderer.h"

#include "objects.h"

const FClearValueBinding FClearValueBinding::Black;

namespace {

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

/** Formats of a texture and of its views, sRGB or not as in the engine. */
pixel_format format_of(EPixelFormat format)
{
    switch (format) {
    case PF_B8G8R8A8: return {DXGI_FORMAT_B8G8R8A8_TYPELESS, 4};
    case PF_R8G8B8A8: return {DXGI_FORMAT_R8G8B8A8_TYPELESS, 4};
    case PF_FloatRGBA: return {DXGI_FORMAT_R16G16B16A16_FLOAT, 8};
    default: return {DXGI_FORMAT_R8_UNORM, 1};
    }
}

} /* namespace */

/** An upload or readback buffer, and the layout of a texture's rows in it. */
struct rows {
    released<ID3D12Resource> memory;
    UINT pitch;
    std::size_t row;
    rows(const FRHITexture& of, D3D12_HEAP_TYPE kind)
    {
        row = static_cast<std::size_t>(of.Width) * format_of(of.Format).bytes;
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
    D3D12_TEXTURE_COPY_LOCATION location(const FRHITexture& of) const
    {
        D3D12_TEXTURE_COPY_LOCATION made = {};
        made.pResource = memory.of;
        made.Type = D3D12_TEXTURE_COPY_TYPE_PLACED_FOOTPRINT;
        made.PlacedFootprint.Footprint = {format_of(of.Format).format, static_cast<UINT>(of.Width), static_cast<UINT>(of.Height), 1, pitch};
        return made;
    }
};

static D3D12_TEXTURE_COPY_LOCATION location(const FRHITexture& of)
{
    D3D12_TEXTURE_COPY_LOCATION made = {};
    made.pResource = of.Resource;
    made.Type = D3D12_TEXTURE_COPY_TYPE_SUBRESOURCE_INDEX;
    return made;
}

FRHITexture::~FRHITexture() { Resource->Release(); }

std::shared_ptr<FRHITexture> make_texture(EPixelFormat format, int32 width, int32 height)
{
    D3D12_HEAP_PROPERTIES heap = {};
    heap.Type = D3D12_HEAP_TYPE_DEFAULT;
    D3D12_RESOURCE_DESC texture = {};
    texture.Dimension = D3D12_RESOURCE_DIMENSION_TEXTURE2D;
    texture.Width = static_cast<UINT64>(width);
    texture.Height = static_cast<UINT>(height);
    texture.DepthOrArraySize = texture.MipLevels = 1;
    texture.Format = format_of(format).format;
    texture.SampleDesc.Count = 1;
    texture.Flags = D3D12_RESOURCE_FLAG_ALLOW_RENDER_TARGET;
    ID3D12Resource* made = nullptr;
    must(engine->device()->CreateCommittedResource(&heap, D3D12_HEAP_FLAG_NONE, &texture, D3D12_RESOURCE_STATE_COMMON, nullptr, IID_PPV_ARGS(&made)),
         "CreateCommittedResource");
    return std::make_shared<FRHITexture>(made, format, width, height);
}

class texture_copy {
public:
    explicit texture_copy(const FRHITexture& of) : height(of.Height), memory(of, D3D12_HEAP_TYPE_READBACK) {}
    void record(FRHITexture& texture) const
    {
        engine->transition(texture, D3D12_RESOURCE_STATE_COPY_SOURCE);
        engine->flush();
        const D3D12_TEXTURE_COPY_LOCATION to = memory.location(texture), from = location(texture);
        engine->list()->CopyTextureRegion(&to, 0, 0, 0, &from, nullptr);
    }
    const int32 height;
    const rows memory;
};

std::shared_ptr<texture_copy> copy_texture(const FTextureRHIRef& texture)
{
    FRHITexture* const of = texture;
    auto made = std::make_shared<texture_copy>(*of);
    engine->render([made, texture](FRHICommandListImmediate& list) {
        list.Commands.push_back([made, texture](FRHICommandListImmediate&) {
            FRHITexture* const recorded = texture;
            made->record(*recorded);
        });
    });
    return made;
}

std::vector<uint8> read_copy(const texture_copy& copy)
{
    const rows& memory = copy.memory;
    std::vector<uint8> bytes;
    uint8* mapped = nullptr;
    must(memory.memory->Map(0, nullptr, reinterpret_cast<void**>(&mapped)), "Map");
    for (int32 y = 0; y < copy.height; y++) {
        const uint8* row = mapped + static_cast<std::size_t>(y) * memory.pitch;
        bytes.insert(bytes.end(), row, row + memory.row);
    }
    memory.memory->Unmap(0, nullptr);
    return bytes;
}

std::vector<uint8> read_texture(FRHITexture& texture)
{
    finish_frames();
    const texture_copy copy(texture);
    copy.record(texture);
    finish_frames();
    return read_copy(copy);
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
    const D3D12_TEXTURE_COPY_LOCATION to = location(texture), from = memory.location(texture);
    engine->list()->CopyTextureRegion(&to, 0, 0, 0, &from, nullptr);
    finish_frames();
}

/* ---- The render graph -------------------------------------------------------------------------------------------- */

FRDGTextureRef FRDGBuilder::Register(std::shared_ptr<FRDGTexture> texture)
{
    textures_.push_back(std::move(texture));
    return textures_.back().get();
}

FRDGTextureRef FRDGBuilder::CreateTexture(const FRDGTextureDesc& desc, const TCHAR*)
{
    return Register(std::make_shared<FRDGTexture>(make_texture(desc.Format, desc.Extent.X, desc.Extent.Y), false));
}

void FRDGBuilder::Add(const FPassParameters* parameters, ERDGPassFlags flags, std::function<void(FRHICommandListImmediate&)> what)
{
    const auto bits = static_cast<uint8>(flags);
    const bool copies = (bits & static_cast<uint8>(ERDGPassFlags::Copy)) != 0;
    expect((bits & static_cast<uint8>(ERDGPassFlags::NeverCull)) != 0, "a pass that writes for others is not left out");
    for (const auto* access : parameters->All) {
        expect(access->texture != nullptr, "a pass names all of its textures");
        expect(copies || (access->access != ERHIAccess::CopySrc && access->access != ERHIAccess::CopyDest), "a pass that copies says so");
        expect(access->access != ERHIAccess::CopySrc || access->texture->IsWritten, "what is read was written before");
        access->texture->IsWritten |= access->access == ERHIAccess::CopyDest;
    }
    passes_.push_back({parameters, std::move(what)});
}

void FRDGBuilder::Execute()
{
    expect(where_this_runs() == place::render, "graphs run on the render thread");
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
    // Objects of the graph live as long as commands use them, and the device's work with them runs.
    RHICmdList.Commands.push_back([parameters = kept_, textures = textures_](FRHICommandListImmediate&) {
        for (const auto& texture : textures) engine->keep(texture);
    });
}

FRDGTextureRef RegisterExternalTexture(FRDGBuilder& builder, FRHITexture* texture, const TCHAR*)
{
    return builder.Register(std::make_shared<FRDGTexture>(std::shared_ptr<FRHITexture>(texture, [](FRHITexture*) {}), true));
}

void AddClearRenderTargetPass(FRDGBuilder&, FRDGTextureRef texture)
{
    // The colour does not matter here, only that the texture is written.
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

/** As in the engine, earlier commands that use it run first. */
static void let_go(std::shared_ptr<FTextureRenderTargetResource> of)
{
    if (of == nullptr || engine == nullptr) return;
    engine->render([of](FRHICommandListImmediate& list) {
        list.Commands.push_back([texture = of->Texture](FRHICommandListImmediate&) { engine->keep(std::make_shared<FTextureRHIRef>(texture)); });
    });
}

UTextureRenderTarget2D::~UTextureRenderTarget2D() { let_go(std::move(Resource)); }

void UTextureRenderTarget2D::InitAutoFormat(uint32 width, uint32 height)
{
    let_go(std::move(Resource));
    SizeX = static_cast<int32>(width);
    SizeY = static_cast<int32>(height);
    Resource = std::make_unique<FTextureRenderTargetResource>();
    Resource->Texture = make_texture(GetFormat(), SizeX, SizeY);
}

void UTextureRenderTarget2D::UpdateResourceImmediate(bool) {}

bool FTextureRenderTargetResource::ReadPixels(TArray<FColor>& to)
{
    FRHITexture& texture = *Texture;
    if (texture.Format == PF_FloatRGBA) {
        TArray<FLinearColor> light;
        ReadLinearColorPixels(light);
        float least[3] = {0, 0, 0}, largest[3] = {1, 1, 1};
        for (const FLinearColor& one : light) {
            const float parts[3] = {one.R, one.G, one.B};
            for (int i = 0; i < 3; i++) {
                least[i] = std::min(least[i], parts[i]);
                largest[i] = std::max(largest[i], parts[i]);
            }
        }
        const auto stretched = [&](float value, int of) { return (value - least[of]) / (largest[of] - least[of]); };
        for (const FLinearColor& one : light) to.Add(FLinearColor{stretched(one.R, 0), stretched(one.G, 1), stretched(one.B, 2), one.A}.ToFColor(true));
        return true;
    }
    expect(texture.Format == PF_B8G8R8A8, "only formats are read that the engine can convert");
    const std::vector<uint8> bytes = read_texture(texture);
    for (std::size_t i = 0; i + 3 < bytes.size(); i += 4) to.Add({bytes[i], bytes[i + 1], bytes[i + 2], bytes[i + 3]});
    return true;
}

bool FTextureRenderTargetResource::ReadLinearColorPixels(TArray<FLinearColor>& to)
{
    FRHITexture& texture = *Texture;
    expect(texture.Format == PF_FloatRGBA, "light is read from half floats");
    const std::vector<uint8> bytes = read_texture(texture);
    for (std::size_t i = 0; i + 7 < bytes.size(); i += 8) {
        float parts[4];
        for (std::size_t c = 0; c < 4; c++) {
            uint16_t half;
            std::memcpy(&half, &bytes[i + 2 * c], sizeof half);
            parts[c] = static_cast<float>(of_half(half));
        }
        to.Add({parts[0], parts[1], parts[2], parts[3]});
    }
    return true;
}

FColor FLinearColor::ToFColor(bool srgb) const
{
    const auto level = [](float value) { return static_cast<uint8>(std::floor(std::clamp(value, 0.0f, 1.0f) * 255.999f)); };
    const auto coded = [srgb](float value) {
        const float light = std::clamp(value, 0.0f, 1.0f);
        return !srgb ? light : light <= 0.0031308f ? light * 12.92f : 1.055f * std::pow(light, 1 / 2.4f) - 0.055f;
    };
    return {level(coded(B)), level(coded(G)), level(coded(R)), level(A)};
}

double of_half(uint16_t half)
{
    const int exponent = half >> 10 & 31;
    const double size = exponent == 0 ? std::ldexp(half & 1023, -24) : std::ldexp(1024 + (half & 1023), exponent - 25);
    return half >> 15 != 0 ? -size : size;
}

uint16_t half_of(double value)
{
    if (value < std::ldexp(1, -14)) return static_cast<uint16_t>(std::lround(std::ldexp(value, 24)));
    int exponent;
    const double part = std::frexp(value, &exponent);
    /* A carry out of the ten bits belongs into the exponent, where the sum puts it. */
    return static_cast<uint16_t>(((exponent + 14) << 10) + std::lround((2 * part - 1) * 1024));
}
