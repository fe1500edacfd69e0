/* The engine's core in tests, implemented on the system: threads, files and clock. */
#include "core.h"
#include "objects.h"

#include "host.h"

#include <atomic>
#include <cstdarg>
#include <cstdio>
#include <cwchar>
#include <filesystem>
#include <map>

#include <windows.h>

const FKey EKeys::MouseScrollUp(L"MouseScrollUp");
const FKey EKeys::MouseScrollDown(L"MouseScrollDown");

static std::wstring formatted(const TCHAR* format, va_list values)
{
    std::wstring text(4096, L'\0');
    const int length = _vsnwprintf(text.data(), text.size(), format, values);
    text.resize(length < 0 ? text.size() : static_cast<std::size_t>(length));
    return text;
}

FString FString::Printf(const TCHAR* format, ...)
{
    va_list values;
    va_start(values, format);
    const std::wstring text = formatted(format, values);
    va_end(values);
    return FString(text.c_str());
}

bool operator==(const FString& a, const FString& b) { return _wcsicmp(*a, *b) == 0; }

FTCHARToUTF8::FTCHARToUTF8(const TCHAR* text)
{
    text_.resize(static_cast<std::size_t>(WideCharToMultiByte(CP_UTF8, 0, text, -1, nullptr, 0, nullptr, nullptr)));
    WideCharToMultiByte(CP_UTF8, 0, text, -1, text_.data(), static_cast<int>(text_.size()), nullptr, nullptr);
    text_.pop_back();
}

FUTF8ToTCHAR::FUTF8ToTCHAR(const char* text)
{
    text_.resize(static_cast<std::size_t>(MultiByteToWideChar(CP_UTF8, 0, text, -1, nullptr, 0)));
    MultiByteToWideChar(CP_UTF8, 0, text, -1, text_.data(), static_cast<int>(text_.size()));
    text_.pop_back();
}

FCriticalSection::FCriticalSection() : of_(new CRITICAL_SECTION) { InitializeCriticalSection(static_cast<CRITICAL_SECTION*>(of_.load())); }
FCriticalSection::~FCriticalSection()
{
    auto* own = static_cast<CRITICAL_SECTION*>(of_.exchange(nullptr));
    DeleteCriticalSection(own);
    delete own;
}
void FCriticalSection::Lock()
{
    auto* own = static_cast<CRITICAL_SECTION*>(of_.load());
    expect(own != nullptr, "a lock is used while there is one");
    if (own != nullptr) EnterCriticalSection(own);
}
void FCriticalSection::Unlock()
{
    auto* own = static_cast<CRITICAL_SECTION*>(of_.load());
    if (own != nullptr) LeaveCriticalSection(own);
}

FEvent::FEvent(EEventMode mode) : of_(CreateEventW(nullptr, mode == EEventMode::ManualReset, FALSE, nullptr)) {}
FEvent::~FEvent() { CloseHandle(of_); }
void FEvent::Trigger() { expect(SetEvent(of_) != FALSE, "an event is triggered while there is one"); }
bool FEvent::Wait(uint32 milliseconds) { return WaitForSingleObject(of_, milliseconds) == WAIT_OBJECT_0; }

static DWORD WINAPI run(void* runnable) { return static_cast<FRunnable*>(runnable)->Run(); }

FRunnableThread* FRunnableThread::Create(FRunnable* runnable, const TCHAR*, uint32, EThreadPriority)
{
    auto made = std::make_unique<FRunnableThread>();
    made->runnable_ = runnable;
    made->of_ = CreateThread(nullptr, 0, run, runnable, 0, nullptr);
    return made->of_ != nullptr ? made.release() : nullptr;
}
FRunnableThread::~FRunnableThread()
{
    if (of_ == nullptr) return;
    runnable_->Stop();
    WaitForCompletion();
    CloseHandle(of_);
}
void FRunnableThread::WaitForCompletion() { WaitForSingleObject(of_, INFINITE); }

uint32 FPlatformProcess::GetCurrentProcessId() { return ::GetCurrentProcessId(); }
void FPlatformProcess::Sleep(float seconds) { ::Sleep(static_cast<DWORD>(seconds * 1000)); }

double FPlatformTime::Seconds()
{
    LARGE_INTEGER ticks, per_second;
    QueryPerformanceCounter(&ticks);
    QueryPerformanceFrequency(&per_second);
    // The engine's clock does not start at zero either.
    return static_cast<double>(ticks.QuadPart) / static_cast<double>(per_second.QuadPart) + 16777216.0;
}

FTSTicker& FTSTicker::GetCoreTicker()
{
    static FTSTicker one;
    return one;
}
FTSTicker::FDelegateHandle FTSTicker::AddTicker(const FTickerDelegate& what, float)
{
    all_.emplace_back(next_, what);
    return next_++;
}
void FTSTicker::RemoveTicker(FDelegateHandle of)
{
    all_.erase(std::remove_if(all_.begin(), all_.end(), [of](const auto& one) { return one.first == of; }), all_.end());
}
void FTSTicker::Tick(float seconds)
{
    const auto all = all_;
    for (const auto& one : all) {
        if (!one.second.call(seconds)) RemoveTicker(one.first);
    }
}

/* ---- Modules ----------------------------------------------------------------------------------------------------- */

