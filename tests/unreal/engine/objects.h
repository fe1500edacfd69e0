/* Objects, components, subsystems and input. The header tool's macros do nothing here, and there is no generated code. */
#pragma once

#include "core.h"
#include "rhi.h"

#define UCLASS(...)
#define USTRUCT(...)
#define UENUM(...)
#define UPROPERTY(...)
#define UFUNCTION(...)
#define UMETA(...)

class UWorld;
class UGameInstance;

class UObject {
public:
    virtual ~UObject() = default;
    /** Called by the garbage collector before destruction. */
    virtual void BeginDestroy() {}
    /** The object that owns this one. */
    UObject* Outer = nullptr;
    /** Objects that this one owns and destroys: there is no garbage collection here. */
    std::vector<std::unique_ptr<UObject>> Inner;
};

/** In the engine the generated body names the base class; here the classes do that themselves. */
#define GENERATED_BODY()

template <class T> class TObjectPtr {
public:
    TObjectPtr() = default;
    TObjectPtr(T* of) : of_(of) {}
    operator T*() const { return of_; }
    T* operator->() const { return of_; }

private:
    T* of_ = nullptr;
};

template <class T> T* NewObject(UObject* outer)
{
    T* made = new T;
    made->Outer = outer;
    outer->Inner.emplace_back(made);
    return made;
}

template <class... A> class TMulticast {
public:
    void Broadcast(A... a)
    {
        const auto all = all_;
        for (const auto& what : all) what(a...);
    }
    /** Called by the host, and by AddDynamic. */
    void Listen(std::function<void(A...)> what) { all_.push_back(std::move(what)); }

private:
    std::vector<std::function<void(A...)>> all_;
};
/** For a UFUNCTION of an object. */
#define AddDynamic(object, function) Listen([self = object](auto&&... a) { (self->*function)(a...); })
#define DECLARE_DYNAMIC_MULTICAST_DELEGATE(name) using name = TMulticast<>
#define DECLARE_DYNAMIC_MULTICAST_DELEGATE_OneParam(name, type, parameter) using name = TMulticast<type>

struct FFilePath {
    FString FilePath;
};

class FKey {
public:
    FKey() = default;
    FKey(const TCHAR* name) : name_(name) {}
    FString ToString() const { return name_; }
    friend bool operator==(const FKey& a, const FKey& b) { return a.name_ == b.name_; }

private:
    FString name_;
};

struct EKeys {
    static const FKey MouseScrollUp, MouseScrollDown;
};

class APlayerController : public UObject {
public:
    bool IsInputKeyDown(const FKey key) const { return std::find(Down.begin(), Down.end(), key) != Down.end(); }
    bool WasInputKeyJustPressed(const FKey key) const { return std::find(Pressed.begin(), Pressed.end(), key) != Pressed.end(); }
    void GetInputMouseDelta(float& x, float& y) const { x = MouseX, y = MouseY; }
    /** Set by the host. */
    std::vector<FKey> Down, Pressed;
    float MouseX = 0, MouseY = 0;
};

class FSubsystemCollectionBase {};

class USubsystem : public UObject {
public:
    virtual void Initialize(FSubsystemCollectionBase&) {}
    virtual void Deinitialize() {}
};

class UGameInstanceSubsystem : public USubsystem {
public:
    using Super = UGameInstanceSubsystem;
};

class UGameInstance : public UObject {
public:
    template <class T> T* GetSubsystem() const
    {
        for (const auto& one : Subsystems) {
            if (T* found = dynamic_cast<T*>(one.get())) return found;
        }
        return nullptr;
    }
    std::vector<std::unique_ptr<USubsystem>> Subsystems;
};

enum ENetMode { NM_Standalone, NM_DedicatedServer, NM_ListenServer, NM_Client };

class UWorld : public UObject {
public:
    UGameInstance* GetGameInstance() const { return Game; }
    APlayerController* GetFirstPlayerController() const { return Player; }
    /** Set by the host. */
    UGameInstance* Game = nullptr;
    APlayerController* Player = nullptr;
    ENetMode NetMode = NM_Standalone;
};

struct FActorComponentTickFunction {
    bool bCanEverTick = false;
};

enum ELevelTick { LEVELTICK_All };
namespace EEndPlayReason {
enum Type { Destroyed, EndPlayInEditor };
}

class UActorComponent : public UObject {
public:
    using Super = UActorComponent;
    FActorComponentTickFunction PrimaryComponentTick;
    UWorld* GetWorld() const { return static_cast<UWorld*>(Outer); }
    bool IsNetMode(ENetMode mode) const { return GetWorld()->NetMode == mode; }
    void RegisterComponent() {}
    virtual void BeginPlay() {}
    virtual void EndPlay(const EEndPlayReason::Type) {}
    virtual void TickComponent(float, ELevelTick, FActorComponentTickFunction*) {}
};

class AActor : public UObject {
public:
    using Super = AActor;
    virtual void BeginPlay() {}
};

enum ETextureRenderTargetFormat { RTF_RGBA8, RTF_RGBA8_SRGB, RTF_RGBA16f, RTF_R8 };

class FTextureRenderTargetResource {
public:
    const FTextureRHIRef& GetRenderTargetTexture() const { return Texture; }
    /** As in the engine: half floats of which one is above 1 are stretched between the least and the largest of their channel. */
    bool ReadPixels(TArray<FColor>& to);
    /** Values as they are. */
    bool ReadLinearColorPixels(TArray<FLinearColor>& to);
    /** Used by the host. */
    FTextureRHIRef Texture;
};

class UTextureRenderTarget2D : public UObject {
public:
    UTextureRenderTarget2D() = default;
    /** The render thread releases its resource later. */
    ~UTextureRenderTarget2D() override;
    int32 SizeX = 0, SizeY = 0;
    ETextureRenderTargetFormat RenderTargetFormat = RTF_RGBA16f;
    EPixelFormat GetFormat() const;
    void InitAutoFormat(uint32 width, uint32 height);
    void UpdateResourceImmediate(bool clear);
    FTextureRenderTargetResource* GameThread_GetRenderTargetResource() { return Resource.get(); }
    /** Used by the host. */
    std::unique_ptr<FTextureRenderTargetResource> Resource;
};
