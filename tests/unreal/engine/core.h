/*
 * The parts of the engine's core that Cairn's plugin uses, declared anew from public documentation: names, parameters and behaviour.
 * The implementation here is small and uses the standard library; host/core.cpp has what needs the system.
 */
#pragma once

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <functional>
#include <memory>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

using int32 = std::int32_t;
using int64 = std::int64_t;
using uint8 = std::uint8_t;
using uint16 = std::uint16_t;
using uint32 = std::uint32_t;
using uint64 = std::uint64_t;
using TCHAR = wchar_t;

#define TEXT(text) L##text
/** For a named, non-const object only, as in the engine. */
template <class T> constexpr std::remove_reference_t<T>&& MoveTemp(T&& value) noexcept
{
    static_assert(std::is_lvalue_reference_v<T>, "what has no name is moved without being told");
    static_assert(!std::is_const_v<std::remove_reference_t<T>>, "what may not change cannot be moved from");
    return static_cast<std::remove_reference_t<T>&&>(value);
}
#define THIRD_PARTY_INCLUDES_START
#define THIRD_PARTY_INCLUDES_END
/* Macros of the engine whose names are everyday words, so that headers are compiled with them. */
#define check(expression) do { if (!(expression)) std::abort(); } while (0)
#define verify(expression) check(expression)
#define ensure(expression) (expression)
template <class T> constexpr T&& Forward(std::remove_reference_t<T>& value) noexcept { return static_cast<T&&>(value); }
template <class T> constexpr T&& Forward(std::remove_reference_t<T>&& value) noexcept { return static_cast<T&&>(value); }

/** From the engine's version macros on the compiler's command line. */
#define UE_VERSION_OLDER_THAN(major, minor, patch) \
    (ENGINE_MAJOR_VERSION < (major) || (ENGINE_MAJOR_VERSION == (major) && ENGINE_MINOR_VERSION < (minor)) || (patch) < 0)

struct FMath {
    template <class T> static T Max(T a, T b) { return a > b ? a : b; }
    template <class T> static T Min(T a, T b) { return a < b ? a : b; }
    template <class T> static T Clamp(T value, T least, T most) { return value < least ? least : value > most ? most : value; }
    static bool IsFinite(float value) { return std::isfinite(value); }
};

/* ---- Texts and arrays -------------------------------------------------------------------------------------------- */

class FString {
public:
    FString() = default;
    FString(const TCHAR* text) : text_(text) {}
    const TCHAR* operator*() const { return text_.c_str(); }
    int32 Len() const { return static_cast<int32>(text_.size()); }
    bool IsEmpty() const { return text_.empty(); }
    TCHAR operator[](int32 at) const { return text_[static_cast<std::size_t>(at)]; }
    /** Ignores case, as the engine does. */
    friend bool operator==(const FString& a, const TCHAR* b) { return a == FString(b); }
    friend bool operator==(const FString& a, const FString& b);
    friend FString operator+(FString a, const TCHAR* b) { return a.text_ += b, a; }
    friend FString operator+(FString a, const FString& b) { return a.text_ += b.text_, a; }
    /** %s is a TCHAR string. */
    static FString Printf(const TCHAR* format, ...);

private:
    std::wstring text_;
};

class FTCHARToUTF8 {
public:
    explicit FTCHARToUTF8(const TCHAR* text);
    const char* Get() const { return text_.c_str(); }

private:
    std::string text_;
};

class FUTF8ToTCHAR {
public:
    explicit FUTF8ToTCHAR(const char* text);
    const TCHAR* Get() const { return text_.c_str(); }

private:
    std::wstring text_;
};

#define TCHAR_TO_UTF8(text) FTCHARToUTF8(text).Get()
#define UTF8_TO_TCHAR(text) FUTF8ToTCHAR(text).Get()

template <class T, class Size = int32> class TArray {
public:
    Size Num() const { return static_cast<Size>(all_.size()); }
    T* GetData() { return all_.data(); }
    const T* GetData() const { return all_.data(); }
    T& operator[](Size at) { return all_.at(static_cast<std::size_t>(at)); }
    const T& operator[](Size at) const { return all_.at(static_cast<std::size_t>(at)); }
    void Reserve(Size count) { all_.reserve(static_cast<std::size_t>(count)); }
    Size Add(T value) { return all_.push_back(std::move(value)), Num() - 1; }
    void RemoveAt(Size at) { all_.erase(all_.begin() + at); }
    void SetNumUninitialized(Size count) { all_.resize(static_cast<std::size_t>(count)); }
    void Empty() { all_.clear(); }
    auto begin() { return all_.begin(); }
    auto end() { return all_.end(); }
    auto begin() const { return all_.begin(); }
    auto end() const { return all_.end(); }

private:
    std::vector<T> all_;
};
template <class T> using TArray64 = TArray<T, int64>;

template <class Signature> using TFunctionRef = const std::function<Signature>&;

/* ---- Ownership --------------------------------------------------------------------------------------------------- */