struct modules {
    std::map<std::wstring, FModuleManager::Maker> makers;
    std::map<std::wstring, std::unique_ptr<IModuleInterface>> loaded;
    static modules& get()
    {
        static modules one;
        return one;
    }
};

IModuleInterface& FModuleManager::Find(const TCHAR* name)
{
    modules& all = modules::get();
    auto& found = all.loaded[name];
    if (!found) {
        const auto maker = all.makers.find(name);
        expect(maker != all.makers.end(), "a module that was not registered is loaded");
        found = maker->second();
        found->StartupModule();
    }
    return *found;
}
IModuleInterface* FModuleManager::Loaded(const TCHAR* name)
{
    const modules& all = modules::get();
    const auto found = all.loaded.find(name);
    return found == all.loaded.end() ? nullptr : found->second.get();
}
bool FModuleManager::Register(const TCHAR* name, Maker maker)
{
    modules::get().makers[name] = maker;
    return true;
}
void FModuleManager::Shutdown()
{
    for (auto& one : modules::get().loaded) one.second->ShutdownModule();
    modules::get().loaded.clear();
}

/** Decodes one picture format of the tests' own: a size, and that many pixels. */
class image_formats final : public IImageWrapperModule {
    bool DecompressImage(const void* bytes, int64 size, FImage& to) override
    {
        const auto* given = static_cast<const uint8*>(bytes);
        if (size < 4 || given[0] != 'I' || given[1] != 'M' || size != 4 + given[2] * given[3] * 4) return false;
        to.SizeX = given[2];
        to.SizeY = given[3];
        to.RawData.SetNumUninitialized(size - 4);
        std::copy(given + 4, given + size, to.RawData.GetData());
        return true;
    }
};
IMPLEMENT_MODULE(image_formats, ImageWrapper)

/* ---- Files ------------------------------------------------------------------------------------------------------- */

static std::wstring full(const std::wstring& path)
{
    std::wstring text(32768, L'\0');
    text.resize(GetFullPathNameW(path.c_str(), static_cast<DWORD>(text.size()), text.data(), nullptr));
    return text;
}

IPluginManager& IPluginManager::Get()
{
    static IPluginManager one;
    return one;
}
TSharedPtr<IPlugin> IPluginManager::FindPlugin(const FString& name)
{
    return name == L"Cairn" ? MakeShared<IPlugin>(FString(plugin_folder().c_str())) : TSharedPtr<IPlugin>();
}

static bool is_whole(const std::wstring& path)
{
    return path.size() > 1 && (path[1] == L':' || path[0] == L'\\' || path[0] == L'/');
}

/* The program's file is two folders below the project, as in a game; no path is relative to the working folder. */
FString FPaths::ProjectDir() { return FString(L"../../"); }
FString FPaths::ProjectSavedDir() { return ProjectDir() + L"Saved/"; }
FString FPaths::ConvertRelativePathToFull(const FString& path)
{
    return is_whole(*path) ? FString(full(*path).c_str()) : FString(full(project_folder() + L"/Binaries/Win64/" + *path).c_str());
}
FString FPaths::ConvertRelativePathToFull(const FString& base, const FString& path)
{
    return is_whole(*path) ? path : base + L"/" + path;
}

static std::atomic<int> loads{0};
int pipeline_loads() { return loads; }

bool FFileHelper::LoadFileToArray(TArray64<uint8>& to, const TCHAR* file, uint32)
{
    if (std::filesystem::path(file).filename() == L"Pipelines.bin") loads++;
    FILE* opened = _wfopen(file, L"rb");
    if (opened == nullptr) return false;
    fseek(opened, 0, SEEK_END);
    to.SetNumUninitialized(ftell(opened));
    fseek(opened, 0, SEEK_SET);
    const bool read = fread(to.GetData(), 1, static_cast<std::size_t>(to.Num()), opened) == static_cast<std::size_t>(to.Num());
    fclose(opened);
    return read;
}

bool FFileHelper::SaveArrayToFile(TArrayView<const uint8> from, const TCHAR* file)
{
    const std::filesystem::path path(file);
    std::error_code failed;
    std::filesystem::create_directories(path.parent_path(), failed);
    FILE* opened = _wfopen(file, L"wb");
    if (opened == nullptr) return false;
    const bool written = fwrite(from.GetData(), 1, static_cast<std::size_t>(from.Num()), opened) == static_cast<std::size_t>(from.Num());
    return fclose(opened) == 0 && written;
}

IFileManager& IFileManager::Get()
{
    static IFileManager manager;
    return manager;
}

bool IFileManager::Delete(const TCHAR* file) { return DeleteFileW(file) != 0; }

bool IFileManager::Move(const TCHAR* to, const TCHAR* from) { return MoveFileExW(from, to, MOVEFILE_REPLACE_EXISTING) != 0; }

void WriteLog(const TCHAR* category, EVerbosity verbosity, const TCHAR* format, ...)
{
    static FCriticalSection one;
    va_list values;
    va_start(values, format);
    const std::wstring text = formatted(format, values);
    va_end(values);
    const FScopeLock locked(&one);
    std::fprintf(stderr, "%s: %s: %s\n", TCHAR_TO_UTF8(category), verbosity == EVerbosity::Error ? "error" : "info",
                 TCHAR_TO_UTF8(text.c_str()));
}
