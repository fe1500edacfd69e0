/* Objects, components, subsystems and input. The marks of the header tool mean nothing here: what it would make of them is left out. */
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
    /** By the collector, before it goes. */
    virtual void BeginDestroy() {}
    /** Whom it was made in. */
    UObject* Outer = nullptr;
    /** What was made in it, and goes with it: here nobody collects what nobody names. */
    std::vector<std::unique_ptr<UObject>> Inner;
};

/** The header tool tells each class the one above it; here they have that from one another. */
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
    /** For the host, and what AddDynamic comes to. */
    void Listen(std::function<void(A...)> what) { all_.push_back(std::move(what)); }

private:
    std::vector<std::function<void(A...)>> all_;
};
/** Of a UFUNCTION of an object's. */
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
    /** For the host. */
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

class UWorld : public UObject {
public:
    UGameInstance* GetGameInstance() const { return Game; }
    APlayerController* GetFirstPlayerController() const { return Player; }
    /** For the host. */
    UGameInstance* Game = nullptr;
    APlayerController* Player = nullptr;
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
    bool ReadPixels(TArray<FColor>& to);
    /** For the host. */
    FTextureRHIRef Texture;
};

class UTextureRenderTarget2D : public UObject {
public:
    UTextureRenderTarget2D() = default;
    /** What it has is let go of by the render thread, when that gets to it. */
    ~UTextureRenderTarget2D() override;
    int32 SizeX = 0, SizeY = 0;
    ETextureRenderTargetFormat RenderTargetFormat = RTF_RGBA16f;
    EPixelFormat GetFormat() const;
    void InitAutoFormat(uint32 width, uint32 height);
    void UpdateResourceImmediate(bool clear);
    FTextureRenderTargetResource* GameThread_GetRenderTargetResource() { return Resource.get(); }
    /** For the host. */
    std::unique_ptr<FTextureRenderTargetResource> Resource;
};