enum class ESPMode { NotThreadSafe, ThreadSafe };

template <class T, ESPMode Mode = ESPMode::ThreadSafe> class TSharedRef {
public:
    explicit TSharedRef(std::shared_ptr<T> of) : of_(std::move(of)) {}
    T& operator*() const { return *of_; }
    T* operator->() const { return of_.get(); }
    const std::shared_ptr<T>& Std() const { return of_; }

private:
    std::shared_ptr<T> of_;
};

template <class T, ESPMode Mode = ESPMode::ThreadSafe> class TSharedPtr {
public:
    TSharedPtr() = default;
    TSharedPtr(std::shared_ptr<T> of) : of_(std::move(of)) {}
    TSharedPtr(const TSharedRef<T, Mode>& of) : of_(of.Std()) {}
    bool IsValid() const { return of_ != nullptr; }
    void Reset() { of_.reset(); }
    TSharedRef<T, Mode> ToSharedRef() const { return TSharedRef<T, Mode>(of_); }
    int32 GetSharedReferenceCount() const { return static_cast<int32>(of_.use_count()); }
    T& operator*() const { return *of_; }
    T* operator->() const { return of_.get(); }
    const std::shared_ptr<T>& Std() const { return of_; }

private:
    std::shared_ptr<T> of_;
};

template <class T, ESPMode Mode = ESPMode::ThreadSafe> class TWeakPtr {
public:
    TWeakPtr() = default;
    TWeakPtr(const TSharedPtr<T, Mode>& of) : of_(of.Std()) {}
    TSharedPtr<T, Mode> Pin() const { return of_.lock(); }

private:
    std::weak_ptr<T> of_;
};

template <class T, ESPMode Mode = ESPMode::ThreadSafe, class... A> TSharedRef<T, Mode> MakeShared(A&&... a)
{
    return TSharedRef<T, Mode>(std::make_shared<T>(std::forward<A>(a)...));
}

/** The result of MakeShareable, which converts to a TSharedRef. */
template <class T> struct TRawPtrProxy {
    T* raw;
    template <ESPMode Mode> operator TSharedRef<T, Mode>() const { return TSharedRef<T, Mode>(std::shared_ptr<T>(raw)); }
};
template <class T> TRawPtrProxy<T> MakeShareable(T* raw) { return {raw}; }

template <class T> class TUniquePtr {
public:
    bool IsValid() const { return of_ != nullptr; }
    void Reset(T* raw = nullptr) { of_.reset(raw); }
    T* operator->() const { return of_.get(); }

private:
    std::unique_ptr<T> of_;
};

/** For objects with a reference count of their own. */
template <class T> class TRefCountPtr {
public:
    TRefCountPtr() = default;
    TRefCountPtr(const TRefCountPtr&) = delete;
    TRefCountPtr& operator=(const TRefCountPtr&) = delete;
    ~TRefCountPtr() { if (of_ != nullptr) of_->Release(); }
    bool IsValid() const { return of_ != nullptr; }
    operator T*() const { return of_; }
    T* operator->() const { return of_; }
    /** Address for a new reference. The former one is released. */
    T** GetInitReference()
    {
        if (of_ != nullptr) std::exchange(of_, nullptr)->Release();
        return &of_;
    }

private:
    T* of_ = nullptr;
};

/* ---- Threads and time -------------------------------------------------------------------------------------------- */

class FCriticalSection {
public:
    FCriticalSection();
    ~FCriticalSection();
    FCriticalSection(const FCriticalSection&) = delete;
    /** Locking a destroyed one is reported: its memory may have been reused. */
    void Lock();
    void Unlock();

private:
    std::atomic<void*> of_;
};

class FScopeLock {
public:
    explicit FScopeLock(FCriticalSection* of) : of_(of) { of_->Lock(); }
    ~FScopeLock() { of_->Unlock(); }
    FScopeLock(const FScopeLock&) = delete;

private:
    FCriticalSection* of_;
};

enum class EEventMode { AutoReset, ManualReset };

class FEvent {
public:
    explicit FEvent(EEventMode mode);
    ~FEvent();
    FEvent(const FEvent&) = delete;
    void Trigger();
    bool Wait(uint32 milliseconds);

private:
    void* of_;
};

class FEventRef {
public:
    explicit FEventRef(EEventMode mode) : event_(std::make_unique<FEvent>(mode)) {}
    FEvent* operator->() const { return event_.get(); }

private:
    std::unique_ptr<FEvent> event_;
};

enum EThreadPriority { TPri_Normal, TPri_BelowNormal };

class FRunnable {
public:
    virtual ~FRunnable() = default;
    virtual uint32 Run() = 0;
    virtual void Stop() {}
};

class FRunnableThread {
public:
    static FRunnableThread* Create(FRunnable* runnable, const TCHAR* name, uint32 stack, EThreadPriority priority);
    /** Asks the runnable to stop, as Kill does, and waits. */
    ~FRunnableThread();
    void WaitForCompletion();

private:
    void* of_ = nullptr;
    FRunnable* runnable_ = nullptr;
};

