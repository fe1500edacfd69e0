/*
 * A small engine that runs Cairn's plugin: its module, subsystem, component and pass, compiled from the sources that Unreal compiles,
 * on a Direct3D 12 device of its own. Render targets are compared with the library's direct output.
 *
 * host PLUGIN load [LIBRARY]: prints why the library cannot be used, or nothing; with LIBRARY, after that other library was loaded.
 * host PLUGIN show: a walk, and the shutdown of the module.
 * host PLUGIN play: everything else.
 */
#include "CairnInput.h"
#include "CairnPass.h"
#include "CairnPictures.h"
#include "CairnPipelineCache.h"
#include "CairnRuntimeModule.h"
#include "CairnStream.h"
#include "CairnWorldComponent.h"
#include "CairnWorldSubsystem.h"

#include "host.h"
#include "objects.h"

#include <cairn.hpp>

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <iterator>
#include <map>

#include <windows.h>

#include <shellapi.h>

namespace {

std::atomic<int> failures{0}, checks{0};
std::wstring folder;

/** Time limit for anything, in seconds. */
constexpr double PATIENCE = 300.0;
constexpr int64 SEED = 7;
constexpr int32 THREADS = 2;
const char* const OPERATING_POINT = "stock,pictures:1";

bool says(const FString& text, const wchar_t* part) { return std::wcsstr(*text, part) != nullptr; }

/** The expected anchors, made with the library directly: a rollout from a picture, in BGRA, while W is held. */
class own_rollout {
public:
    explicit own_rollout(const FCairnPicture& picture, uint64_t seed)
    {
        cairn::device_options options;
        options.threads = THREADS;
        device_ = cairn::device::cpu(options).value();
        cairn::world_options wanted;
        wanted.operating_point = OPERATING_POINT;
        world_ = cairn::world::load(device_, wanted).value();
        cairn::rollout_options start;
        start.seed = seed;
        rollout_ = cairn::rollout::create(world_, start).value();
        rollout_
            .append(cairn::picture_of(cairn::span<const unsigned char>(picture.Pixels.GetData(), static_cast<std::size_t>(picture.Pixels.Num())),
                                      static_cast<uint32>(picture.Width), static_cast<uint32>(picture.Height), CAIRN_FORMAT_BGRA8))
            .value();
    }
    std::vector<uint8> anchor() const
    {
        const cairn::anchor made = rollout_.anchor().value();
        const cairn::anchor_info info = made.info().value();
        std::vector<uint8> bytes(std::size_t{info.width} * info.height * 4);
        made.read_picture(0, cairn::target_of(bytes, info.width, info.height, CAIRN_FORMAT_BGRA8)).value();
        return bytes;
    }
    void step(float dx, float dy)
    {
        cairn::controls controls;
        controls.keys[1] = uint64_t{1} << 23; /* W */
        controls.mouse_dx = dx;
        controls.mouse_dy = dy;
        rollout_.step(controls).value();
    }

private:
    cairn::device device_;
    cairn::world world_;
    cairn::rollout rollout_;
};

/** A level with a game around it, and a player. */
struct level {
    UGameInstance game;
    APlayerController player;
    UWorld world;
    FSubsystemCollectionBase collection;
    level()
    {
        game.Subsystems.push_back(std::make_unique<UCairnWorldSubsystem>());
        world.Game = &game;
        world.Player = &player;
        subsystem().Initialize(collection);
    }
    UCairnWorldSubsystem& subsystem() { return *game.GetSubsystem<UCairnWorldSubsystem>(); }
};

/** Whether the target shows an anchor's own picture, not a generated frame: also while the next anchor is late. */
bool is_anchor(const FCairnStatistics& now) { return now.Shown == ECairnFrameSource::Anchor || now.Shown == ECairnFrameSource::Held; }

/** A component in a level, and its messages. */
struct actor {
    UCairnWorldComponent component;
    int ready = 0;
    float progress = 0;
    FString error;
    explicit actor(level& in)
    {
        component.Outer = &in.world;
        component.Anchors = ECairnAnchors::Processor;
        component.Threads = THREADS;
        component.Seed = SEED;
        component.OnReady.Listen([this] { ready++; });
        component.OnProgress.Listen([this](float part) { progress = part; });
        component.OnError.Listen([this](const FString& message) { error = message; });
    }
    /** Destruction as by the garbage collector. */
    ~actor() { component.BeginDestroy(); }
    void frame()
    {
        component.TickComponent(0.01f, LEVELTICK_All, nullptr);
        run_frame();
        FTSTicker::GetCoreTicker().Tick(0.01f);
    }
    /** Runs frames until a condition holds. */
    template <class Until> bool until(Until so)
    {
        const double end = FPlatformTime::Seconds() + PATIENCE;
        while (!so()) {
            if (FPlatformTime::Seconds() > end) return false;
            frame();
            Sleep(2);
        }
        return true;
    }
    /** Statistics that match the target's contents: no work is in flight. */
    FCairnStatistics settled()
    {
        finish_frames();
        return component.GetStatistics();
    }
    const FTextureRHIRef& texture() { return component.Target->GameThread_GetRenderTargetResource()->Texture; }
    /** The message with which starting fails. */
    FString refusal()
    {
        component.Start();
        until([this] { return !error.IsEmpty() || component.GetStatistics().Frames > 0; });
        component.Stop();
        return error;
    }
};

FCairnPicture place_of_the_plugin()
{
    FCairnPicture picture;
    FString why;
    expect(CairnReadPicture(FString((folder + L"/Resources/place.ppm").c_str()), picture, why), "the plugin's own picture is read");
    return picture;
}

/** Input that a world must not get: a movement of the mouse, and a tapped key. */
void move_and_tap(UCairnWorldComponent& component)
{
    component.AddMouse(500, 300);
    component.SetKey(FKey(L"S"), true);
    component.SetKey(FKey(L"S"), false);
}

/** Whether pictures are the library's own anchors of a walk in which the mouse moves in one step. */
bool is_walk(const std::map<int64, std::vector<uint8>>& pictures, int64 moved)
{
    own_rollout own(place_of_the_plugin(), SEED);
    for (int64 i = 0; i <= pictures.rbegin()->first; i++) {
        if (i > 0) own.step(i == moved ? 30.0f : 0.0f, i == moved ? -20.0f : 0.0f);
        const auto found = pictures.find(i);
        if (found != pictures.end() && found->second != own.anchor()) return false;
    }
    return true;
}

/** A walk into a target that the component makes: each anchor shown equals the library's own, to the bit. */
void walk(level& in)
{
    in.player.Down = {FKey(L"W")};
    actor shown(in);
    shown.component.Multiplier = 1;
    // Relative to the project, not to the working folder.
    shown.component.SeedPicture.FilePath = L"Cairn/Resources/place.ppm";
    shown.component.BeginPlay();
    /* The world is loading. */
    move_and_tap(shown.component);
    /* A slow machine may not show all of them. */
    std::map<int64, std::vector<uint8>> pictures;
    /* Steps that may get the movement of the mouse: the next one, unless it has begun. */
    int64 earliest = 0, latest = 0;
    const bool made = shown.until([&] {
        if (!pictures.empty() && latest == 0) {
            /* The seed picture is the first of the anchors, without a step. */
            earliest = shown.component.GetStatistics().Anchors;
            shown.component.AddMouse(30, -20);
            latest = shown.component.GetStatistics().Anchors + 1;
        }
        if (pictures.count(shown.component.GetStatistics().ShownAnchor) == 0) {
            const FCairnStatistics now = shown.settled();
            if (is_anchor(now)) pictures[now.ShownAnchor] = read_texture(*shown.component.Target->GameThread_GetRenderTargetResource()->GetRenderTargetTexture());
        }
        return !shown.error.IsEmpty() || (pictures.size() >= 4 && pictures.rbegin()->first > latest);
    });
    if (!shown.error.IsEmpty()) std::fprintf(stderr, "host: %s\n", TCHAR_TO_UTF8(*shown.error));
    expect(made && shown.error.IsEmpty(), "a world is played");
    if (!made) return;
    const auto [darkest, brightest] = std::minmax_element(pictures.rbegin()->second.begin(), pictures.rbegin()->second.end());
    expect(*brightest - *darkest > 16, "there is something to see");
    expect(shown.ready == 1 && shown.progress == 1.0f, "the component says how far it is, and once that it is ready");
    const FCairnStatistics all = shown.component.GetStatistics();
    expect(all.Anchors >= 4 && all.Frames >= 4 && all.AnchorMs > 0 && !all.Generator.IsEmpty(), "statistics tell of it");
    std::printf("generator %s\n", TCHAR_TO_UTF8(*all.Generator));
    expect(all.Unprepared == 0, "all that a frame needs is made before the first one");
    shown.component.EndPlay(EEndPlayReason::Destroyed);
    expect(!shown.component.IsPlaying(), "it ends with the game");

    bool own = false;
    for (int64 step = earliest; !own && step <= latest; step++) own = is_walk(pictures, step);
    expect(own, "the anchors in the target are the library's own, without the input while it loads and with that while it plays");
    in.player.Down.clear();
}

/** A colour's light, 0 to 1. */
double light_of(uint8 level)
{
    const double part = level / 255.0;
    return part <= 0.04045 ? part / 12.92 : std::pow((part + 0.055) / 1.055, 2.4);
}

/** From one render target, of bytes or of light with a highlight, into another of half floats, with generated frames; then an edit, and a pause. */
void capture(level& in, ETextureRenderTargetFormat format)
{
    actor shown(in);
    shown.component.Multiplier = 4;
    shown.component.bReadPlayerInput = false;
    UTextureRenderTarget2D seen, target;
    seen.RenderTargetFormat = format;
    seen.InitAutoFormat(64, 36);
    std::vector<uint8> picture(64 * 36 * 4);
    for (std::size_t i = 0; i < picture.size(); i++) picture[i] = static_cast<uint8>(i % 4 == 3 ? 0 : i / 40);
    for (std::size_t i = 0; i < 3; i++) picture[i] = 255;
    std::vector<uint8> written = picture;
    if (format == RTF_RGBA16f) {
        written.resize(picture.size() * 2);
        for (std::size_t i = 0; i < picture.size(); i++) {
            /* One format is BGRA, the other RGBA. The first pixel is far brighter than white. */
            const uint16_t half = half_of(i % 4 == 3 ? 0 : i < 3 ? 8 : light_of(picture[i / 4 * 4 + (2 - i % 4)]));
            std::memcpy(&written[2 * i], &half, sizeof half);
        }
    }
    write_texture(*seen.GameThread_GetRenderTargetResource()->GetRenderTargetTexture(), written);
    target.RenderTargetFormat = RTF_RGBA16f;
    target.InitAutoFormat(320, 180);
    shown.component.SeedTarget = &seen;
    shown.component.Target = &target;
    shown.component.Start();
    shown.component.SetKey(FKey(L"W"), true);
    std::vector<uint8> first;
    int64 number = 0;
    const bool made = shown.until([&] {
        const FCairnStatistics now = first.empty() ? shown.settled() : shown.component.GetStatistics();
        if (now.Shown == ECairnFrameSource::Anchor && first.empty()) {
            number = now.ShownAnchor;
            first = read_texture(*target.GameThread_GetRenderTargetResource()->GetRenderTargetTexture());
        }
        return !shown.error.IsEmpty() || (!first.empty() && now.Generated > 0);
    });
    expect(made && shown.error.IsEmpty(), "a world is played from what a capture saw, with frames between");

    FCairnPicture seed;
    seed.Width = 64;
    seed.Height = 36;
    seed.Pixels.SetNumUninitialized(static_cast<int64>(picture.size()));
    for (std::size_t i = 0; i < picture.size(); i++) seed.Pixels[static_cast<int64>(i)] = i % 4 == 3 ? 255 : picture[i];
    own_rollout rollout(seed, SEED);
    for (int64 i = 0; i < number; i++) rollout.step(0, 0);
    const std::vector<uint8> own = rollout.anchor();
    double most = 0;
    for (std::size_t i = 0; i < own.size() && first.size() == own.size() * 2; i++) {
        if (i % 4 == 3) continue;
        /* One format is BGRA, the other RGBA. */
        uint16_t half;
        std::memcpy(&half, &first[(i / 4 * 4 + (2 - i % 4)) * 2], sizeof half);
        most = std::max(most, std::fabs(of_half(half) - light_of(own[i])));
    }
    expect(first.size() == own.size() * 2 && most < 0.003, "an anchor is the library's own in linear light");

    shown.component.SetPaused(true);
    Sleep(500);
    shown.frame();
    const int64 held = shown.component.GetStatistics().Anchors;
    for (int i = 0; i < 20; i++) {
        shown.frame();
        Sleep(20);
    }
    expect(shown.component.GetStatistics().Anchors <= held + 1, "a pause holds the world");
    shown.component.AppendRenderTarget(&seen);
    shown.component.SetPaused(false);
    expect(shown.until([&] { return shown.component.GetStatistics().Anchors > held + 2; }), "it goes on, with an edit");

    /* An engine does not tick a component of a paused game. */
    int64 resting = -1, before = -2;
    for (int i = 0; i < 5 && resting != before; i++) {
        before = resting;
        Sleep(1000);
        resting = shown.component.GetStatistics().Anchors;
    }
    expect(resting == before, "a game that does not tick holds the world");
    expect(shown.until([&] { return shown.component.GetStatistics().Anchors > resting + 1; }), "it goes on with the next tick");
    shown.component.Stop();
}

void on_a_server(level& in)
{
    in.world.NetMode = NM_DedicatedServer;
    actor hidden(in);
    hidden.component.BeginPlay();
    expect(!hidden.component.IsPlaying() && hidden.error.IsEmpty(), "a dedicated server plays no world");
    in.world.NetMode = NM_Standalone;
}

/** A game that adds the pass itself, into a texture of its own, before there is a frame to show. It begins with a pause. */
void own_pass(level& in)
{
    actor shown(in);
    shown.component.Multiplier = 1;
    shown.component.bReadPlayerInput = false;
    shown.component.bDrawIntoTarget = false;
    shown.component.Start();
    shown.component.SetKey(FKey(L"W"), true);
    shown.component.SetPaused(true);
    const std::shared_ptr<FRHITexture> texture = make_texture(PF_B8G8R8A8, 320, 180);
    const auto shows = [&](int64 anchor) {
        const TSharedPtr<FCairnStream, ESPMode::ThreadSafe> stream = shown.component.GetStream();
        if (stream.IsValid()) {
            ENQUEUE_RENDER_COMMAND(OwnPass)([texture, of = stream.ToSharedRef()](FRHICommandListImmediate& list) {
                FRDGBuilder graph(list, RDG_EVENT_NAME("own"));
                CairnAddPass(graph, RegisterExternalTexture(graph, texture.get(), L"own"), of, CairnNow());
                graph.Execute();
            });
        }
        if (!shown.error.IsEmpty()) return true;
        const FCairnStatistics now = shown.settled();
        return shown.ready > 0 && is_anchor(now) && now.ShownAnchor >= anchor;
    };
    bool made = shown.until([&] { return shows(0); });
    expect(shown.component.GetStatistics().ShownAnchor == 0, "a pause holds the first anchor");
    move_and_tap(shown.component);
    shown.component.SetPaused(false);
    made = made && shown.until([&] { return shows(2); });
    expect(made && shown.error.IsEmpty() && shown.ready == 1, "a game adds the pass itself");
    expect(shown.component.Target == nullptr, "a target that nobody asked for is not made");
    own_rollout own(place_of_the_plugin(), SEED);
    for (int64 i = 0; i < shown.component.GetStatistics().ShownAnchor; i++) own.step(0, 0);
    expect(read_texture(*texture) == own.anchor(), "an anchor in a game's own texture is the library's own, without the input of the pause");
}

/**
 * Lists are submitted late, as for a minimised window: each has the anchor of the time when it was recorded, and no thread of the engine
 * waits for the device in between.
 */
void late_submission(level& in)
{
    constexpr int64 ANCHORS_MEANWHILE = 8;
    in.player.Down = {FKey(L"W")};
    actor shown(in);
    shown.component.Multiplier = 1;
    shown.component.Start();
    expect(shown.until([&] { return shown.component.GetStatistics().Frames > 0; }), "a world is played");
    finish_frames();
    const int64 before = shown.component.GetStatistics().Anchors;
    hold_submission();
    std::map<int64, std::shared_ptr<texture_copy>> copies;
    expect(shown.until([&] {
        const FCairnStatistics now = shown.settled();
        if (is_anchor(now) && copies.count(now.ShownAnchor) == 0) copies[now.ShownAnchor] = copy_texture(shown.texture());
        return !shown.error.IsEmpty() || now.Anchors >= before + ANCHORS_MEANWHILE;
    }), "the world goes on while lists wait for the device");
    shown.frame();
    release_submission();
    expect(shown.error.IsEmpty() && copies.size() >= 3, "frames are drawn while lists wait for the device");
    const int64 last = shown.component.GetStatistics().ShownAnchor;
    expect(shown.until([&] { return shown.component.GetStatistics().ShownAnchor > last; }), "frames go on when the device has done its lists");
    shown.component.Stop();

    own_rollout own(place_of_the_plugin(), SEED);
    for (int64 i = 0; i <= copies.rbegin()->first; i++) {
        if (i > 0) own.step(0, 0);
        const auto found = copies.find(i);
        expect(found == copies.end() || read_copy(*found->second) == own.anchor(), "a list that waited has the anchor that it was recorded with");
    }
    in.player.Down.clear();
}

/** A component that is destroyed without EndPlay, while its frames are in flight. */
void left_behind(level& in)
{
    TWeakPtr<FCairnStream, ESPMode::ThreadSafe> stream;
    {
        actor left(in);
        left.component.Start();
        expect(left.until([&] { return left.component.GetStatistics().Frames > 0; }), "a world is played");
        left.component.Target->InitAutoFormat(8, 8);
        left.frame();
        expect(left.component.Target->SizeX > 8, "a target that the component has made follows the world's size");
        stream = left.component.GetStream();
        finish_frames();
    }
    expect(stream.Pin().IsValid(), "a component that goes waits neither for its thread nor for the device");
}

/** The module shuts down while render commands hold a stream, and a component does not know of the shutdown. */
void end_of_the_module()
{
    level in;
    actor stopped(in), playing(in);
    playing.component.Start();
    stopped.component.Start();
    expect(stopped.until([&] { return stopped.component.GetStatistics().Frames > 0; }), "a world is played");
    finish_frames();
    TSharedPtr<FCairnStream, ESPMode::ThreadSafe> stream = stopped.component.GetStream();
    const double end = FPlatformTime::Seconds() + PATIENCE;
    /* References of this function and of the component; a third is that of a frame to be drawn. */
    while (stream.GetSharedReferenceCount() < 3 && FPlatformTime::Seconds() < end) {
        stopped.component.TickComponent(0.01f, LEVELTICK_All, nullptr);
        Sleep(2);
    }
    expect(stream.GetSharedReferenceCount() >= 3, "a frame is to be drawn");
    const TWeakPtr<FCairnStream, ESPMode::ThreadSafe> gone = stream;
    stream.Reset();
    stopped.component.Stop();
    FModuleManager::Shutdown();
    expect(!gone.Pin().IsValid(), "the module ends after all that is its own, render commands too");
    playing.component.Stop();
    expect(!playing.component.IsPlaying(), "a component may stop when the module has ended");
}

/** An invalid setting is reported, with a remedy. */
void refusals(level& in)
{
    struct wrong {
        const wchar_t* parts[3];
        std::function<void(UCairnWorldComponent&)> how;
    };
    UTextureRenderTarget2D grey;
    grey.RenderTargetFormat = RTF_R8;
    grey.InitAutoFormat(64, 36);
    const wrong all[] = {
        {{L"нигде мир.cairn", L"cairn_world_load", L""}, [](auto& c) { c.WorldBundle.FilePath = L"нигде мир.cairn"; }},
        {{L"operating_point", L"stuck", L""}, [](auto& c) { c.OperatingPoint = L"stuck"; }},
        {{L"multiplier", L"5", L""}, [](auto& c) { c.Multiplier = 5; }},
        {{L"nowhere.png", L"cannot be read", L"Name a file"}, [](auto& c) { c.SeedPicture.FilePath = L"nowhere.png"; }},
        {{L"no picture", L"cairn.dll", L"PNG"}, [](auto& c) { c.SeedPicture.FilePath = (folder + L"/Binaries/ThirdParty/Cairn/Win64/cairn.dll").c_str(); }},
        {{L"Target has a format", L"RTF RGBA8 SRGB", L""}, [&grey](auto& c) { c.Target = &grey; }},
    };
    for (const wrong& one : all) {
        actor refused(in);
        one.how(refused.component);
        const FString message = refused.refusal();
        bool right = !refused.component.IsPlaying();
        for (const wchar_t* part : one.parts) right = right && says(message, part);
        if (!right) std::fprintf(stderr, "host: said: %s\n", TCHAR_TO_UTF8(*message));
        expect(right, "what is wrong is told");
    }
    level other;
    actor lost(other);
    lost.component.Outer = nullptr;
    expect(says(lost.refusal(), L"no running game"), "a component without a game says so");
}

/** A renderer other than Direct3D 12: the message names the setting to change. */
void other_renderer()
{
    struct vulkan final : FDynamicRHI {
        ERHIInterfaceType GetInterfaceType() const override { return ERHIInterfaceType::Vulkan; }
        const TCHAR* GetName() override { return L"Vulkan"; }
    } stranger;
    FDynamicRHI* const own = std::exchange(GDynamicRHI, &stranger);
    level in;
    const FString why = in.subsystem().GetUnavailableReason();
    expect(!in.subsystem().IsAvailable() && says(why, L"Vulkan") && says(why, L"Default RHI") && says(why, L"DirectX 12"),
          "another renderer is told with the setting");
    actor refused(in);
    refused.component.Start();
    expect(says(refused.error, L"Default RHI"), "a component tells it as well");
    GDynamicRHI = own;
    FRHIGPUMask::Count = 2;
    expect(says(in.subsystem().GetUnavailableReason(), L"-MaxGPUCount"), "several graphics cards are told with the setting");
    FRHIGPUMask::Count = 1;
}

void input()
{
    expect(CairnVirtualKey(FKey(L"W")) == 0x57 && CairnVirtualKey(FKey(L"SpaceBar")) == 0x20 && CairnVirtualKey(FKey(L"Gamepad_LeftX")) == 0,
          "keys have their codes");
    FCairnInput given;
    given.SetKey(0x57, true);
    given.SetKey(0x57, false);
    given.SetKey(300, true);
    given.SetKey(200, true);
    given.AddMouse(3, 4);
    given.AddMouse(std::nanf(""), 1e9f);
    given.AddScroll(1);
    cairn::controls taken = given.Take(128);
    expect(taken.keys[1] == uint64_t{1} << 23 && taken.keys[3] == 0, "a key that was tapped counts, and one that the world does not know does not");
    expect(taken.mouse_dx == 3 && taken.mouse_dy == 32768 && taken.scroll == 1, "the mouse adds up, as far as it can");
    taken = given.Take(256);
    expect(taken.keys[1] == 0 && taken.keys[3] == uint64_t{1} << 8 && taken.mouse_dx == 0, "what was taken is gone, and what is held stays");

    TArray<FColor> colours;
    colours.Add({1, 2, 3, 0});
    const FCairnPicture made = CairnPictureOf(colours, 1, 1);
    expect(made.Pixels[0] == 1 && made.Pixels[2] == 3 && made.Pixels[3] == 255, "a capture's colours are taken, without its alpha");
}

/** The plugin's bytes of compiled pipelines, as the library loads them. */
std::vector<uint8> compiled()
{
    FCairnPipelineCache cache;
    std::vector<uint8> bytes(FCairnPipelineCache::Load(nullptr, 0, &cache));
    std::vector<uint8> less(bytes.size() / 2, 7);
    expect(FCairnPipelineCache::Load(less.data(), less.size(), &cache) == bytes.size(), "how much there is is told");
    expect(std::count(less.begin(), less.end(), 7) == static_cast<std::ptrdiff_t>(less.size()), "what does not fit is not written");
    expect(FCairnPipelineCache::Load(bytes.data(), bytes.size(), &cache) == bytes.size(), "all is given");
    return bytes;
}

/** The next run of the game loads the pipelines that this one compiled. The device's driver returns no blobs, so the library stores none. */
void compiled_pipelines()
{
    const std::filesystem::path file = project_folder() + L"/Saved/Cairn/Pipelines.bin";
    std::filesystem::remove_all(file.parent_path());
    expect(compiled().empty(), "there are none at first");
    for (const std::size_t size : {std::size_t{100000}, std::size_t{10}}) {
        FCairnPipelineCache cache;
        std::vector<uint8> bytes(size);
        for (std::size_t i = 0; i < size; i++) bytes[i] = static_cast<uint8>(i * i);
        FCairnPipelineCache::Store(bytes.data(), size, &cache);
        expect(compiled() == bytes, "what was stored last is loaded");
    }
    /* Another process has the file open: the game continues. */
    const HANDLE held = CreateFileW(file.c_str(), GENERIC_READ, 0, nullptr, OPEN_EXISTING, 0, nullptr);
    FCairnPipelineCache cache;
    FCairnPipelineCache::Store("abc", 3, &cache);
    CloseHandle(held);
    expect(compiled().size() == 10, "what cannot be written changes nothing");
    const std::filesystem::directory_iterator kept(file.parent_path());
    expect(std::distance(begin(kept), end(kept)) == 1, "nothing else is left beside the file");
    std::filesystem::remove(file);
}

void play()
{
    input();
    compiled_pipelines();
    start_renderer();
    const int loaded = pipeline_loads();
    other_renderer();
    const unsigned long before = foreign_references();
    {
        level in;
        expect(in.subsystem().IsAvailable(), "Cairn can be used");
        if (!in.subsystem().IsAvailable()) std::fprintf(stderr, "host: %s\n", TCHAR_TO_UTF8(*in.subsystem().GetUnavailableReason()));
        const std::string version = std::to_string(CAIRN_VERSION / 1000000) + "." + std::to_string(CAIRN_VERSION / 1000 % 1000) + ".";
        expect(std::string(TCHAR_TO_UTF8(*in.subsystem().GetLibraryVersion())).rfind(version, 0) == 0, "the library has a version");
        expect(in.subsystem().GetRequirements().Num() > 2, "what is needed is told");
        walk(in);
        capture(in, RTF_RGBA8);
        capture(in, RTF_RGBA16f);
        on_a_server(in);
        own_pass(in);
        late_submission(in);
        left_behind(in);
        refusals(in);
        expect(pipeline_loads() == loaded + 1, "the device's pipelines are asked for once");
        /* A stopped component's objects are released when the device has finished with them. */
        actor idle(in);
        in.subsystem().Deinitialize();
        expect(idle.until([&] { return foreign_references() <= before; }), "nothing of the device is held when all has ended");
    }
    end_of_the_module();
    end_renderer();
}

/** A first run of a game. */
void show()
{
    start_renderer();
    {
        level in;
        expect(in.subsystem().IsAvailable(), "Cairn can be used");
        walk(in);
        in.subsystem().Deinitialize();
    }
    FModuleManager::Shutdown();
    /* The library may be unloaded while the engine continues: none of its threads or callbacks remains. */
    const HMODULE library = GetModuleHandleW(L"cairn.dll");
    expect(library != nullptr && FreeLibrary(library), "the library can be unloaded");
    end_renderer();
}

} /* namespace */

void expect(bool fine, const char* what)
{
    /* Several threads call this, one after the other. */
    checks++;
    if (fine) return;
    failures++;
    std::fprintf(stderr, "host: failed: %s\n", what);
}

const std::wstring& plugin_folder() { return folder; }
std::wstring project_folder() { return folder + L"/.."; }

int main()
{
    SetConsoleOutputCP(CP_UTF8);
    int count = 0;
    LPWSTR* words = CommandLineToArgvW(GetCommandLineW(), &count);
    if (count < 3 || count > 4) {
        std::fprintf(stderr, "host PLUGIN load|show|play [LIBRARY]\n");
        return 2;
    }
    if (count == 4 && LoadLibraryW(words[3]) == nullptr) {
        std::fprintf(stderr, "host: the other library cannot be loaded\n");
        return 1;
    }
    folder = words[1];
    if (std::wstring(words[2]) == L"load") {
        const FString& why = FCairnRuntimeModule::Get().GetUnavailableReason();
        std::printf("why: %s\n", TCHAR_TO_UTF8(*why));
        if (why.IsEmpty()) std::printf("its functions are those of the plugin's library: %d\n", cairn::version() == CAIRN_VERSION);
        FModuleManager::Shutdown();
        return 0;
    }
    std::wstring(words[2]) == L"show" ? show() : play();
    std::printf("%d checks, %d failed\n", checks.load(), failures.load());
    return failures > 0 ? 1 : 0;
}