struct FPlatformTime {
    static double Seconds();
};

struct FPlatformProcess {
    static void Sleep(float seconds);
    static uint32 GetCurrentProcessId();
};

class FTickerDelegate {
public:
    template <class T> static FTickerDelegate CreateRaw(T* object, bool (T::*what)(float))
    {
        FTickerDelegate made;
        made.call = [object, what](float seconds) { return (object->*what)(seconds); };
        return made;
    }
    std::function<bool(float)> call;
};

class FTSTicker {
public:
    using FDelegateHandle = int32;
    static FTSTicker& GetCoreTicker();
    FDelegateHandle AddTicker(const FTickerDelegate& what, float delay);
    void RemoveTicker(FDelegateHandle of);
    /** Called by the host. */
    void Tick(float seconds);

private:
    std::vector<std::pair<int32, FTickerDelegate>> all_;
    int32 next_ = 1;
};

/* ---- Modules, files and pictures --------------------------------------------------------------------------------- */

class IModuleInterface {
public:
    virtual ~IModuleInterface() = default;
    virtual void StartupModule() {}
    virtual void ShutdownModule() {}
};

class FModuleManager {
public:
    template <class T> static T& LoadModuleChecked(const TCHAR* name) { return static_cast<T&>(Find(name)); }
    /** Null if it is not loaded. */
    template <class T> static T* GetModulePtr(const TCHAR* name) { return static_cast<T*>(Loaded(name)); }
    static IModuleInterface* Loaded(const TCHAR* name);
    static IModuleInterface& Find(const TCHAR* name);
    using Maker = std::unique_ptr<IModuleInterface> (*)();
    static bool Register(const TCHAR* name, Maker maker);
    /** Called by the host: shuts down all loaded modules. */
    static void Shutdown();
};
#define IMPLEMENT_MODULE(type, name)                                                                   \
    static const bool name##Registered = FModuleManager::Register(                                     \
        L## #name, [] { return std::unique_ptr<IModuleInterface>(std::make_unique<type>()); });

class IPlugin {
public:
    explicit IPlugin(FString folder) : folder_(std::move(folder)) {}
    FString GetBaseDir() const { return folder_; }

private:
    FString folder_;
};

class IPluginManager {
public:
    static IPluginManager& Get();
    TSharedPtr<IPlugin> FindPlugin(const FString& name);
};

struct FPaths {
    static FString Combine(const FString& a, const TCHAR* b) { return a + L"/" + b; }
    /** Relative to the folder of the program's file. */
    static FString ConvertRelativePathToFull(const FString& path);
    /** Relative to another folder, which is not changed. */
    static FString ConvertRelativePathToFull(const FString& base, const FString& path);
    /** Relative to the folder of the program's file. */
    static FString ProjectDir();
    static FString ProjectSavedDir();
};

template <class T> class TArrayView {
public:
    TArrayView(T* data, int32 count) : data_(data), count_(count) {}
    T* GetData() const { return data_; }
    int32 Num() const { return count_; }

private:
    T* data_;
    int32 count_;
};

enum EFileRead { FILEREAD_None = 0, FILEREAD_Silent = 2 };

struct FFileHelper {
    static bool LoadFileToArray(TArray64<uint8>& to, const TCHAR* file, uint32 flags = FILEREAD_None);
    /** Creates missing folders. */
    static bool SaveArrayToFile(TArrayView<const uint8> from, const TCHAR* file);
};

class IFileManager {
public:
    static IFileManager& Get();
    /** Replaces an existing file. */
    bool Move(const TCHAR* to, const TCHAR* from);
    bool Delete(const TCHAR* file);
};

struct FColor {
    uint8 B = 0, G = 0, R = 0, A = 0;
};

struct FLinearColor {
    float R = 0, G = 0, B = 0, A = 0;
    /** Clamps values to 0 to 1. */
    FColor ToFColor(bool srgb) const;
};

enum class ERawImageFormat : uint8 { BGRA8 };
enum class EGammaSpace : uint8 { sRGB };

struct FImage {
    int32 SizeX = 0, SizeY = 0;
    TArray64<uint8> RawData;
    void ChangeFormat(ERawImageFormat, EGammaSpace) {}
};

class IImageWrapperModule : public IModuleInterface {
public:
    virtual bool DecompressImage(const void* bytes, int64 size, FImage& to) = 0;
};

/* ---- The log ----------------------------------------------------------------------------------------------------- */

enum class EVerbosity { Error, Warning, Log, Verbose, All };
void WriteLog(const TCHAR* category, EVerbosity verbosity, const TCHAR* format, ...);
#define DECLARE_LOG_CATEGORY_EXTERN(name, verbosity, all) extern const TCHAR* const name
#define DEFINE_LOG_CATEGORY(name) const TCHAR* const name = L## #name
constexpr const TCHAR* LogTemp = L"LogTemp";
#define UE_LOG(category, verbosity, ...) WriteLog(category, EVerbosity::verbosity, __VA_ARGS__)
